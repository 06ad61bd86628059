"""The map's cuboid at each cuboid of a part map, against a plain search."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.cuboids.cuboids import cell_keys
from tccm_ros.cuboids.merging import owners


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(0, 40))
def test_owner_is_the_highest_cuboid_of_the_cell_that_does_not_begin_above(seed, cells, parts):
    rng = np.random.default_rng(seed)
    rows = []
    for x, y in {tuple(c) for c in rng.integers(-3, 3, (cells, 2)).tolist()}:
        edges = np.sort(rng.choice(60, 2 * rng.integers(1, 4), replace=False)) - 30
        rows += [(x, y, low, high) for low, high in edges.reshape(-1, 2)]
    ix, iy, bottom, top = np.array(sorted(rows), np.int32).T
    inside = np.sort(rng.integers(0, len(ix), parts))
    low = bottom[inside] + rng.integers(0, 30, parts) % (top - bottom)[inside]
    order = np.lexsort((low, inside))
    inside, low = inside[order], low[order]
    bounds = np.stack([low, top[inside]], axis=1).astype(np.int32)
    found = owners(ix, iy, bottom, cell_keys(ix[inside], iy[inside]), bounds)
    np.testing.assert_array_equal(found, inside)
