"""Recordings that are not part of the project; tests are skipped with a reason without them."""

import os
from pathlib import Path

import pytest


def shared(relative: str) -> Path:
    """Return the path of a recording, or skip the test with a reason."""
    root = Path(os.environ.get("TCCM_SHARED", Path(__file__).resolve().parents[3] / "shared"))
    path = root / "data" / relative
    if not path.exists():
        pytest.skip(f"recording {relative} is not here; set TCCM_SHARED to the folder that has it")
    return path
