"""Robust estimate of the scale of residuals with outliers."""

import numpy as np

from tccm_ros.arrays import Float64

MAD_TO_SIGMA = 1.4826
"""Ratio of standard deviation and median absolute deviation of a normal distribution: 1 over its 75
% quantile."""


def median_sigma(residuals: Float64) -> float:
    """Return the standard deviation of residuals float64 (N,), N > 0, from their median magnitude.

    Up to half of them may be outliers; the others are assumed to be normal with mean 0.
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals)))
