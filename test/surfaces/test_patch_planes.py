"""Planes of patches, also of points that are on a line."""

import numpy as np
import pytest

from tccm_ros.surfaces.patch_planes import fit_plane


def covariance(points):
    return np.cov(np.asarray(points, float).T, bias=True)


def test_the_plane_of_points_on_a_plane_is_that_plane():
    rng = np.random.default_rng(0)
    xy = rng.uniform(-1.0, 1.0, (500, 2))
    points = np.column_stack([xy, 0.05 * xy[:, 0] - 0.02 * xy[:, 1]])
    normal, variances = fit_plane(covariance(points))
    expected = np.array([-0.05, 0.02, 1.0])
    assert normal == pytest.approx(expected / np.linalg.norm(expected), abs=1e-9)
    assert variances[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("yaw", np.linspace(0.0, 3.0, 7))
@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_the_plane_of_points_on_a_line_is_the_nearest_to_horizontal(yaw, slope):
    along = np.array([np.cos(yaw), np.sin(yaw), slope])
    # Heights that scatter more than the line is wide: an unconstrained fit would be vertical.
    rng = np.random.default_rng(1)
    points = np.linspace(-0.5, 0.5, 40)[:, None] * along
    points[:, 2] += rng.normal(0.0, 1e-4, 40)
    normal, _ = fit_plane(covariance(points))
    assert normal[2] == pytest.approx(1.0 / np.hypot(1.0, slope), abs=1e-3)
    assert normal @ along == pytest.approx(0.0, abs=1e-3)


def test_the_plane_of_a_single_point_is_horizontal():
    assert fit_plane(np.zeros((3, 3)))[0] == pytest.approx([0.0, 0.0, 1.0])


def test_the_plane_of_points_above_each_other_is_horizontal():
    assert fit_plane(np.diag([0.0, 0.0, 1e-4]))[0] == pytest.approx([0.0, 0.0, 1.0])
