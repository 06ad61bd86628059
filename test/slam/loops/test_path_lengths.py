import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.slam.loops.path_lengths import lengths_from

KEYFRAMES = 12
PAIRS = st.tuples(st.integers(0, KEYFRAMES - 1), st.integers(0, KEYFRAMES - 1))
# Loop closures join keyframes that the chain does not.
LOOPS = st.dictionaries(PAIRS.filter(lambda x: x[0] < x[1] - 1), st.floats(0.1, 5.0))


@given(
    st.lists(st.floats(0.01, 5.0), min_size=KEYFRAMES, max_size=KEYFRAMES),
    st.sets(st.integers(1, KEYFRAMES - 1), max_size=2),
    LOOPS,
    st.integers(0, KEYFRAMES - 1),
)
def test_path_lengths_are_those_of_relaxation_until_nothing_changes(steps, starts, loops, start):
    steps = np.array(steps)
    steps[[0, *starts]] = np.inf
    edges = [(k - 1, k, steps[k]) for k in range(1, KEYFRAMES)]
    edges += [(a, b, length) for (a, b), length in loops.items()]
    expected = np.full(KEYFRAMES, np.inf)
    expected[start] = 0.0
    for _ in range(KEYFRAMES):
        for a, b, length in edges:
            expected[a] = min(expected[a], expected[b] + length)
            expected[b] = min(expected[b], expected[a] + length)
    assert lengths_from(start, steps, loops) == pytest.approx(expected)
