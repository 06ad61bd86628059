"""Robust estimation: the scale of residuals with outliers, their gate, majorities, widths."""

import numpy as np

from tccm_ros.arrays import Float64

MAD_TO_SIGMA = 1.4826
"""Ratio of standard deviation and median absolute deviation of a normal distribution: 1 over its 75
% quantile."""

GATE = 3.0
"""Maximum difference of two measurements that agree, in standard deviations: 99.7 % of all."""

MAJORITY = 0.5
"""Minimum fraction that counts as a majority."""

AMBIGUOUS = 0.75
"""A solution is ambiguous if another one has more than this fraction of its votes or its score."""

UNIFORM_WIDTH = 12.0**0.5
"""Width of a uniform distribution, in its standard deviations."""


def median_sigma(residuals: Float64) -> float:
    """Return the standard deviation of residuals float64 (N,), N > 0, from their median magnitude.

    Up to half of them may be outliers; the others are assumed to be normal with mean 0.
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals)))
