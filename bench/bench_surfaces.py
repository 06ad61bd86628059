"""How fast surfaces re-merge after an optimisation, against kd-trees; no assertion, a table.

python bench/bench_surfaces.py
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tccm_ros.surfaces.merging.contact import connect, near_pairs
from tccm_ros.surfaces.merging.patch_planes import PatchPlanes

SURFACES, POINTS, DISTANCE, STEP = 1000, 2000, 0.05, 0.03

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]


def scene(size: float, seed: int = 0) -> list[Float64]:
    """Boards of 1.2 x 0.8 m at three heights, strewn over `size` x `size` m."""
    rng = np.random.default_rng(seed)
    half = np.array([0.6, 0.4, 0.003])
    parts = []
    for _ in range(SURFACES):
        middle = np.array([*rng.uniform(0.0, size, 2), rng.choice([0.40, 0.75, 0.90])])
        parts.append(middle + rng.uniform(-half, half, (POINTS, 3)))
    return parts


def horizontal_planes(clouds: list[Float64]) -> PatchPlanes:
    """Return the planes of horizontal boards, each seen by a view of its own."""
    middle = np.array([cloud.mean(axis=0) for cloud in clouds])
    cov = np.tile(np.diag(np.square([0.005, 0.005, 0.005])), (len(middle), 1, 1))
    fit, none = np.tile(np.diag([0.001**2, 0.003**2, 0.003**2]), (len(middle), 1, 1)), 0.0 * cov
    return PatchPlanes(np.arange(len(middle)), middle, np.zeros((len(middle), 2)), fit, none, cov)


def by_grids(clouds: list[Float64], planes: PatchPlanes) -> Int64:
    """Merge as the surface map does, with the heights where surfaces meet."""
    return connect(clouds, planes, DISTANCE, STEP)


def by_trees(clouds: list[Float64]) -> Int64:
    """Merge with a kd-tree for each surface and the same boxes and components."""
    trees: dict[int, cKDTree] = {}
    root = np.arange(len(clouds))
    for q, p in near_pairs(clouds, DISTANCE):
        if root[q] == root[p]:
            continue
        for k in (q, p):
            if k not in trees:
                trees[k] = cKDTree(clouds[k][:, :2])
        distances, _ = trees[q].query(trees[p].data, distance_upper_bound=DISTANCE * (1 + 1e-9))
        if np.any(distances <= DISTANCE):
            root[root == max(root[q], root[p])] = min(root[q], root[p])
    return root


def median(run: Callable[[], object], times: int) -> float:
    seconds = []
    for _ in range(times):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return float(np.median(seconds))


def main() -> None:
    print(f"### Merging {SURFACES} surfaces of {POINTS} points at {DISTANCE} m; medians\n")
    print("| area | ours, s | kd-trees, s | ratio | surfaces | same |\n|---|---|---|---|---|---|")
    for size in (5.0, 30.0, 100.0):
        clouds = scene(size)
        planes = horizontal_planes(clouds)
        ours, theirs = by_grids(clouds, planes), by_trees(clouds)
        a = median(lambda c=clouds, h=planes: by_grids(c, h), 7)
        b = median(lambda c=clouds: by_trees(c), 3)
        same = bool(np.array_equal(ours, theirs))
        count = len(np.unique(ours))
        row = f"{a:.4f} | {b:.4f} | {b / a:.1f} | {count} | {'yes' if same else 'no'}"
        print(f"| side of {size:.0f} m | {row} |", flush=True)


if __name__ == "__main__":
    main()
