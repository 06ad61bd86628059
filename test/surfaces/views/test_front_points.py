"""The front below the near edge of a board does not tilt or lower the board."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import transform2
from tccm_ros.records import SurfaceCloud
from tccm_ros.surfaces.views.front_points import are_on_front
from tccm_ros.surfaces.views.views import empty_view, with_cloud

HEIGHT, SIGMA = 1.2, 0.001


def line(depth, z, count=70, seed=0):
    """A scan line over 1 m of a board whose near edge is 3 m ahead, a depth behind it, m."""
    rng = np.random.default_rng(seed)
    y = np.linspace(-0.5, 0.5, count)
    x = np.full(count, 3.0 + depth)
    return np.column_stack([x, y, z + rng.normal(0.0, SIGMA, count)])


def board(yaw):
    """Two lines on the top, two on the 2 cm of front; points, and which are of the front."""
    parts = [line(0.0, HEIGHT - 0.016, seed=1), line(0.0, HEIGHT - 0.011, seed=2)]
    parts += [line(0.06, HEIGHT, 40, seed=3), line(0.18, HEIGHT, 40, seed=4)]
    points = np.concatenate(parts)
    points[:, :2] = transform2(np.array([0.0, 0.0, yaw]), points[:, :2])
    return points, np.arange(len(points)) < 140


@pytest.mark.parametrize("yaw", [0.0, 0.6, -2.0])
def test_the_front_of_a_board_is_found(yaw):
    points, is_front = board(yaw)
    found = are_on_front(points)
    assert found[is_front].mean() > 0.97
    assert not found[~is_front].any()


def test_the_height_of_a_board_is_that_of_its_top():
    points, _ = board(0.3)
    cloud = SurfaceCloud(7, "base", points.astype(np.float32), np.zeros(len(points), np.uint32))
    (patch,) = with_cloud(empty_view(7, 0, Config()), cloud, Config()).patches
    assert patch.mean[2] == pytest.approx(HEIGHT, abs=SIGMA)


def test_a_ramp_away_from_the_robot_has_no_front():
    """One that rises by 4 deg, under ten lines."""
    lines = [line(depth, HEIGHT + 0.07 * depth) for depth in np.linspace(0.0, 1.0, 10)]
    assert not are_on_front(np.concatenate(lines)).any()


def test_a_level_board_and_one_that_is_lower_at_its_far_side_have_no_front():
    level = [line(depth, HEIGHT, seed=k) for k, depth in enumerate((0.0, 0.1, 0.2))]
    assert not are_on_front(np.concatenate(level)).any()
    lower = [line(0.0, HEIGHT), line(0.1, HEIGHT), line(0.2, HEIGHT - 0.02)]
    assert not are_on_front(np.concatenate(lower)).any()
    assert not are_on_front(np.zeros((1, 3))).any()
