"""The scale of residuals among which some are outliers."""

import numpy as np

from tccm_ros.arrays import Float64

MAD_TO_SIGMA = 1.4826
"""Standard deviation of normal residuals over their median absolute deviation: 1 over the 75 %
quantile of the normal distribution."""


def median_sigma(residuals: Float64) -> float:
    """Return the standard deviation of residuals float64 (N,), N > 0, from their median distance.

    Up to half of them may be outliers; the rest is taken to be normal, of mean 0.
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals)))
