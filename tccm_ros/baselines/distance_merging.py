"""Merging as published (surface mapping, IV.B): surfaces with points within a distance are merged.

It is used with the baseline ``surfaces.segmentation: seed``. Heights are not compared, so that
everything within the distance above a surface is merged with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Float64, Int64


def merge_by_distance(clouds: Sequence[Float64], distance: float) -> Int64:
    """Merge clouds that have points within a distance of each other.

    Parameters
    ----------
    clouds
        P of float64 (N, 3) in one frame, m; none is empty.
    distance
        Merging distance, m.

    Returns
    -------
    int64 (P,)
        Index of the first cloud of each cloud's surface.
    """
    trees = [cKDTree(cloud) for cloud in clouds]
    touching = [
        (a, b)
        for a, b in combinations(range(len(trees)), 2)
        if np.all(trees[a].mins <= trees[b].maxes + 2.0 * distance)
        and np.all(trees[b].mins <= trees[a].maxes + 2.0 * distance)
        and trees[a].count_neighbors(trees[b], distance) > 0
    ]
    pairs = np.array(touching, np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(trees), len(trees)))
    _, surface = connected_components(graph, directed=False)
    _, first = np.unique(surface, return_index=True)
    return np.asarray(first[surface], np.int64)
