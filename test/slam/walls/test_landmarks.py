"""What walls add to the graph: the flatness of a line, and pieces of one wall."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.slam.chain import yaw_offset_for
from tccm_ros.slam.factors.keys import keyframe_key, wall_key
from tccm_ros.slam.factors.poses import PriorPose
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.landmarks import wall_records
from tccm_ros.slam.walls.lines import Lines, line_covariance


def line_of(ends):
    """Direction of the normal and distance of the line through two points (2, 2)."""
    direction = ends[1] - ends[0]
    phi = np.arctan2(-direction[0], direction[1])
    return np.array([phi, np.array([np.cos(phi), np.sin(phi)]) @ ends[0]])


@pytest.mark.parametrize("middle", [(2.0, 0.0), (1.5, 2.5), (-1.0, 0.7)])
@pytest.mark.parametrize("length", [0.4, 2.0])
def test_a_wall_that_is_not_flat_shifts_and_rotates_its_line(middle, length):
    """By one sigma, and by sqrt(12) sigma over the length; derivatives by moving the ends."""
    sigma = 0.02  # more than the flatness of all walls
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
    assert line_covariance(lines, 0, Config(), sigma) == pytest.approx(expected, rel=1e-5)


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
