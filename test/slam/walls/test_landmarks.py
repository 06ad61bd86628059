"""What walls add to the graph: the flatness of a line, and the directions of a building."""

import numpy as np
import pytest

from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.chain import yaw_offset_for
from tccm_ros.slam.factors.building import Building, WallDirection
from tccm_ros.slam.factors.keys import keyframe_key, wall_key
from tccm_ros.slam.factors.poses import PriorPose
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.landmarks import MIN_WALLS, structure_factors, wall_records
from tccm_ros.slam.walls.line_noise import _flatness_covariance
from tccm_ros.slam.walls.lines import Lines


def line_of(ends):
    """Direction of the normal and distance of the line through two points (2, 2)."""
    direction = ends[1] - ends[0]
    phi = np.arctan2(-direction[0], direction[1])
    return np.array([phi, np.array([np.cos(phi), np.sin(phi)]) @ ends[0]])


@pytest.mark.parametrize("middle", [(2.0, 0.0), (1.5, 2.5), (-1.0, 0.7)])
@pytest.mark.parametrize("length", [0.4, 2.0])
def test_a_wall_that_is_not_flat_shifts_and_rotates_its_line(middle, length):
    """By one sigma, and by sqrt(12) sigma over the length; derivatives by moving the ends."""
    sigma = 0.005
    half = 0.5 * length * np.array([np.sin(0.4), -np.cos(0.4)])
    ends = np.array([middle - half, middle + half])
    phi, rho = line_of(ends)
    lines = Lines(np.array([phi]), np.array([rho]), np.zeros((1, 2, 2)), ends[None], np.array([20]))
    normal = np.array([np.cos(phi), np.sin(phi)])
    moves = []
    for both in ((1.0, 1.0), (-np.sqrt(3.0), np.sqrt(3.0))):
        step = 1e-6 * np.array(both)[:, None] * normal
        moves.append((line_of(ends + step) - line_of(ends - step)) / 2e-6)
    expected = sigma**2 * np.array(moves).T @ np.array(moves)
    assert _flatness_covariance(lines, 0, sigma**2) == pytest.approx(expected, rel=1e-5)


def table_of(phi, lengths):
    none = np.zeros(0, np.int64)
    extent = np.column_stack([np.zeros(len(phi)), lengths])
    rho, whole = np.ones(len(phi)), np.arange(len(phi))
    return WallTable(none, none, none, np.array(phi), rho, extent, np.zeros(len(phi)), whole)


@pytest.mark.parametrize("count", [MIN_WALLS, MIN_WALLS + 1, 9])
def test_walls_of_a_building_are_parallel_or_at_right_angles(count):
    yaw = 0.3
    rng = np.random.default_rng(count)
    quarters = rng.integers(-1, 3, count)
    phi = wrap_angle(yaw + quarters * np.pi / 2 + rng.normal(0.0, 0.005, count))
    odd = [wrap_angle(yaw + 0.6)]
    building, *directions = structure_factors(table_of([*phi, *odd], [2.0] * count + [0.5]))
    assert isinstance(building, Building)
    assert np.sin(2.0 * (building.yaw - yaw)) == pytest.approx(0.0, abs=0.02)
    assert len(directions) == count, "not the one that runs across"
    for factor, direction in zip(directions, phi):
        assert isinstance(factor, WallDirection)
        assert wrap_angle(building.yaw + factor.angle - direction) == pytest.approx(0.0, abs=0.02)
        assert np.sin(2.0 * factor.angle) == pytest.approx(0.0, abs=1e-9)


def test_few_walls_or_walls_in_all_directions_are_no_building():
    assert structure_factors(table_of([0.0, np.pi / 2], [2.0, 2.0])) == []
    assert structure_factors(table_of([0.0, 0.2, 0.5, 0.8, 1.1, 1.3], [2.0] * 6)) == []


def test_pieces_are_landmarks_and_one_wall_in_the_result():
    """The piece with the most observations is extended over the others, and their counts add."""
    key = keyframe_key(0, yaw_offset_for(np.array([0.0, np.pi / 2])))
    phi, rho = np.array([0.0, 0.03, np.pi / 2]), np.array([3.0, 3.02, 2.0])
    cov = np.diag([0.002**2, 0.005**2])
    factors = [WallObservation(key, wall_key(w), phi[w], rho[w], cov) for w in (0, 0, 1, 2)]
    graph = PoseGraph([PriorPose(key, np.zeros(3), np.eye(3) * 1e-8), *factors], {key: np.zeros(3)})
    extent = np.array([[-1.0, 1.0], [0.5, 2.0], [0.0, 1.0]])
    none, seen = np.zeros(4, np.int64), np.array([0, 0, 1, 2])
    table = WallTable(none, none, seen, phi, rho, extent, np.zeros(3), np.array([7, 7, 2]))
    first, second = wall_records(table, [], graph.optimise(), 1.0)
    assert (first.phi, first.rho, first.observations) == pytest.approx((0.0, 3.0, 3), abs=1e-6)
    # The far end of the other piece: 3.02 (cos, sin) + 2.0 (-sin, cos), projected to x = 3.
    far = 3.02 * np.sin(0.03) + 2.0 * np.cos(0.03)
    assert first.endpoints == pytest.approx(np.array([[3.0, -1.0], [3.0, far]]), abs=1e-6)
    assert (second.phi, second.observations) == pytest.approx((np.pi / 2, 1), abs=1e-6)
