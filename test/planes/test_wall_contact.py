"""Points of a wall that were taken for a board, against a plain search over all points."""

from types import SimpleNamespace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.planes.wall_contact import ABOVE, BEFORE, MAX_DISTANCE, lie_on_walls

CELL, HEIGHT = 0.02, 0.75


def walled(length, top):
    """Return the planes of a wall x = 0 that is seen from x > 0, its cells filled up to `top`."""
    cells = round(length / CELL)
    cuboids = SimpleNamespace(
        cell_size=CELL,
        ix=np.zeros(cells, np.int32),
        iy=np.arange(cells, dtype=np.int32),
        top=np.full(cells, round(top * 1e4), np.int32),
    )
    wall = SimpleNamespace(normal=np.array([1.0, 0.0, 0.0]), offset=0.0, rms=0.0)

    class Fits(list):
        pass

    fits = Fits([wall])
    fits.cuboids, fits.labels = cuboids, np.zeros(cells, np.int32)
    return fits, np.array([True, False])


def board_and_line(rng, board_end):
    """Return points of a board that ends at the wall, and of a line that runs on along the wall."""
    board = np.column_stack(
        [rng.uniform(0.0, 0.4, 3000), rng.uniform(0.0, board_end, 3000), np.full(3000, HEIGHT)]
    )
    line = np.linspace(0.0, 2.0, 300)
    wall = np.column_stack([np.full(300, 0.004), line, np.full(300, HEIGHT)])
    return np.concatenate([board, wall])


@given(st.integers(0, 10_000), st.floats(0.4, 1.5))
@settings(deadline=None, max_examples=30)
def test_a_board_keeps_its_rear_and_loses_the_line_on_the_wall_beside_it(seed, end):
    points = board_and_line(np.random.default_rng(seed), end)
    fits, stands = walled(2.0, 2.4)
    gone = lie_on_walls(points, np.zeros(len(points), np.int64), fits, stands)
    assert not gone[points[:, 1] < end - 2 * CELL].any()
    at_wall = points[:, 0] <= MAX_DISTANCE - 1e-9
    np.testing.assert_array_equal(gone[points[:, 1] > end + 2 * CELL], True)
    assert at_wall[gone].all()


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=30)
def test_only_points_without_surface_points_before_them_are_removed(seed):
    rng = np.random.default_rng(seed)
    n = 200
    place = rng.permutation(4 * 90)[:n]  # one point in a cell
    x = np.array([0.005, 0.05, 0.21, 0.51])[place % 4]
    points = np.column_stack([x, 0.11 + CELL * (place // 4), np.full(n, HEIGHT)])
    surface = np.where(rng.random(n) < 0.3, rng.integers(0, 3, n), -1)
    fits, stands = walled(2.0, 2.4)
    gone = lie_on_walls(points, surface, fits, stands)
    cells = np.floor(points[:, :2] / CELL).astype(int)
    for k in range(n):
        own = (surface >= 0) & (points[:, 0] > MAX_DISTANCE)
        ahead = abs(cells[:, 0] - cells[k, 0])
        before = own & (ahead <= int(BEFORE / CELL) + 1) & (abs(cells[:, 1] - cells[k, 1]) <= 1)
        expected = surface[k] >= 0 and points[k, 0] <= MAX_DISTANCE and not before.any()
        assert gone[k] == expected


def test_the_top_of_a_block_keeps_its_front_edge():
    points = board_and_line(np.random.default_rng(0), 1.0)
    fits, stands = walled(2.0, HEIGHT + ABOVE - 0.005)
    assert not lie_on_walls(points, np.zeros(len(points), np.int64), fits, stands).any()


def test_without_walls_or_points_nothing_is_removed():
    fits, stands = walled(2.0, 2.4)
    points = board_and_line(np.random.default_rng(0), 1.0)
    none = np.array([False, False])
    assert not lie_on_walls(points, np.zeros(len(points), np.int64), fits, none).any()
    assert lie_on_walls(points[:0], np.zeros(0, np.int64), fits, stands).shape == (0,)
