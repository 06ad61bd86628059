"""The recording for `tccm demo`, included in the package."""

from __future__ import annotations

from pathlib import Path

DEMO = Path(__file__).parent / "demo" / "flat.mcap"
"""The flat of two rooms, scanned with fewer beams than `bags/flat` (`bags/make_bags.py`)."""
