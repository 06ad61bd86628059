"""Recognise numbers that were written in the other byte order than their message says."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

SAMPLES = 4096
"""Number of compared numbers. Chosen: a few ms for the largest image."""

MIN_NUMBERS = 100
"""Minimum number of compared numbers (chosen: fewer are plausible by chance)."""

PLAUSIBLE = 1e-4, 1e4
"""Range of the absolute values of measured coordinates, m or mm. The exponent of a swapped float32
is a byte of its mantissa: a tenth of swapped numbers are within the range."""

ROUGHER = 8.0
"""Minimum ratio of the median steps between neighbours in the wrong and right byte order. Chosen:
swapped depths step by tens of metres in any scene; correct ones by millimetres."""

SWAPPED = "is_bigendian contradicts the numbers, which are read in the other byte order"
"""Remark on messages whose numbers contradict their `is_bigendian`."""


def is_swapped(values: NDArray[Any]) -> bool:
    """Return whether an array makes sense only in the other byte order.

    Parameters
    ----------
    values
        float32 or float64 of any shape, or uint16 (H, W), as the message says; neighbours in a row
        are neighbours in the scene.
    """
    every = max(values.size // SAMPLES, 1)
    if values.dtype.kind == "f":
        some = values.ravel()[::every]
        return _plausible(some.byteswap()) > max(2.0 * _plausible(some), MIN_NUMBERS)
    rows = values[:: min(every, max(len(values) - 1, 1))]
    return _step(rows) > ROUGHER * _step(rows.byteswap())


def _plausible(values: NDArray[Any]) -> int:
    """Return the number of plausible coordinates; not counting zeros, which are equal in both."""
    with np.errstate(invalid="ignore"):
        sizes = np.abs(values)
    return int(np.count_nonzero((sizes > PLAUSIBLE[0]) & (sizes < PLAUSIBLE[1])))


def _step(rows: NDArray[Any]) -> float:
    """Return the median difference of neighbours in the rows, none of which is 0; 0 for few."""
    left, right = rows[:, :-1].astype(np.int64), rows[:, 1:].astype(np.int64)
    both = (left > 0) & (right > 0)
    steps = np.abs(left - right)[both]
    return float(np.median(steps)) if len(steps) >= MIN_NUMBERS else 0.0
