"""What has an outline: points in lines have one, tops of a few small objects have none together."""

import numpy as np
import pytest
from surface_maps import poses_at

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import SurfaceCloud

FEW_POINTS = 50  # two scan lines of 25 beams


def surfaces_of(points):
    """Map one view of points that a tilt cycle took for one surface."""
    surface_map = SurfaceSlam(Config()).map
    surface = np.zeros(len(points), np.uint32)
    surface_map.add(SurfaceCloud(7, "base", points.astype(np.float32), surface))
    return surface_map.build(poses_at(np.eye(4)[None])).surfaces


def tops(count, seed):
    """Tops of four objects of 5 cm, 0.3 m from each other, with so many points each."""
    rng = np.random.default_rng(seed)
    middles = np.array([[2.0, 0.0], [2.0, 0.3], [2.3, 0.0], [2.3, 0.3]])
    xy = np.repeat(middles, count, axis=0) + rng.uniform(-0.025, 0.025, (4 * count, 2))
    return np.column_stack([xy, 0.88 + rng.normal(0.0, 0.003, 4 * count)])


@pytest.mark.parametrize("seed", range(4))
def test_tops_of_small_objects_are_not_one_surface(seed):
    assert not surfaces_of(tops(6, seed))


def test_a_board_under_three_scan_lines_is_a_surface():
    """As few points, in lines at a distance of 0.1 m."""
    x, y = np.meshgrid([2.0, 2.1, 2.2], np.linspace(-0.35, 0.35, FEW_POINTS // 3 - 1))
    board = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.88)])
    (found,) = surfaces_of(board)
    assert found.area_seen > 0.1
