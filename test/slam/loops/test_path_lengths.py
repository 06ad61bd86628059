import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from tccm_ros.slam.loops.path_lengths import lengths_from

KEYFRAMES = 12
LOOPS = st.lists(st.tuples(st.integers(0, KEYFRAMES - 1), st.integers(0, KEYFRAMES - 1)))


@given(
    st.lists(st.floats(0.01, 5.0), min_size=KEYFRAMES, max_size=KEYFRAMES),
    st.sets(st.integers(1, KEYFRAMES - 1), max_size=2),
    LOOPS,
    st.lists(st.floats(0.1, 5.0), min_size=3, max_size=3),
    st.integers(0, KEYFRAMES - 1),
)
def test_path_lengths_are_those_of_dijkstras_algorithm(steps, starts, loops, some, start):
    steps = np.array(steps)
    steps[[0, *starts]] = np.inf
    loops = np.array([x for x in loops if x[0] != x[1]], np.int64).reshape(-1, 2)
    loop_lengths = np.resize(some, len(loops))
    weights = np.full((KEYFRAMES, KEYFRAMES), np.inf)
    for k in range(1, KEYFRAMES):
        weights[k - 1, k] = steps[k]
    for (a, b), length in zip(loops, loop_lengths):
        weights[min(a, b), max(a, b)] = min(weights[min(a, b), max(a, b)], length)
    edges = np.argwhere(np.isfinite(weights))
    graph = coo_matrix((weights[tuple(edges.T)], tuple(edges.T)), shape=weights.shape)
    expected = dijkstra(graph.tocsr(), directed=False, indices=start)
    assert lengths_from(start, steps, loops, loop_lengths) == pytest.approx(expected)
