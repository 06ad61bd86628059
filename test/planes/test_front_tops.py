"""Points of tops in cuboids of fronts and walls: brute force, walls, gaps, boards."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.planes.arrays import PLANE
from tccm_ros.planes.fits import PlaneFits
from tccm_ros.planes.front_tops import on_walls, top_planes

ABOVE = 0.03  # m above the top, of a front that ends there: the depth of a cuboid
BEFORE = 0.3  # m, from the wall, of points of a board: three distances of scan lines
GATE = 3.0  # sigmas: 99.7 % of all measurements

CELL, HEIGHT, RMS = 0.02, 0.80, 0.002
TOP, FRONT, SLOPE = 0, 1, 2
BEFORE_FRONT, OVER_TOP = np.array([-1.0, 0.0, 1.5]), np.array([1.0, 0.0, 1.5])
PLANES = [
    ([0.0, 0.0, 1.0], HEIGHT),
    ([1.0, 0.0, 0.0], 0.0),
    ([0.8, 0.0, 0.6], 0.6 * HEIGHT),
]
"""Normals and offsets of `TOP`, `FRONT` and `SLOPE`."""


def fits_of(cells, tops, labels, bottoms=None, planes=PLANES):
    """Return the planes of cuboids in `cells`, each with the plane of its label."""
    cells = np.asarray(cells, np.int32).reshape(-1, 2)
    n = len(cells)
    top, bottom = (
        np.rint(np.asarray(z) * 1e4).astype(np.int32)
        for z in (tops, np.full(n, HEIGHT - 0.1) if bottoms is None else bottoms)
    )
    ix, iy = cells.T.copy()
    sums = np.ones(n), np.zeros((n, 3)), np.zeros((n, 6))
    cycles = np.zeros(n, np.int32), np.arange(n + 1)
    rows = np.zeros(len(planes), PLANE)
    rows["normal"], rows["offset"] = [n for n, _ in planes], [offset for _, offset in planes]
    rows["variances"] = 1.0, 1.0, RMS**2
    cuboids = Cuboids(CELL, ix, iy, bottom, top, *sums, *cycles)
    return PlaneFits(cuboids, np.asarray(labels, np.int32), rows, np.zeros(3))


def block(front_top=HEIGHT, gap=0, front=FRONT):
    """Return the planes of a block whose top begins `gap` cells behind the cells of its front."""
    iy = np.arange(20)
    cells = [(0, y) for y in iy] + [(x, y) for x in range(1 + gap, 6 + gap) for y in iy]
    tops = [front_top] * 20 + [HEIGHT] * 100
    return fits_of(cells, tops, [front] * 20 + [TOP] * 100)


def block_points(rng, count=500):
    """Return points of the front and the top, and the cuboid of each."""
    y, z = rng.uniform(0.0, 20 * CELL, count), rng.uniform(HEIGHT - 0.1, HEIGHT + 0.004, count)
    front = np.column_stack([rng.uniform(0.0, CELL, count), y, z])
    top = np.column_stack(
        [np.zeros((100, 2)), np.full(100, HEIGHT)]
    )  # of which only the cell counts
    cuboids = np.concatenate([np.floor(y / CELL).astype(np.int64), np.arange(20, 120)])
    return np.concatenate([front, top]), cuboids


def found(fits, points, cuboids, own=True, in_line=True, viewpoint=BEFORE_FRONT):
    labels = fits.labels[cuboids]
    surface = np.where((labels == TOP) & own, TOP, -1).astype(np.int64)
    lines = np.full(len(points), in_line)
    return top_planes(points, cuboids, labels, surface, lines, fits[:1], fits, viewpoint)


def test_the_topmost_points_of_a_front_are_of_the_top_and_no_others():
    points, cuboids = block_points(np.random.default_rng(1))
    is_top = (np.abs(points[:, 2] - HEIGHT) <= GATE * RMS) & (cuboids < 20)
    assert 10 < is_top.sum() < 200
    np.testing.assert_array_equal(found(block(), points, cuboids), np.where(is_top, TOP, -1))


@pytest.mark.parametrize(
    "fits", [block(front_top=HEIGHT + ABOVE + 0.01), block(gap=1), block(front=SLOPE)]
)
def test_higher_walls_slopes_and_distant_fronts_have_no_points_of_the_top(fits):
    points, cuboids = block_points(np.random.default_rng(2))
    assert (found(fits, points, cuboids) == -1).all()


@pytest.mark.parametrize("in_line", [False, True])
@pytest.mark.parametrize("gap", [0, 1])
def test_points_before_a_wall_are_of_the_top_that_reaches_it(gap, in_line):
    """Points of the wall, too, if they are nearer to the top; scan lines are left as they are."""
    rng = np.random.default_rng(7)
    fits = block(front_top=HEIGHT + 0.5, gap=gap)
    y = rng.uniform(0.0, 20 * CELL, 400)
    top = np.column_stack([rng.uniform(0.0, CELL, 200), y[:200], rng.normal(HEIGHT, RMS, 200)])
    wall = np.column_stack([rng.normal(0.0, RMS, 200), y[200:], rng.normal(HEIGHT, 0.02, 200)])
    c = fits.cuboids
    own = np.column_stack(
        [(c.ix[20:] + 0.5) * CELL, (c.iy[20:] + 0.5) * CELL, np.full(100, HEIGHT)]
    )
    points = np.concatenate([top, wall, own])
    cuboids = np.concatenate([np.floor(y / CELL).astype(np.int64), np.arange(20, 120)])
    height = np.abs(points[:, 2] - HEIGHT)
    is_top = (height <= GATE * RMS) & (points[:, 0] > height) & (cuboids < 20)
    assert is_top[:200].sum() > 150 > 50 > is_top[200:].sum()
    expected = np.where(is_top & (gap == 0) & (not in_line), TOP, -1)
    planes = found(fits, points, cuboids, in_line=in_line, viewpoint=OVER_TOP)
    np.testing.assert_array_equal(planes, expected)
    assert (found(fits, points, cuboids, in_line=in_line, viewpoint=BEFORE_FRONT) == -1).all()


def test_a_top_whose_points_are_all_in_the_noise_of_a_wall_is_not_at_it():
    points, cuboids = block_points(np.random.default_rng(8))
    fits = block(front_top=HEIGHT + 0.5)
    points[cuboids >= 20, 0] = 0.9 * GATE * RMS
    assert (found(fits, points, cuboids, in_line=False, viewpoint=OVER_TOP) == -1).all()


def test_a_front_too_low_for_a_plane_is_one_where_points_are_dense():
    points, cuboids = block_points(np.random.default_rng(4))
    fits = block(front=-1)
    is_top = (np.abs(points[:, 2] - HEIGHT) <= GATE * RMS) & (cuboids < 20)
    assert (found(fits, points, cuboids, in_line=True) == -1).all()
    expected = np.where(is_top, TOP, -1)
    np.testing.assert_array_equal(found(fits, points, cuboids, in_line=False), expected)


def test_clutter_at_the_height_of_a_top_without_a_front_below_is_not_of_it():
    points, cuboids = block_points(np.random.default_rng(5))
    fits = block(front=-1)
    fits.cuboids.bottom[:20] = round((HEIGHT - RMS) * 1e4)
    assert (found(fits, points, cuboids, in_line=False) == -1).all()


@pytest.mark.parametrize("gap", [0.3, 0.02])
def test_the_front_of_a_board_above_is_no_wall(gap):
    """In one cell there are the fronts of both boards; with a gap of 2 cm they are one wall."""
    points, cuboids = block_points(np.random.default_rng(6))
    own = block()
    c, iy = own.cuboids, np.arange(20)
    fits = fits_of(
        np.concatenate([np.column_stack([c.ix, c.iy]), np.column_stack([0 * iy, iy])]),
        np.concatenate([c.top * 1e-4, np.full(20, HEIGHT + gap + 0.02)]),
        np.concatenate([own.labels, np.full(20, FRONT)]),
        np.concatenate([c.bottom * 1e-4, np.full(20, HEIGHT + gap)]),
    )
    is_top = (np.abs(points[:, 2] - HEIGHT) <= GATE * RMS) & (cuboids < 20)
    expected = np.where(is_top & (gap > ABOVE), TOP, -1)
    np.testing.assert_array_equal(found(fits, points, cuboids, in_line=False), expected)
    assert (found(fits, points, cuboids, in_line=True) == -1).all()


def test_points_of_fronts_alone_make_no_surface():
    """The map knows the top, but no point of this view is on it."""
    points, cuboids = block_points(np.random.default_rng(3))
    assert (found(block(), points, cuboids, own=False) == -1).all()


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_each_point_is_judged_by_its_cell_and_the_eight_around_it(seed):
    rng = np.random.default_rng(seed)
    cells = np.unique(rng.integers(-4, 4, (30, 2)), axis=0)
    tops = rng.uniform(HEIGHT - 0.1, HEIGHT + 0.1, len(cells))
    bottoms = tops - rng.uniform(0.0, 0.2, len(cells))
    labels = rng.integers(-1, 3, len(cells))
    fits = fits_of(cells, tops, labels, bottoms)
    cuboids = rng.integers(0, len(cells), 60)
    surface = np.where((labels[cuboids] == TOP) & (rng.random(60) < 0.5), TOP, -1)
    in_line = rng.random(60) < 0.5
    z = rng.normal(HEIGHT, 2.0 * GATE * RMS, 60)
    points = np.column_stack([(cells[cuboids] + rng.random((60, 2))) * CELL, z])
    labels_of, x = fits.labels[cuboids], points[:, 0]
    planes = top_planes(points, cuboids, labels_of, surface, in_line, fits[:1], fits, OVER_TOP)
    own = cells[cuboids[surface == TOP]]
    clear = cells[cuboids[(surface == TOP) & (x > GATE * RMS)]]
    slack, limit = GATE * RMS, HEIGHT + ABOVE
    bottoms, tops = fits.cuboids.bottom * 1e-4, fits.cuboids.top * 1e-4
    for point, k, line, plane, is_own in zip(points, cuboids, in_line, planes, surface == TOP):
        near, off = np.abs(cells - cells[k]).max(axis=1) <= 1, abs(point[2] - HEIGHT)
        goes_on = near & (labels == FRONT) & (tops > limit) & (line | (bottoms <= limit))
        if goes_on.any():
            beside = (np.abs(clear - cells[k]).max(axis=1, initial=0) <= 1).any()
            is_top = labels[k] == FRONT and not line and point[0] > off and beside
        else:
            is_top = line or (bottoms[k] < HEIGHT - slack and tops[k] <= limit)
        may_be = (labels[k] == FRONT or (labels[k] == -1 and not line)) and not is_own
        beside = (np.abs(own - cells[k]).max(axis=1, initial=0) <= 1).any()
        assert plane == (TOP if may_be and off <= slack and beside and is_top else -1)


def test_the_front_of_a_tilted_top_is_no_wall_at_its_high_end():
    """Over 2 m a top that is tilted by 0.05 is higher by 10 cm, three times `ABOVE`."""
    iy = np.arange(100)
    y = (iy + 0.5) * CELL
    z = HEIGHT + 0.05 * y
    cells = np.concatenate([np.column_stack([k + 0 * iy, iy]) for k in (0, 1)])
    labels, normal = [FRONT] * 100 + [TOP] * 100, np.array([0.0, -0.05, 1.0]) / np.hypot(0.05, 1.0)
    planes = [(normal, HEIGHT * normal[2]), *PLANES[1:]]
    fits = fits_of(cells, np.tile(z, 2), labels, np.tile(z - 0.1, 2), planes)
    points = np.concatenate([np.column_stack([k * CELL + 0.01 + 0 * y, y, z]) for k in (0, 1)])
    expected = np.repeat([TOP, -1], 100)
    np.testing.assert_array_equal(found(fits, points, np.arange(200)), expected)


def test_boards_with_fronts_in_the_same_cells_have_their_own_points():
    lower, upper, iy = HEIGHT, HEIGHT + 0.3, np.arange(20)
    cells = np.concatenate([np.column_stack([k + 0 * iy, iy]) for k in (0, 0, 1, 1)])
    tops = np.repeat([lower, upper, lower, upper], 20)
    labels = np.repeat([-1, -1, TOP, 3], 20)
    fits = fits_of(cells, tops, labels, tops - 0.02, [*PLANES, ([0.0, 0.0, 1.0], upper)])
    points = np.column_stack([(cells + 0.5) * CELL, tops])
    surface = np.where(labels >= 0, labels, -1).astype(np.int64)
    dense = np.zeros(80, bool)
    planes = top_planes(
        points, np.arange(80), fits.labels, surface, dense, [fits[0], fits[3]], fits, BEFORE_FRONT
    )
    np.testing.assert_array_equal(planes, np.repeat([TOP, 3, -1, -1], 20))


# -- points of walls at the height of a board ------------------------------------------------------


def board_at_wall(wall_top=HEIGHT + 1.5, end=50):
    """Return planes of a wall of 100 cells and of a board before its first `end` ones."""
    wall = [(0, y) for y in range(100)]
    board = [(x, y) for x in range(1, 20) for y in range(end)]
    tops = [wall_top] * len(wall) + [HEIGHT] * len(board)
    return fits_of(wall + board, tops, [FRONT] * len(wall) + [TOP] * len(board))


def line_and_board(rng, end=50, count=3000):
    """Return points of a line on the wall, of which each cell has three, and of the board."""
    line = np.arange(300)
    on_wall = np.column_stack([rng.uniform(0.0, RMS, 300), CELL * line / 3, np.full(300, HEIGHT)])
    x, y = rng.integers(1, 20, count), rng.integers(0, end, count)
    on_board = np.column_stack([CELL * (x + 0.5), CELL * (y + 0.5), np.full(count, HEIGHT)])
    return np.concatenate([on_wall, on_board]), np.concatenate([line // 3, 100 + (x - 1) * end + y])


@given(st.integers(0, 10_000), st.integers(20, 80))
@settings(max_examples=20)
def test_a_board_keeps_its_rear_and_loses_the_line_on_the_wall_beside_it(seed, end):
    points, cuboids = line_and_board(np.random.default_rng(seed), end)
    gone = on_walls(points, cuboids, np.zeros(len(points), np.int64), board_at_wall(end=end))
    y = points[:, 1] / CELL
    assert not gone[y < end - 1].any()
    assert gone[(y > end + 2) & (points[:, 0] < CELL)].all()


def test_points_of_another_height_or_far_from_the_wall_do_not_make_a_board():
    rng = np.random.default_rng(0)
    points, cuboids = line_and_board(rng)
    is_line = points[:, 0] < CELL
    for moved in (np.array([0.0, 0.0, 2.0 * ABOVE]), np.array([BEFORE + CELL, 0.0, 0.0])):
        shifted = points + ~is_line[:, None] * moved
        fits = board_at_wall()
        if moved[0]:
            fits.cuboids.ix[fits.labels == TOP] += round(moved[0] / CELL)
        assert on_walls(shifted, cuboids, np.zeros(len(points), np.int64), fits)[is_line].all()


def test_the_top_of_a_block_keeps_its_front_edge():
    points, cuboids = line_and_board(np.random.default_rng(0))
    fits = board_at_wall(HEIGHT + 0.5 * ABOVE)
    assert not on_walls(points, cuboids, np.zeros(len(points), np.int64), fits).any()
    none = np.full(len(points), -1)
    assert not on_walls(points, cuboids, none, board_at_wall()).any()
