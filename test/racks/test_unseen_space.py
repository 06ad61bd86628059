"""Space below surfaces that no beam passed."""

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from outlined_surfaces import surface
from shapely import affinity, box

from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.geometry import inverse, transform
from tccm_ros.racks.compartment import SeenView
from tccm_ros.racks.unseen_space import boxes_of, unseen_spaces
from tccm_ros.scene.planning_shapes import UNSEEN_PREFIX, scene_shapes

CELL = 0.05  # m, edge of a cell: half a column of free space

TABLE, COUNTER = (0.0, 0.0, 1.2, 0.8), (2.0, 0.0, 3.2, 0.6)
EYE = np.array([0.6, -2.0, 0.4])
NO_HITS = np.zeros((0, 4))


def looking_through(x, y, z):
    """Return a view of beams that pass a box and end behind it."""
    ends = np.array(
        [
            [a, y[1] + 0.4, EYE[2] + (b - EYE[2]) * (y[1] + 0.4 - EYE[1]) / (y[1] - EYE[1])]
            for a in np.arange(*x, 0.02)
            for b in np.arange(*z, 0.02)
        ]
    )
    xs = EYE[0] + (ends[:, 0] - EYE[0]) * (ends[:, 1] - EYE[1]) / (y[1] - EYE[1])
    hits = np.column_stack([xs, ends[:, 1], ends[:, 2] - 0.01, ends[:, 2] + 0.01])
    return SeenView(np.eye(4), EYE, hits, FreeColumns.of(None, 0.1))


def nothing_seen():
    return SeenView(np.eye(4), EYE, NO_HITS, FreeColumns.of(None, 0.1))


def contains(spaces, points):
    """Return which points are in one of the boxes."""
    found = np.zeros(len(points), bool)
    for space in spaces:
        local = np.abs(transform(inverse(space.T_map_space), points))
        found |= (local <= 0.5 * space.size + 1e-9).all(axis=1)
    return found


def below(outline, height, count=4000):
    """Return points between the floor and a surface, 1 cm inside."""
    low_x, low_y, high_x, high_y = outline.bounds
    points = np.random.default_rng(0).uniform(
        [low_x, low_y, 0.01], [high_x, high_y, height - 0.01], (count, 3)
    )
    return points[shapely.contains_xy(outline.buffer(-0.01), *points[:, :2].T)]


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_boxes_fill_all_cells_and_each_once(seed, filled):
    cells = np.random.default_rng(seed).random((5, 4, 3)) < filled
    count = np.zeros(cells.shape, int)
    for low, size in boxes_of(cells):
        count[tuple(map(slice, low, low + size))] += 1
    np.testing.assert_array_equal(count, cells)


def test_all_space_below_a_surface_that_was_not_looked_at_is_unseen():
    """It ends at the edges of furniture that stands oblique, at the floor, and at the top."""
    outline = affinity.rotate(box(*COUNTER), 20)
    spaces = unseen_spaces([surface(outline, height=0.9)], [nothing_seen()], 0.0)
    assert len(spaces) == 1
    assert contains(spaces, below(outline, 0.9)).all()
    np.testing.assert_allclose(np.sort(spaces[0].size), [0.6, 0.9, 1.2], atol=1e-9)


def test_the_space_that_beams_passed_is_free():
    table = surface(box(*TABLE), height=0.74)
    view = looking_through((-0.3, 0.7), (TABLE[1], TABLE[3]), (-0.2, 0.9))
    spaces = unseen_spaces([table], [view], 0.0)
    points = below(box(*TABLE), 0.74)
    behind = EYE[0] + (points[:, 0] - EYE[0]) * (0.8 - EYE[1]) / (points[:, 1] - EYE[1])
    found = contains(spaces, points)
    middle = (points[:, 2] > 0.1) & (points[:, 2] < 0.64)
    assert not found[middle & (behind < 0.6) & (points[:, 0] > 2 * CELL)].any()
    assert found[behind > 0.7 + 2 * CELL].all()


def test_space_below_two_surfaces_belongs_to_the_lower_one():
    upper, lower = surface(box(*TABLE), height=1.2, number=5), surface(box(*TABLE), height=0.5)
    spaces = unseen_spaces([upper, lower], [nothing_seen()], 0.0)
    tops = {s.surface: s.T_map_space[2, 3] + 0.5 * s.size[2] for s in spaces}
    lows = {s.surface: s.T_map_space[2, 3] - 0.5 * s.size[2] for s in spaces}
    assert sorted(tops) == [3, 5]
    assert tops[3] <= 0.5 + 1e-9 <= lows[5] + CELL
    assert tops[5] <= 1.2 + 1e-9


def test_the_planning_scene_has_the_boxes_under_names_of_their_own():
    table = surface(box(*TABLE))
    spaces = unseen_spaces([table], [nothing_seen()], 0.0)
    shapes = scene_shapes([table], [], unseen=spaces)
    assert set(shapes) - set(scene_shapes([table], [])) == {f"{UNSEEN_PREFIX}3_0"}
    np.testing.assert_array_equal(shapes[f"{UNSEEN_PREFIX}3_0"].size, spaces[0].size)
