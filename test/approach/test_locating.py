"""Where a surface is now, from what a tilting laser sees of it."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from approach_world import SimulatedBase, circle, mapped_target, rectangle, simple_flat

from tccm_ros.approach.locating import is_elsewhere, locate, top_points
from tccm_ros.approach.speeds import Speeds
from tccm_ros.geometry import compose2, inverse2, transform2, wrap_angle


def seen(flat):
    """Return one tilt cycle, the mapped target in odom, and the pose of map in odom."""
    base = SimulatedBase(flat, np.random.default_rng(5))
    while base.readings().cycle is None:
        base.tick(Speeds())
    cycle = base.readings().cycle
    in_odom = inverse2(flat.start)
    mapped = mapped_target(flat).moved(in_odom)
    return cycle, mapped, in_odom


@pytest.mark.parametrize("top", [rectangle(1.4, 0.8), circle(0.5)])
@pytest.mark.parametrize("move", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.5), (-0.1, 0.45, -0.5)])
def test_a_surface_is_found_where_it_was_pushed_to(top, move):
    flat = simple_flat(top, move, (-1.3, 0.1, 0.1))
    cycle, mapped, in_odom = seen(flat)
    found = locate([cycle], mapped, [])
    assert found is not None
    true = shapely.Polygon(flat.target.top)
    outline = shapely.Polygon(found.moved(inverse2(in_odom)).outline)
    assert outline.intersection(true).area / outline.union(true).area > 0.93
    if not flat.is_round:
        assert abs(wrap_angle(found.pose[2] - mapped.pose[2] - move[2])) < np.radians(3.0)
    assert is_elsewhere(cycle, mapped, []) == (np.abs(move).max() > 0.0)


def test_nothing_is_found_where_the_surface_is_gone():
    cycle, mapped, _ = seen(simple_flat(rectangle(1.4, 0.8)))
    empty = replace(cycle, points=cycle.points[cycle.points[:, 2] < 0.1])
    assert locate([empty], mapped, []) is None
    assert not is_elsewhere(empty, mapped, [])


@pytest.mark.parametrize(
    "top",
    [
        circle(0.2),
        circle(0.3),
        rectangle(0.4, 1.4),
    ],
)
def test_nothing_is_found_where_a_smaller_surface_stands(top):
    flat = simple_flat(rectangle(1.4, 0.8))
    flat.target = simple_flat(top).target
    cycle, mapped, _ = seen(flat)
    assert locate([cycle], mapped, []) is None
    assert is_elsewhere(cycle, mapped, [])


def test_fit_of_a_surface_partly_out_of_view_uses_the_visible_part():
    flat = simple_flat(rectangle(1.4, 0.8), (0.2, 0.1, 0.0), (-1.3, 0.1, 0.1))
    cycle, mapped, in_odom = seen(flat)
    ahead = cycle.points[:, 0] < 1.5
    found = locate([replace(cycle, points=cycle.points[ahead])], mapped, [])
    assert found is not None
    motion = compose2(found.pose, inverse2(mapped.pose))
    assert motion[:2] == pytest.approx(transform2([0, 0, in_odom[2]], [[0.2, 0.1]])[0], abs=0.05)


def test_points_of_another_height_and_within_other_surfaces_are_left_out():
    flat = simple_flat(rectangle(1.4, 0.8))
    cycle, mapped, _ = seen(flat)
    assert len(top_points(cycle.points, mapped, []))
    assert not len(top_points(cycle.points, mapped, [mapped.outline]))
    floor = np.zeros((10, 3))
    assert not len(top_points(floor, mapped, []))
