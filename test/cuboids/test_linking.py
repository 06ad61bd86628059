"""Links between cuboids of one height, against a search through all pairs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.cuboids.linking import find_links, link, link_in_plane, spacing

OBSTACLES = 3  # occupied cells without a neighbour, after which a search ends
STEPS = 32  # cells: steps of this many or more are no links


def cells(seed, n, wide, heights):
    """Return sorted cells with the heights of their cuboids, each at most once."""
    rng = np.random.default_rng(seed)
    rows = np.unique(rng.integers((-wide, -wide, 0), (wide, wide, heights), (n, 3)), axis=0)
    ix, iy, z = (np.ascontiguousarray(k, np.int32) for k in rows.T)
    return ix, iy, z * np.int32(100)


def nearest(along, across, z, i):
    """Return the distance to the nearest cell behind i in its line that holds its height."""
    line = (across == across[i]) & (along < along[i]) & (along[i] - along < STEPS)
    occupied = np.sort(np.unique(along[line]))[::-1][:OBSTACLES]
    for cell in occupied:
        if (line & (along == cell) & (abs(z - z[i]) < 50)).any():
            return along[i] - cell
    return -1


@given(st.integers(0, 10_000), st.integers(1, 150), st.integers(1, 40), st.integers(1, 4))
@settings(deadline=None, max_examples=60)
def test_links_lead_to_the_nearest_of_the_same_height(seed, n, wide, heights):
    ix, iy, z = cells(seed, n, wide, heights)
    far = np.arange(len(ix), dtype=np.int32) * 1000  # means that decide nothing
    back_x, back_y, touching = find_links(ix, iy, z, far, 50.0)
    for i, j in touching:
        assert (j < i) & (z[j] == z[i])
        assert max(ix[i] - ix[j], abs(iy[i] - iy[j])) < 2
    for i in range(len(ix)):
        assert nearest(ix, iy, z, i) == (ix[i] - ix[back_x[i]] if back_x[i] >= 0 else -1)
        assert nearest(iy, ix, z, i) == (iy[i] - iy[back_y[i]] if back_y[i] >= 0 else -1)
        for j in (back_x[i], back_y[i]):
            assert j < 0 or z[j] == z[i]


@given(st.integers(0, 10_000), st.integers(1, 150))
@settings(deadline=None, max_examples=40)
def test_sets_are_labelled_by_their_first_cuboid_and_hold_all_linked_ones(seed, n):
    ix, iy, z = cells(seed, n, 8, 2)
    far = np.arange(len(ix), dtype=np.int32) * 1000
    root, back_x, back_y = link(ix, iy, z, far, 50.0)
    assert (root <= np.arange(len(root))).all()
    np.testing.assert_array_equal(root[root], root)
    for back in (back_x, back_y):
        np.testing.assert_array_equal(root[back >= 0], root[back[back >= 0]])
    # Touching cells of one height are always together.
    for i in range(len(ix)):
        near = (abs(ix - ix[i]) <= 1) & (abs(iy - iy[i]) <= 1) & (z == z[i])
        assert (root[near] == root[i]).all()


@given(st.integers(0, 10_000), st.integers(1, 150), st.integers(1, 20), st.integers(1, 3))
@settings(deadline=None, max_examples=60)
def test_links_in_a_plane_are_those_of_one_height(seed, n, wide, heights):
    # Cells may hold several cuboids of one plane.
    ix, iy, _ = cells(seed, n, wide, heights)
    level = np.zeros(len(ix), np.int32)
    root, back_x, back_y = link(ix, iy, level, level, 1.0)
    root_in_plane, deep = link_in_plane(ix, iy)
    np.testing.assert_array_equal(root_in_plane, root)
    np.testing.assert_array_equal(deep, two_links_inside(back_x, back_y))


def two_links_inside(back_x, back_y):
    """Return which have links both ways along both axes, and neighbours that have them too."""
    n = len(back_x)
    linked = [set() for _ in range(n)]
    for axis, back in enumerate((back_x, back_y)):
        for i in np.flatnonzero(back >= 0):
            linked[i].add((axis, "back", back[i]))
            linked[back[i]].add((axis, "on", i))
    inside = [len({(a, way) for a, way, _ in links}) == 4 for links in linked]
    return [inside[i] and all(inside[j] for _, _, j in linked[i]) for i in range(n)]


@given(st.lists(st.integers(0, STEPS - 1), max_size=40))
def test_the_spacing_is_the_mean_of_steps_without_the_long_ones(steps):
    """Those up to one and a half times the median, rounded up; of two medians the lower one."""
    histogram = np.bincount(np.array(steps, int), minlength=STEPS).astype(np.int32)
    if len(steps) < 4:
        assert spacing(histogram, 7.0) == 7.0
        return
    median = sorted(steps)[(len(steps) - 1) // 2]
    kept = [step for step in steps if step <= np.ceil(1.5 * median)]
    assert spacing(histogram, 7.0) == pytest.approx(np.mean(kept))


def sets_of(cells):
    ix, iy = np.ascontiguousarray(np.unique(cells, axis=0).T, np.int32)
    return len(np.unique(link_in_plane(ix, iy)[0]))


@pytest.mark.parametrize("corner", [0, 7, 13])
def test_scan_lines_that_noise_spreads_over_two_cells_are_one_set(corner):
    """Five lines, five cells from line to line, on a far table."""
    rng = np.random.default_rng(1)
    rows = corner + 5 * np.arange(5)[:, None] + rng.integers(0, 2, (5, 40))
    assert sets_of(np.column_stack([rows.ravel(), np.tile(np.arange(40), 5)])) == 1


@pytest.mark.parametrize("corner", range(16))
@pytest.mark.parametrize("width", [8, 20])
def test_dense_boards_with_a_gap_between_them_are_two_sets(corner, width):
    """Wherever the gap is in the patches in which the spacing is estimated."""
    rows = np.r_[corner : corner + width, corner + width + 6 : corner + 2 * width + 6]
    cells = np.stack(np.meshgrid(rows, np.arange(40)), axis=-1).reshape(-1, 2)
    assert sets_of(np.vstack([cells, [0, 99]])) == 3
