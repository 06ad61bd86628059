"""Joining of pieces over occluded areas, and pieces that must not be joined."""

from dataclasses import replace

import numpy as np
import pytest
from room import Board, Room, Screen
from shapely import MultiPolygon, Polygon, box
from surface_maps import above_floor, overlap, poses_at

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.records import SurfaceCloud
from tccm_ros.surfaces.merging.joining import _coplanar, occluded_area_between
from tccm_ros.surfaces.merging.merged_surface import MergedSurface
from tccm_ros.surfaces.merging.merging import NumberedPatch
from tccm_ros.surfaces.surface_map import SurfaceMap
from tccm_ros.surfaces.views.views import SurfacePatch

SIDEBOARD = Board(1.6, 0.0, 0.5, 1.6, 0.75)
POST = Screen(1.2, -0.09, 1.2, 0.09, 1.8)
"""Hides a strip right across the sideboard."""

HALVES = [Board(1.6, -0.475, 0.5, 0.65, 0.75), Board(1.6, 0.475, 0.5, 0.65, 0.75)]
"""Two tables in place of the sideboard, with a gap of 0.3 m."""


def build(records, poses, walls=None):
    surface_map = SurfaceMap(Config())
    for record in records:
        surface_map.add(record)
    return surface_map.build(poses_at(spatial(np.array(poses, float))), walls)


def look(room, *poses, walls=None):
    records = [r for k, pose in enumerate(poses) for r in room.look(pose, 10 * k + 10)]
    return above_floor(build(records, poses, walls))


def test_a_board_that_a_post_hides_in_part_is_joined():
    (found,) = look(Room([SIDEBOARD], [POST]), (0, 0, 0))
    assert overlap(found, SIDEBOARD) >= 0.85
    assert len(found.merged_ids) == 1


def test_tables_with_a_gap_that_was_looked_through_are_two():
    assert len(look(Room(HALVES), (0, 0, 0))) == 2


def test_a_hidden_gap_is_joined_until_a_view_looks_through_it():
    room = Room(HALVES, [Screen(1.2, -0.14, 1.2, 0.14, 1.8)])
    assert len(look(room, (0, 0, 0))) == 1
    assert len(look(room, (0, 0, 0), (3.2, 0.0, np.pi))) == 2


def test_a_gap_that_was_looked_through_before_the_board_came_is_joined():
    """Two views before the sideboard came; then its middle is hidden."""
    room = Room([SIDEBOARD], [POST])
    records = [r for k in range(2) for r in Room([]).look((0.1 * k, 0.3 * k, 0.0), 10 * k + 10)]
    records += [*room.look((0, 0, 0), 30)]
    (found,) = above_floor(build(records, [(0, 0, 0), (0.1, 0.3, 0), (0, 0, 0)]))
    assert overlap(found, SIDEBOARD) >= 0.85


def test_surfaces_unseen_since_the_other_appeared_are_not_joined():
    """One half is hidden when the other comes: it may be there no more."""
    gap = Screen(1.2, -0.14, 1.2, 0.14, 1.8)
    first = Room([HALVES[0]], [gap])
    then = Room([HALVES[1]], [gap, Screen(1.0, -1.0, 1.0, -0.1, 1.8)])
    records = [*first.look((0, 0, 0), 10), *then.look((0, 0, 0), 20)]
    assert len(above_floor(build(records, [(0, 0, 0)] * 2))) == 2
    whole = Room(HALVES, [gap])
    records = [*first.look((0, 0, 0), 10), *whole.look((0, 0, 0), 20)]
    assert len(above_floor(build(records, [(0, 0, 0)] * 2))) == 1


def lines(*ys, x=(1.3, 1.9), z=0.75):
    """A view of a board in three scan lines, each a surface of its own."""
    xs = np.arange(*x, 0.01)
    rows = [np.column_stack([xs, y + 0.004 * np.sin(97.0 * xs), np.full(len(xs), z)]) for y in ys]
    surfaces = np.repeat(np.arange(len(ys), dtype=np.uint32), len(xs))
    return SurfaceCloud(10, "base", np.concatenate(rows).astype(np.float32), surfaces)


@pytest.mark.parametrize(("ys", "count"), [((0.0, 0.07, 0.14), 1), ((0.0, 0.3, 0.6), 0)])
def test_scan_lines_beside_each_other_are_one_surface(ys, count):
    """A line has no area; a few that are no further than merging allows have one together."""
    found = build([lines(*ys)], [(0, 0, 0)]).surfaces
    assert len(found) == count


def test_tables_of_one_height_on_two_sides_of_a_wall_are_two():
    room = Room(HALVES, [Screen(1.2, -0.14, 1.2, 0.14, 1.8)])
    behind = np.array([[[1.8, -1.0], [1.8, 1.0]]])
    between = np.array([[[0.5, 0.0], [2.5, 0.0]]])
    elsewhere = np.array([[[3.0, 0.0], [5.0, 0.0]]])
    for walls, count in ((behind, 1), (elsewhere, 1), (between, 2)):
        assert len(look(room, (0, 0, 0), walls=walls)) == count


def test_tables_of_different_heights_with_a_hidden_gap_are_two():
    lower = Board(1.6, 0.475, 0.5, 0.65, 0.71)
    found = look(Room([HALVES[0], lower], [POST]), (0, 0, 0))
    assert sorted(round(s.height, 2) for s in found) == [0.71, 0.75]


def strip(x, z, stamp, slope=0.0):
    """Return a cloud of a floor 2 m wide over a range of x, nothing looked through."""
    xs, ys = (axis.ravel() for axis in np.meshgrid(np.arange(*x, 0.03), np.arange(-1, 1, 0.03)))
    points = np.column_stack([xs, ys, z + slope * (xs - x[0])]).astype(np.float32)
    return SurfaceCloud(stamp, "base", points, np.zeros(len(points), np.uint32))


def floors(*strips):
    """Return the floors that strips make, those of one stamp being one view."""
    clouds = {}
    for cloud in strips:
        before = clouds.get(cloud.stamp_ns)
        if before is not None:
            surface = np.full(len(cloud.points), before.surface.max() + 1, np.uint32)
            points = np.concatenate([before.points, cloud.points])
            surface = np.concatenate([before.surface, surface])
            cloud = SurfaceCloud(cloud.stamp_ns, "base", points, surface)
        clouds[cloud.stamp_ns] = cloud
    mapped = build(clouds.values(), [(0.0, 0.0, 0.0)] * len(clouds))
    return [s for s in mapped.surfaces if s.label == "floor"]


@pytest.mark.parametrize("stamp", [1, 2])
def test_a_floor_with_a_step_over_a_missing_strip_is_one(stamp):
    (floor,) = floors(strip((0.5, 1.5), 0.0, 1), strip((1.7, 3.0), 0.045, stamp))
    assert floor.area == pytest.approx(2.0 * 2.5, rel=0.05)


def test_floors_with_a_wide_gap_are_two():
    assert len(floors(strip((0.5, 1.5), 0.0, 1), strip((2.2, 3.0), 0.0, 1))) == 2


def test_a_platform_on_the_floor_is_not_the_floor():
    assert len(floors(strip((0.5, 1.5), 0.0, 1), strip((1.52, 3.0), 0.045, 1))) == 2


def test_a_floor_that_two_views_put_at_two_heights_is_one():
    # The first is tilted down by 5 deg, the second begins horizontal where that is 0.1 m too low.
    low, high = strip((0.5, 2.9), 0.05, 1, -0.0875), strip((2.0, 4.0), 0.0, 2)
    assert len(floors(low, high)) == 1


def level_piece(x, height, view):
    """Return a level piece of 0.2 m around (x, 0) that one view has seen, flat but for 0.1 mm."""
    mean, cov, none = np.array([x, 0.0, height]), np.diag([0.01, 0.01, 1e-8]), MultiPolygon()
    exact = np.diag([1e-8, 1e-8, 1e-8])
    patch = SurfacePatch(
        np.zeros((0, 3), "f4"), np.zeros(0, "i4"), 1000, mean, cov, none, 0.02, exact
    )
    square = Polygon([(x - 0.1, -0.1), (x + 0.1, -0.1), (x + 0.1, 0.1), (x - 0.1, 0.1)])
    members = (NumberedPatch(0, view, patch),)
    return MergedSurface.of_moments(members, square, 1000.0, mean, cov)


@pytest.mark.parametrize(
    ("step", "view", "is_one"),
    [
        # Flatness alone, 1.3 mm on either side, gives 3 * sqrt(2) * 1.3 = 5.5 mm in one view.
        (0.005, 0, True),
        (0.006, 0, False),
        # With 4 mm of either view's height it is 3 * sqrt(2 * (1.3^2 + 4^2)) = 17.8 mm.
        (0.0175, 1, True),
        (0.0185, 1, False),
    ],
)
def test_heights_of_two_views_differ_within_their_pose_covariance(step, view, is_one):
    poses = np.array([np.eye(4)] * 2)
    cov_z_roll_pitch = np.array([np.diag([0.004**2, 0.0, 0.0])] * 2)
    is_coplanar = _coplanar(poses, cov_z_roll_pitch, Config())
    one, other = level_piece(1.0, 0.7, 0), level_piece(1.4, 0.7 + step, view)
    assert is_coplanar(one, other, np.array([1.2, 0.0])) == is_one


def test_an_area_between_pieces_touches_both():
    """The larger notch of one piece joins nothing: the other piece would not be in the union."""
    one, other = (level_piece(x, 0.7, 0) for x in (0.4, 1.5))
    notch = box(0.2, -0.1, 0.6, 0.4)
    one = replace(one, polygon=box(0.0, 0.0, 0.8, 0.8) - notch)
    other = replace(other, polygon=box(0.9, 0.3, 1.7, 0.5))
    area = occluded_area_between(one, other, [], np.zeros((0, 4, 4)), Config())
    assert area is not None
    assert not area.intersects(notch.buffer(-0.01))
    assert area.distance(one.polygon) < 1e-3
    assert area.distance(other.polygon) < 1e-3
