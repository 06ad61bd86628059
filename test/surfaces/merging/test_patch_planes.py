"""Planes of patches, also of points that are on a line."""

import numpy as np
import pytest

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.surfaces.merging.patch_planes import fit_plane, pose_jacobian
from tccm_ros.surfaces.views.plane_errors import fit_covariance, systematic_planes


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


def test_the_covariance_of_a_fit_is_that_of_many_fits():
    """Points with white noise on a tilted rectangle: the scatter of 400 fits."""
    rng = np.random.default_rng(5)
    found, fits = [], []
    for _ in range(400):
        xy = rng.uniform(-0.6, 0.6, (200, 2)) @ [[1.0, 0.4], [0.0, 0.5]]
        z = 0.03 * xy[:, 0] + rng.normal(0.0, 0.01, 200)
        points = np.column_stack([xy, z])
        found.append(fit_covariance(points, np.ones(200)))
        fits.append(np.linalg.lstsq(np.column_stack([np.ones(200), xy]), z, rcond=None)[0])
    truth = np.diag(np.cov(np.array(fits).T))
    # The blocks' sums count the white noise once more.
    ratio = np.diag(np.mean(found, axis=0))[1:] / truth[1:]
    assert (ratio > 1.0).all()
    assert (ratio < 3.0).all()


def test_covariance_with_common_errors_does_not_fall_with_more_points():
    """A patch that is bent by 5 mm: ten times the points leave its covariance as it is."""
    sigmas = []
    for count in (400, 4000):
        xy = np.random.default_rng(count).uniform(-0.5, 0.5, (count, 2))
        bent = 0.005 * np.sin(9.0 * xy[:, 0]) * np.cos(7.0 * xy[:, 1])
        cov = fit_covariance(np.column_stack([xy, bent]), np.ones(count))
        sigmas.append(np.sqrt(np.trace(cov[1:, 1:])))
        # Independent residuals of the same size would make it better and better.
        alone = np.std(bent) * np.sqrt(2.0 * 12.0 / count)
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.4)
    assert sigmas[1] > 3.0 * alone


def test_a_systematic_error_tilts_the_plane_as_it_tilts_the_points():
    rng = np.random.default_rng(2)
    points = np.column_stack(
        [rng.uniform(1.0, 2.0, 300), rng.uniform(-0.4, 0.4, 300), np.zeros(300)]
    )
    errors = np.zeros((300, 2, 3))
    errors[:, 0, 2] = 0.004
    errors[:, 1, 2] = 0.01 * (points[:, 0] - points[:, 0].mean())
    found = systematic_planes(points, np.ones(300), errors)
    assert found == pytest.approx(np.array([[0.004, 0.0], [0.0, 0.01], [0.0, 0.0]]), abs=1e-4)


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
    derivative = pose_jacobian(pose_from_rpy([0.3, 0.4, 0.0, 0.0, 0.0, yaw]), centroid)
    found = derivative @ variances @ derivative.T
    # The point that stays over the base's origin moves by the height times the rotation.
    assert found == pytest.approx(J @ variances @ J.T, rel=1e-4, abs=1e-9)
