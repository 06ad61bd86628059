"""Horizontal planes by labels of neighbours as published (IV.A): `planes.detector: neighbours`.

Two cuboids in cells that are among their eight neighbours get the same label if their tops u differ
by less than `planes.height_threshold`. A group of one label is a horizontal plane at the mean of
its u. If a single tilt cycle leaves empty cells between its scan lines, a surface is split into
strips, as by the printed rule; the labels of `planes.horizontal_clusters` adapt to the spacing of
the samples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Int32, Int64
from tccm_ros.baselines.plane_fits import fits_of_groups
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, Cuboids, cell_keys
from tccm_ros.kernels import kernel
from tccm_ros.planes import PlaneFits
from tccm_ros.union_find import find_root, merge_sets

UP = np.array([0.0, 0.0, 1.0])
"""Normal of all planes."""

HALF_OF_EIGHT = np.array([[0, 1], [1, -1], [1, 0], [1, 1]])
"""Steps to those neighbouring cells that follow in the order of cells."""


def label_neighbours(cuboids: Cuboids, height_threshold: float) -> Int64:
    """Label cuboids by their eight neighbours: the paper's `cls`.

    Parameters
    ----------
    cuboids
        The map.
    height_threshold
        Maximum difference of the tops in a group, m.

    Returns
    -------
    int64 (N,)
        Label from 0, in the order of each group's first cuboid.
    """
    keys = cell_keys(cuboids.ix, cuboids.iy)
    steps = cell_keys(*HALF_OF_EIGHT.T)
    root = _merge_neighbours(keys, cuboids.top, steps, height_threshold * TICKS_PER_M)
    return np.unique(root, return_inverse=True)[1].reshape(-1)


@kernel
def _merge_neighbours(keys: Int64, top: Int32, steps: Int64, threshold: float) -> Int64:
    """Return the first cuboid of each cuboid's group; keys (N,) are ascending."""
    n = len(keys)
    parent = np.arange(n)
    for step in steps:
        begin = 0
        for i in range(n):
            while begin < n and keys[begin] < keys[i] + step:
                begin += 1
            j = begin
            while j < n and keys[j] == keys[i] + step:
                if abs(top[i] - top[j]) < threshold:
                    merge_sets(parent, i, j)
                j += 1
    for i in range(n):
        parent[i] = find_root(parent, i)
    return parent


def find_neighbour_planes(cuboids: Cuboids, config: Config, viewpoint: ArrayLike) -> PlaneFits:
    """Find the horizontal planes of a map by the labels of neighbours.

    A plane is at the mean u of its cuboids, regardless of their depth. Groups with fewer points
    than `planes.min_points`, or with a cell area below `planes.min_area`, are dropped.

    Parameters
    ----------
    cuboids, config, viewpoint
        As in `find_planes`, which it replaces.
    """
    labels = label_neighbours(cuboids, config.planes.height_threshold)
    cells = np.bincount(labels) if len(labels) else np.zeros(0, np.int64)
    groups = []
    for label in np.flatnonzero(cells * cuboids.cell_size**2 >= config.planes.min_area):
        members = np.flatnonzero(labels == label)
        groups.append((members, UP, float(cuboids.top[members].mean()) * TICK))
    return fits_of_groups(points_at_tops(cuboids), groups, config, viewpoint)


def points_at_tops(cuboids: Cuboids) -> Cuboids:
    """Return cuboids with each point moved up to its cuboid's top: x and y stay, z is u."""
    u = cuboids.top.astype(float)
    s, S = cuboids.s.copy(), cuboids.S.copy()
    S[:, 2], S[:, 4], S[:, 5] = s[:, 0] * u, s[:, 1] * u, cuboids.count * u**2
    s[:, 2] = cuboids.count * u
    return replace(cuboids, s=s, S=S)
