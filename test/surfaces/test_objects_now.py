"""Objects between solutions: those of the next one, at the live pose of the newest view."""

import numpy as np

from tccm_ros.config import Config
from tccm_ros.geometry import inverse, spatial, transform
from tccm_ros.records import ObjectBoxes, Odometry, SurfaceCloud
from tccm_ros.surfaces.surface_slam import SurfaceSlam

S = 1_000_000_000
TOP = np.stack(np.meshgrid(np.arange(1.0, 2.2, 0.03), np.arange(-0.4, 0.4, 0.03)), -1)
TABLE = np.column_stack([TOP.reshape(-1, 2), np.full(TOP[..., 0].size, 0.75)])
CUP = np.array([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])


def look(slam, stamp_ns, x, *cups):
    """Add a view of the table and of cups at places in map, from a base that has driven x m."""
    T = spatial(np.array([x, 0.0, 0.1 * x]))
    slam.add(Odometry(stamp_ns, "odom", "base", T))
    points = transform(inverse(T), TABLE).astype(np.float32)
    labels = np.zeros(len(points), np.uint32)
    viewpoint = np.array([0.0, 0.0, 1.2], np.float32)
    slam.add(SurfaceCloud(stamp_ns, "base", points, labels, viewpoint))
    places = [np.column_stack([CUP + cup, np.full(4, 0.8)]) for cup in cups]
    footprints = tuple(transform(inverse(T), place)[:, :2] for place in places)
    heights = np.tile([0.75, 0.85], (len(cups), 1))
    slam.add(ObjectBoxes(stamp_ns, "base", footprints, heights, np.full(len(cups), 50)))


def test_objects_of_a_newer_view_are_those_of_the_next_solution():
    slam = SurfaceSlam(Config())
    look(slam, 10 * S, 0.0, (1.3, 0.0))
    solution = slam.solve()
    (cup,) = solution.objects
    look(slam, 20 * S, 0.3, (1.3, 0.0), (1.8, 0.2))
    objects = slam.objects_now(solution, slam.solved_map(solution).p_map_tracking)
    expected = slam.solve().objects
    assert [o.id for o in objects] == [o.id for o in expected] == [cup.id, cup.id + 2]
    for item, other in zip(objects, expected):
        np.testing.assert_allclose(item.center, other.center, atol=1e-3)
    np.testing.assert_allclose(objects[1].center, [1.8, 0.2, 0.8], atol=0.02)
