"""Patches of vertical planes: steps along the plane, runs of steps, pools of cuboids.

Each is done again in plain Python, one cuboid after the other.
"""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.planes.arrays import PlaneMap
from tccm_ros.planes.vertical_patches import NO_RIM, bins_along, link_vertical, pool_patches

GAP_STEPS = 2.0  # mean distances of occupied bins: one bin may be missing
RIM_DEPTH = 40  # ticks: 4 mm, by which a horizontal surface varies from cell to cell
STEPS = 32  # cells: steps of this many or more are no links

SEEDS = st.integers(0, 2**32 - 1)


def random_board(seed, holes=0.4):
    """Return cells, heights, members and plane of a board with gaps, cut into cuboids."""
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(-math.pi, math.pi)
    normal = np.array([math.cos(yaw), math.sin(yaw)])
    steps = np.flatnonzero(rng.random(60) > holes * rng.random())
    steps = steps[(steps < 20) | (steps > 20 + rng.integers(0, 30))]
    middle = 50.0 * normal + (steps[:, None] - 30.0) * [-normal[1], normal[0]]
    middle = np.repeat(middle, rng.integers(1, 4, len(middle)), axis=0)
    cells = np.rint(middle + rng.integers(-1, 2, (len(middle), 1)) * normal).astype(np.int32)
    bottom = rng.integers(0, 12, len(cells)).astype(np.int32) * 100
    top = bottom + rng.integers(1, 5, len(cells)).astype(np.int32) * 60
    members = rng.permutation(len(cells))[: max(2, int(0.9 * len(cells)))].astype(np.int32)
    plane = (*normal.tolist(), 0.1, 1.0, 1e-6)
    return cells, bottom, top, members, plane, rng


def steps_of(cells, members, plane):
    """The steps of cells along a plane, counted from that of the lowest middle."""
    direction = np.array([-plane[1], plane[0]]) / math.hypot(plane[0], plane[1])
    along = cells[members] @ direction
    return [math.floor(a - along.min() + 0.5) for a in along]


@given(SEEDS)
def test_steps_are_as_wide_as_a_cell(seed):
    cells, _, _, members, plane, _ = random_board(seed)
    bins, count = bins_along(cells[:, 0], cells[:, 1], members, plane)
    expected = steps_of(cells, members, plane)
    assert bins.tolist() == expected
    assert count == max(expected) + 1


@given(SEEDS)
def test_runs_end_at_gaps_of_twice_the_mean_distance(seed):
    cells, _, _, members, plane, _ = random_board(seed)
    step = steps_of(cells, members, plane)
    used = sorted(set(step))
    distances = [min(b - a, STEPS) for a, b in itertools.pairwise(used)]
    limit = GAP_STEPS * max(sum(distances) / max(len(distances), 1), 1.0)
    run, runs = {used[0]: 0}, 0
    for a, b in itertools.pairwise(used):
        runs += b - a >= limit
        run[b] = runs
    of_member = [run[s] for s in step]
    expected = [of_member.index(r) for r in of_member]
    assert link_vertical(cells[:, 0], cells[:, 1], members, plane).tolist() == expected


@pytest.mark.parametrize(("missing", "sets"), [(1, 1), (2, 2), (3, 2)])
def test_one_step_may_be_missing_in_a_dense_board(missing, sets):
    y = np.concatenate([np.arange(10), np.arange(10 + missing, 20 + missing)]).astype(np.int32)
    members = np.arange(20, dtype=np.int32)
    root = link_vertical(np.full(20, 7, np.int32), y, members, (1.0, 0.0, 0.0, 0.15, 1e-6))
    assert len(set(root.tolist())) == sets


@given(SEEDS)
def test_pools_are_of_cuboids_that_overlap_in_a_step(seed):
    """Without caps; the highest pool of a step is a rim unless it ends far below the usual top."""
    cells, bottom, top, members, plane, rng = random_board(seed)
    M = rng.uniform(1.0, 2.0, (len(cells), 10))
    none = np.zeros(0, np.int32), np.zeros((0, 10))
    ix, iy = cells[:, 0].copy(), cells[:, 1].copy()
    cuboids = PlaneMap(M, ix, iy, bottom, top, *none, 200.0, 1e-4, np.zeros(3))
    pooled, rim = pool_patches(cuboids, members, plane)
    pools, tops = pooled_by_hand(cells, bottom, top, members, plane)
    assert pooled == pytest.approx(np.array([M[pool].sum(axis=0) for pool in pools]))
    low = np.median([t for t in tops if t is not None]) - RIM_DEPTH
    assert rim.tolist() == [NO_RIM if t is None or t < low else t for t in tops]


def pooled_by_hand(cells, bottom, top, members, plane):
    """Return the pools of each step from below, their members, and the top of the highest."""
    step = steps_of(cells, members, plane)
    pools, highest = [], []
    for s in sorted(set(step)):
        of_step = sorted((m for m, t in zip(members, step) if t == s), key=lambda m: bottom[m])
        groups, high = [], -math.inf
        for m in of_step:
            if high < bottom[m]:
                groups.append([])
            groups[-1].append(m)
            high = max(high, top[m])
        pools += groups
        highest += [None] * (len(groups) - 1) + [high]
    return pools, highest
