"""Compare covariances of surface heights and of view poses with the truth, by chi-square.

python bench/bench_covariances.py BAG...

Each BAG is a simulated recording with truth.json and truth.tum. A row is printed for each: the mean
squared error of heights over their variance (floor included, heights in map), the same of (x, y,
yaw) and of (z, roll, pitch) of views for each degree of freedom, and how many are beyond the 99 %
quantile. Right covariances give 1 and 1 %.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import chi2
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.replay.run import run_bag

MAX_STEP = 0.04
"""A surface is compared with a true one at most so much higher or lower, m."""


def main() -> None:
    """Print a table."""
    print("| recording | heights | x, y, yaw of views | z, roll, pitch of views |")
    print("|---|---|---|---|")
    for bag in map(Path, sys.argv[1:]):
        solution = run_bag(bag, Config()).solution
        heights = _heights(solution, json.loads((bag / "truth.json").read_text()))
        plane, level = _poses(solution, np.loadtxt(bag / "truth.tum"))
        cells = [_cell(heights, 1), _cell(plane, 3), _cell(level, 3)]
        print("|", " | ".join([bag.name, *cells]), "|", flush=True)


def _cell(squares: Float64, freedom: int) -> str:
    beyond = 100.0 * (squares > chi2.ppf(0.99, freedom)).mean()
    return f"{squares.mean() / freedom:.2f} ({beyond:.0f} % of {len(squares)} beyond 99 %)"


def _heights(solution: SurfaceSolution, truth: dict) -> Float64:
    squares = []
    for true in truth["surfaces"]:
        outline = Polygon([p[:2] for p in true["boundary"]])
        height = float(np.mean([p[2] for p in true["boundary"]]))
        found = [
            s
            for s in solution.surfaces
            if outline.contains(Polygon(s.boundary[:, :2]).representative_point())
            and abs(s.height - height) < MAX_STEP
        ]
        squares += [(s.height - height) ** 2 / s.cov_plane[0, 0] for s in found]
    return np.array(squares)


def _poses(solution: SurfaceSolution, tum: Float64) -> tuple[Float64, Float64]:
    slam = solution.graph
    stamps = np.clip(solution.view_stamps_ns * 1e-9, tum[0, 0], tum[-1, 0])
    true = np.tile(np.eye(4), (len(stamps), 1, 1))
    true[:, :3, :3] = Slerp(tum[:, 0], Rotation.from_quat(tum[:, 4:8]))(stamps).as_matrix()
    for k in range(3):
        true[:, k, 3] = np.interp(stamps, tum[:, 0], tum[:, 1 + k])
    plane, level = [], []
    for T_true, T, cov in zip(true, slam.T_map_views, slam.cov_views):
        error = inverse(T_true) @ T
        tangent = np.r_[Rotation.from_matrix(error[:3, :3]).as_rotvec(), error[:3, 3]]
        for rows, scale, squares in (
            ([3, 4, 2], slam.unit_variance, plane),
            ([5, 0, 1], 1.0, level),
        ):
            own = scale * cov[np.ix_(rows, rows)]
            squares.append(tangent[rows] @ np.linalg.solve(own, tangent[rows]))
    return np.array(plane), np.array(level)


if __name__ == "__main__":
    main()
