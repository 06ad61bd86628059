"""Marginal covariances of a sparse graph: the blocks of the full inverse, for any structure."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csc_matrix

from tccm_ros.slam.graph.marginals import Information


def random_graph(seed: int, variables: int, loops: int):
    """A chain of variables of 3 or 6 columns with loops and one prior, many entries zero."""
    random = np.random.default_rng(seed)
    dims = random.choice([3, 6], variables)
    starts = np.concatenate([[0], np.cumsum(dims)])
    pairs = [(i, i + 1) for i in range(variables - 1)]
    pairs += [tuple(random.choice(variables, 2, replace=False)) for _ in range(loops)]
    rows = [np.zeros((6, starts[-1]))]
    rows[0][: dims[0], : dims[0]] = np.diag(random.uniform(0.5, 2.0, dims[0]))
    for a, b in pairs:
        block = np.zeros((6, starts[-1]))
        block[: dims[a], starts[a] : starts[a + 1]] = -np.diag(random.uniform(1.0, 9.0, dims[a]))
        block[: dims[b], starts[b] : starts[b + 1]] = np.diag(random.uniform(1.0, 9.0, dims[b]))
        block[0, starts[b]] += 0.3
        rows.append(block)
    # What no factor of a variable reaches would not be determined.
    rows.append(np.diag(random.uniform(0.01, 0.1, starts[-1])))
    return np.concatenate(rows), dims, starts


@given(st.integers(0, 2**32 - 1), st.integers(2, 30), st.integers(0, 20))
def test_marginal_blocks_are_those_of_the_full_inverse(seed, variables, loops):
    A, dims, starts = random_graph(seed, variables, loops)
    full = np.linalg.inv(A.T @ A)
    blocks = Information(csc_matrix(A), dims).marginal_blocks()
    for block, a, b in zip(blocks, starts[:-1], starts[1:], strict=True):
        np.testing.assert_allclose(block, full[a:b, a:b], rtol=1e-7, atol=1e-9 * full.max())


@given(st.integers(0, 2**32 - 1), st.integers(2, 30), st.integers(0, 20))
def test_a_gradient_is_solved_as_by_the_full_inverse(seed, variables, loops):
    A, dims, starts = random_graph(seed, variables, loops)
    gradient = np.random.default_rng(seed).normal(size=int(starts[-1]))
    expected = np.linalg.solve(A.T @ A, gradient)
    found = Information(csc_matrix(A), dims).solve(gradient)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())


def test_an_undetermined_variable_is_an_error():
    A = np.diag([1.0, 1.0, 1.0, 0.0, 1.0, 1.0])
    with pytest.raises(RuntimeError):
        Information(csc_matrix(A), np.array([3, 3]))
