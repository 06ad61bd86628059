"""Horizontal surfaces by clustering of cuboids (the paper's IV.A), for scans with gaps.

The paper gives neighbouring cells the same label `cls` if their tops differ by less than 10 mm. At
cells of 20 mm a single tilt cycle leaves empty cells between its scan lines, so that plain
8-neighbours break a table into strips. Here the neighbourhood follows the local sample spacing, see
`cuboids.linking`.
"""

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.cuboids.cuboids import TICKS_PER_M, Cuboids
from tccm_ros.cuboids.linking import link
from tccm_ros.kernels import kernel

MIN_CUBOIDS = 4
"""Minimum number of cuboids of a cluster with a label; chosen."""


def label_horizontal(cuboids: Cuboids, height_threshold: float = 0.010) -> Int32:
    """Return labels of the horizontal surfaces of a map.

    Parameters
    ----------
    cuboids
        The map.
    height_threshold
        Neighbours within twice the local sample spacing get one label if their tops or their mean
        heights differ by less, m: the mean is less noisy, the top is equal in an edge cell and its
        neighbours.

    Returns
    -------
    int32 (N,)
        Label from 0, in the order of each cluster's first cuboid; -1 for clusters of fewer than
        `MIN_CUBOIDS`.
    """
    if len(cuboids) == 0:
        return np.full(0, -1, np.int32)
    threshold = height_threshold * TICKS_PER_M
    c = cuboids
    return _label(c.ix, c.iy, c.top, c.s, c.count, threshold)


@kernel
def _label(ix: Int32, iy: Int32, top: Int32, s: Float64, count: Float64, threshold: float) -> Int32:
    """Return labels (N,) of the sets that `linking.link` connects."""
    return _number(link(ix, iy, top, _mean_heights(s, count), threshold)[0])


@kernel(error_model="numpy")
def _mean_heights(s: Float64, count: Float64) -> Int32:
    """Return the mean height of each cuboid, ticks."""
    mean = np.empty(len(count), np.int32)
    for i in range(len(count)):
        mean[i] = np.int32(np.rint(s[i, 2] / count[i]))
    return mean


@kernel
def _number(root: Int32) -> Int32:
    """Return labels from 0 for set representatives (the smallest index of each set)."""
    n = len(root)
    size = np.zeros(n, np.int32)
    for i in range(n):
        size[root[i]] += 1
    labels = np.empty(n, np.int32)
    used = 0
    for i in range(n):
        r = root[i]
        if r == i:
            labels[i] = used if size[i] >= MIN_CUBOIDS else -1
            used += size[i] >= MIN_CUBOIDS
        else:
            labels[i] = labels[r]
    return labels
