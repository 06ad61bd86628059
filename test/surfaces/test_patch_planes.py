"""Planes of patches, also of points that are on a line."""

import numpy as np
import pytest

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.surfaces.patch_planes import (
    EFFECTIVE_POINTS,
    fit_covariance,
    fit_plane,
    point_variance,
    pose_covariance,
)


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


@pytest.mark.parametrize("count", [int(EFFECTIVE_POINTS / 2), int(4 * EFFECTIVE_POINTS)])
def test_the_covariance_of_a_fit_is_that_of_least_squares(count):
    """Of z, and its slopes, at the mean of points; many are worth as much as some."""
    rng = np.random.default_rng(count)
    xy = rng.uniform(-0.6, 0.6, (count, 2)) @ [[1.0, 0.4], [0.0, 0.5]]
    xy -= xy.mean(axis=0)
    points = np.column_stack([xy, 0.03 * xy[:, 0] + rng.normal(0.0, 0.002, count)])
    rows = np.column_stack([np.ones(count), xy])
    cov = covariance(points)
    worth = count / min(count, EFFECTIVE_POINTS)
    expected = worth * point_variance(cov) * np.linalg.inv(rows.T @ rows)
    assert fit_covariance(cov, count) == pytest.approx(expected, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("yaw", [-2.0, 0.0, 0.8])
def test_a_pose_that_rises_rolls_or_pitches_moves_planes(yaw):
    """Derivatives of height and slopes of a horizontal plane, by moving the pose."""
    centroid, step = np.array([2.0, -0.5, 0.7]), 1e-6

    def plane(z, roll, pitch):
        """Height and slopes at the centroid of what was horizontal there."""
        T = pose_from_rpy([0.3, 0.4, z, roll, pitch, yaw])
        normal = T[:3, 2]
        point = T[:3, 3] + (centroid[2] * normal)
        slopes = -normal[:2] / normal[2]
        return np.array([point[2] + slopes @ (centroid[:2] - point[:2]), *slopes])

    moves = np.eye(3) * step
    J = np.array([(plane(*move) - plane(*-move)) / (2.0 * step) for move in moves]).T
    variances = np.diag([1e-4, 4e-4, 9e-4])
    found = pose_covariance(pose_from_rpy([0.3, 0.4, 0.0, 0.0, 0.0, yaw]), variances, centroid)
    # The point that stays over the base's origin moves by the height times the rotation.
    assert found == pytest.approx(J @ variances @ J.T, rel=1e-4, abs=1e-9)
