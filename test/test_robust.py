import numpy as np
import pytest
from scipy import stats

from tccm_ros.robust import MAD_TO_SIGMA, median_sigma


def test_the_scale_is_that_of_normal_residuals_whatever_the_outliers():
    residuals = np.random.default_rng(0).normal(0.0, 0.3, 20_000)
    assert median_sigma(residuals) == pytest.approx(0.3, rel=0.02)
    residuals[:2_000] = 1e6
    assert median_sigma(residuals) == pytest.approx(0.3, rel=0.2)


def test_the_factor_is_one_over_the_quantile():
    assert pytest.approx(1.0 / stats.norm.ppf(0.75), rel=1e-5) == MAD_TO_SIGMA
