"""Objects: what stands on a surface, and nothing of what carries it or goes on upwards."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICKS_PER_M, Cuboids
from tccm_ros.planes import find_planes
from tccm_ros.planes.tracking import PlaneTracker
from tccm_ros.tabletop.objects import find_objects

CELL = 0.02
STEP = 0.01
"""Spacing of the points that are made, m."""


def sheet(x, y, z):
    """Points of a level rectangle, float64 (N, 3), m."""
    xs, ys = np.meshgrid(np.arange(*x, STEP) + 1e-3, np.arange(*y, STEP) + 1e-3)
    return np.column_stack([xs.ravel(), ys.ravel(), np.full(xs.size, z)])


def box(x, y, z):
    """Points of the top and the four sides of a box."""
    sides = []
    for level in np.arange(*z, STEP):
        ring = sheet(x, y, level)
        rim = (
            (ring[:, 0] < x[0] + STEP) | (ring[:, 0] > x[1] - STEP)
            | (ring[:, 1] < y[0] + STEP) | (ring[:, 1] > y[1] - STEP)
        )  # fmt: skip
        sides.append(ring[rim])
    return np.concatenate([*sides, sheet(x, y, z[1])])


def cuboids_of(points, depth=0.03):
    """Cuboids by the definition: the union of [z - depth, z] in each cell."""
    ticks = np.rint(points * TICKS_PER_M).astype(np.int64)
    cell = round(CELL * TICKS_PER_M)
    d = round(depth * TICKS_PER_M)
    groups = {}
    for point in ticks:
        groups.setdefault((point[0] // cell, point[1] // cell), []).append(point)
    rows = []
    for (ix, iy), members in sorted(groups.items()):
        members = np.array(sorted(members, key=lambda p: p[2]))
        for part in np.split(members, np.flatnonzero(np.diff(members[:, 2]) > d) + 1):
            local = (part - [ix * cell, iy * cell, 0]).astype(float)
            S = [local[:, i] @ local[:, j] for i in range(3) for j in range(i, 3)]
            rows.append((ix, iy, part[0, 2] - d, part[-1, 2], len(part), *local.sum(0), *S))
    table = np.array(rows, float)
    n = len(table)
    return Cuboids(
        CELL,
        *table[:, :4].astype(np.int32).T,
        table[:, 4],
        table[:, 5:8],
        table[:, 8:],
        np.zeros(n, np.int32),
        np.arange(n + 1),
    )


def scene(*parts, noise=0.001):
    points = np.concatenate(parts)
    points = points + np.random.default_rng(3).normal(0.0, noise, points.shape)
    cuboids = cuboids_of(points)
    config = Config()
    fits = find_planes(cuboids, config, np.array([-1.0, 0.0, 1.5]))
    planes = PlaneTracker(config).update(fits)
    return planes, find_objects(cuboids, fits, planes, config)


FLOOR = sheet((0.0, 2.0), (-1.0, 1.0), 0.0)
TABLE = sheet((0.6, 1.4), (-0.5, 0.5), 0.7)


def test_a_box_on_a_table_is_one_object_of_its_size():
    planes, objects = scene(FLOOR, TABLE, box((0.9, 1.1), (0.0, 0.1), (0.71, 0.85)))
    [item] = objects
    assert not item.is_round
    table = next(p for p in planes if p.id == item.plane)
    assert table.offset == pytest.approx(0.7, abs=0.005)
    assert item.center == pytest.approx([1.0, 0.05, 0.775], abs=0.015)
    assert sorted(item.size[:2]) == pytest.approx([0.1, 0.2], abs=0.03)
    assert item.size[2] == pytest.approx(0.15, abs=0.01)


@pytest.mark.parametrize("seen", [np.pi, 1.2 * np.pi, 2 * np.pi])
def test_a_can_of_which_half_was_seen_is_a_cylinder_of_its_diameter(seen):
    angle, z = np.meshgrid(np.arange(-0.5 * seen, 0.5 * seen, 0.1), 0.71 + np.arange(15) * STEP)
    can = np.stack([1.0 + 0.1 * np.cos(angle), 0.1 + 0.1 * np.sin(angle), z], axis=2)
    [item] = scene(FLOOR, TABLE, can.reshape(-1, 3))[1]
    assert item.is_round
    assert item.center[:2] == pytest.approx([1.0, 0.1], abs=0.012)
    corner = np.sqrt(0.5) * CELL  # of a cell outside of an oblique side
    assert 0.2 - STEP < item.size[0] == item.size[1] < 0.2 + 2.0 * corner + STEP


def test_legs_carry_the_table_and_are_no_objects():
    legs = [
        box((x, x + 0.05), (y, y + 0.05), (0.0, 0.69)) for x in (0.62, 1.32) for y in (-0.48, 0.42)
    ]
    assert scene(FLOOR, TABLE, *legs)[1] == []


def test_a_pillar_and_a_wall_are_no_objects():
    pillar = box((0.2, 0.3), (0.7, 0.8), (0.0, 1.8))
    wall = box((1.9, 1.92), (-1.0, 1.0), (0.0, 2.0))
    assert scene(FLOOR, pillar, wall)[1] == []


def test_a_box_before_a_wall_is_separate_from_the_wall():
    wall = box((1.9, 1.92), (-1.0, 1.0), (0.0, 2.0))
    crate = box((1.5, 1.8), (0.2, 0.5), (0.0, 0.25))
    [item] = scene(FLOOR, wall, crate)[1]
    assert item.center[:2] == pytest.approx([1.65, 0.35], abs=0.02)


def test_boxes_that_touch_are_two_where_their_heights_differ():
    low, high = box((0.8, 1.0), (-0.1, 0.1), (0.7, 0.8)), box((1.0, 1.2), (-0.1, 0.1), (0.7, 0.95))
    _, objects = scene(FLOOR, TABLE, low, high)
    heights = sorted(item.size[2] for item in objects)
    np.testing.assert_allclose(heights, [0.1, 0.25], atol=0.01)
    for item in objects:
        np.testing.assert_allclose(sorted(item.size[:2]), 0.2, atol=0.03)


def test_boxes_that_touch_are_one_where_their_heights_are_the_same():
    pair = [box((x, x + 0.2), (-0.1, 0.1), (0.7, 0.8)) for x in (0.8, 1.0)]
    assert len(scene(FLOOR, TABLE, *pair)[1]) == 1


def test_back_and_arm_of_a_seat_are_two_boxes_that_leave_it_free():
    seat = sheet((0.0, 1.1), (0.0, 0.6), 0.42)
    back, arm = ((0.0, 1.1), (0.5, 0.6)), ((0.0, 0.1), (0.0, 0.5))
    objects = scene(FLOOR, seat, *(box(*plan, (0.43, 0.6)) for plan in (back, arm)))[1]
    (long, thick), (other_long, other_thick) = (item.size[:2] for item in objects)
    assert [thick, other_thick] == pytest.approx([0.1, 0.1], abs=0.03)
    # The last points of a box are a step before its end, and the cut is between cells.
    assert long + other_long == pytest.approx(1.6 - 2 * STEP, abs=2 * CELL)


def test_two_visible_sides_of_a_box_are_one_object():
    sides = [
        sheet(x, y, z)
        for z in np.arange(0.71, 0.95, STEP)
        for x, y in (((0.9, 0.91), (0.0, 0.3)), ((0.9, 1.2), (0.0, 0.01)))
    ]
    hidden = (TABLE[:, 0] > 0.91) & (TABLE[:, 1] > 0.01)
    [item] = scene(FLOOR, TABLE[~hidden], *sides)[1]
    assert item.size[:2] == pytest.approx([0.3, 0.3], abs=0.15)
