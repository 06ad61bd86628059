"""Ceilings: boards above a board with their lower sides, and lower sides without a surface."""

import numpy as np
import pytest
import shapely

from tccm_ros.racks.ceilings import BoardAbove, ceilings
from tccm_ros.racks.compartment import FaceState

MAX_BOARD = 0.04  # m, thickness of the thickest boards, for an underside without points
MAX_HEIGHT = 1.0  # m, of a compartment: higher spaces are open from above

BOARD = shapely.box(-0.5, -0.2, 0.5, 0.2)
NOTHING = np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3))


def seen_from(x, y, z, count):
    """Return the position of the sensor for each of several hits."""
    return np.repeat([[x, y, z]], count, axis=0)


def lower_side(z, x=(-0.5, 0.5), y=(-0.2, 0.2)):
    """Return hits of beams from below on a lower side."""
    grid = np.array([[a, b, z] for a in np.arange(*x, 0.05) for b in np.arange(*y, 0.05)])
    return grid, np.full(len(grid), 0.002), seen_from(0.0, -1.5, 0.1, len(grid))


def front(top, thickness):
    """Return hits of beams from above on the front of a board, one for each cube along it, and of
    as many beams that passed just below it."""
    x = np.arange(-0.48, 0.5, 0.04)
    ends = np.column_stack([x, np.full(len(x), -0.2), np.full(len(x), top - 0.5 * thickness)])
    origins = seen_from(0.0, -1.5, 1.2, len(x))
    passed = ends - [0.0, 0.0, 0.5 * thickness]
    behind = origins + 1.2 * (passed - origins)
    half = np.repeat([0.5 * thickness, 0.0], len(x))
    return np.concatenate([ends, behind]), half, np.concatenate([origins, origins])


def test_front_of_a_board_above_gives_its_underside():
    (found,) = ceilings(BOARD, [BoardAbove(BOARD, 0.35, 7)], *front(0.35, 0.02))
    assert (found.above, found.state) == (7, FaceState.MEASURED)
    assert found.height == pytest.approx(0.33)


def test_hits_that_also_have_points_of_the_top_do_not_lower_a_lower_side():
    """The middle of their points is behind the front, whose lower end they have as well."""
    ends, half, origins = front(0.35, 0.02)
    ends[::2, 1] += 0.04
    (found,) = ceilings(BOARD, [BoardAbove(BOARD, 0.35, 7)], ends, half, origins)
    assert found.height == pytest.approx(0.33)


def test_a_lower_side_that_was_not_measured_is_unknown_and_taken_to_be_low():
    (found,) = ceilings(BOARD, [BoardAbove(BOARD, 0.35, 7)], *NOTHING)
    assert (found.state, found.height) == (FaceState.UNKNOWN, 0.35 - MAX_BOARD)


def test_a_cupboard_over_a_part_of_a_counter_is_above_that_part_alone():
    part = shapely.box(0.0, -0.05, 0.5, 0.2)
    (found,) = ceilings(BOARD, [BoardAbove(part, 0.6, 3)], *NOTHING)
    np.testing.assert_allclose([found.low, found.high], [[0.0, -0.05], [0.5, 0.2]], atol=1e-9)


def test_the_lowest_of_two_boards_above_is_the_ceiling():
    boards = [BoardAbove(BOARD, 0.8, 2), BoardAbove(BOARD, 0.4, 1)]
    assert [c.above for c in ceilings(BOARD, boards, *NOTHING)] == [1]


def test_a_corner_of_a_board_has_no_ceiling():
    """Of a board that a table hides in part: the bounds of the rest are not the board's faces."""
    corner = shapely.Polygon([(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5)])
    above = [BoardAbove(shapely.box(-0.5, -0.5, 0.5, 0.5), 0.6, 3)]
    assert list(ceilings(corner, above, *NOTHING)) == []


def test_slivers_beside_a_board_above_are_no_parts():
    boards = [BoardAbove(BOARD, 0.8, 2), BoardAbove(BOARD.buffer(-0.03), 0.4, 1)]
    assert [c.above for c in ceilings(BOARD, boards, *NOTHING)] == [1]


def test_underside_without_a_surface_is_a_ceiling_if_seen_from_below():
    ends, half, origins = lower_side(0.5)
    found, *_ = ceilings(BOARD, [], ends, half, origins)
    assert (found.above, found.state) == (-1, FaceState.MEASURED)
    assert found.height == pytest.approx(0.5)
    from_above = seen_from(0.0, -1.5, 1.1, len(ends))
    states = [c.state for c in ceilings(BOARD, [], ends, half, from_above)]
    assert FaceState.MEASURED not in states


def test_hits_along_an_edge_may_be_the_front_of_a_board_without_a_surface():
    (found,) = ceilings(BOARD, [], *front(0.35, 0.02))
    assert (found.above, found.state, found.height) == (-1, FaceState.UNKNOWN, MAX_HEIGHT)
    ends, half, origins = (part[:6] for part in front(0.35, 0.02))
    assert list(ceilings(BOARD, [], ends, half, origins)) == []


def test_a_small_lower_side_is_none():
    assert list(ceilings(BOARD, [], *lower_side(0.5, x=(0.0, 0.15), y=(0.0, 0.15)))) == []


def test_small_underside_seen_by_many_views_lowers_no_ceiling():
    """Its hits are more than those of the ceiling, but cover less."""
    small = [np.concatenate(30 * [a]) for a in lower_side(0.46, x=(-0.5, 0.5), y=(0.12, 0.16))]
    assert list(ceilings(BOARD, [], *small)) == []
    both = (np.concatenate(parts) for parts in zip(small, lower_side(0.5)))
    found, *_ = ceilings(BOARD, [], *both)
    assert found.height == pytest.approx(0.5)
