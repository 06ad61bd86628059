"""Disjoint sets for kernels: a forest of parents in one array, initially ``arange(n)``.

scipy's `DisjointSet` cannot be used in a compiled loop, and `connected_components` needs the list
of all links in advance; here links are found and sets merged in one pass.
"""

from __future__ import annotations

from typing import Any

from tccm_ros.kernels import kernel


@kernel
def find_root(parent: Any, i: int) -> int:
    """Return the root of element i, halving its path.

    Parameters
    ----------
    parent
        int32 or int64 (N,), parent of each element; a root is its own parent.
    i
        Element, 0 <= i < N.
    """
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def merge_sets(parent: Any, i: int, j: int) -> None:
    """Merge the sets of elements i and j under the smaller of their roots.

    Parameters
    ----------
    parent
        As in `find_root`; changed in place.
    i, j
        Elements, 0 <= i, j < N.
    """
    a, b = parent[i], parent[j]
    if a == b:
        return
    a, b = find_root(parent, a), find_root(parent, b)
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b
