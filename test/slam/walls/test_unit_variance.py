"""The unit variance of a graph, against residuals of known variance."""

import numpy as np
import pytest

from tccm_ros.slam.factors.keys import keyframe_key, wall_key
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.walls.outliers import _without_tail, unit_variance

PRIOR_FREEDOM = 2.0  # degrees of freedom of the prior
PRIOR_VARIANCE = 0.05  # mean of the prior: covariances of factors are conservative

KEYFRAMES, NORMALS = 400, np.array([0.1, 1.7, 3.2, 4.8])
COV = np.array([[1e-4, 2e-5], [2e-5, 4e-4]])


class Known:
    """A solution with keyframes along a line, and four walls 5 m from the origin."""

    def planar_poses(self, keys):
        return np.array([[0.01 * key.number, 0.0, 0.3] for key in keys])

    def plane(self, key):
        phi = NORMALS[key.number]
        return np.array([np.cos(phi), np.sin(phi), 0.0, -5.0])


def observations_of(away, walls=NORMALS):
    """Return observations of walls by all keyframes, off by `away` (K, W, n, 2) (rad, m)."""
    found = []
    for k, row in enumerate(away):
        key = keyframe_key(k)
        x, y, yaw = Known().planar_poses([key])[0]
        for w, lines in enumerate(row):
            phi = walls[w]
            for dphi, drho in lines:
                rho = 5.0 - x * np.cos(phi) - y * np.sin(phi)
                seen = (phi - yaw + dphi, rho + drho)
                found.append(WallObservation(key, wall_key(w), *seen, COV))
    return found


def without_prior(found, redundancy):
    return (found * (redundancy + PRIOR_FREEDOM) - PRIOR_FREEDOM * PRIOR_VARIANCE) / redundancy


@pytest.mark.parametrize("sigma", [0.2, 1.0])
@pytest.mark.parametrize("walls", [1, 2, 4])
def test_unit_variance_is_that_of_independent_residuals(sigma, walls):
    """Also of one wall or two, which do not measure all of a pose; 3 sigmas of 800 squares."""
    random = np.random.default_rng(0)
    away = sigma * random.multivariate_normal([0, 0], COV, (KEYFRAMES, walls, 2))
    found = unit_variance(Known(), observations_of(away), 0.0, 0)
    assert found == pytest.approx(sigma**2, rel=3.0 * np.sqrt(2.0 / (2 * KEYFRAMES)))


def test_lines_whose_deviations_cancel_each_other_do_not_count():
    """The middle of a wall that bows is behind it, its ends are before it."""
    bow = np.tile([[0.0, 0.02], [0.0, -0.02]], (KEYFRAMES, 2, 1, 1))
    found = unit_variance(Known(), observations_of(bow), 0.0, 0)
    assert found < 1e-3
    # Two walls that both seem 2 cm further away are 4 squares of one over 3 dimensions.
    alike = np.abs(bow)
    assert unit_variance(Known(), observations_of(alike), 0.0, 0) > 1.0


def test_loop_closures_count_with_their_redundancy():
    found = unit_variance(Known(), [], 60.0, 30)
    assert without_prior(found, 30) == pytest.approx(2.0)


def test_unit_variance_without_redundancy_is_one():
    assert unit_variance(Known(), [], 0.0, 0) == 1.0
    once = np.zeros((1, 4, 1, 2))
    assert unit_variance(Known(), observations_of(once), 0.0, 0) == 1.0


def test_a_few_outliers_do_not_change_the_unit_variance():
    """One line in a hundred 300 times further off than noise: within the careful gates still."""
    random = np.random.default_rng(0)
    chi2 = random.chisquare(2, 2000)
    strayed = np.where(np.arange(2000) % 100 == 0, 300.0, chi2)
    assert _without_tail(chi2) == pytest.approx(chi2.sum(), rel=0.01)
    assert _without_tail(strayed) < 1.1 * chi2.sum()
    assert _without_tail(np.zeros(0)) == 0.0
