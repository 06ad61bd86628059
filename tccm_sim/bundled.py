"""The recording that `tccm demo` maps: it comes with the package, a checkout is not needed."""

from __future__ import annotations

from pathlib import Path

DEMO = Path(__file__).parent / "demo" / "flat.mcap"
"""The flat of two rooms, scanned with fewer beams than `bags/flat` (`bags/make_bags.py`)."""
