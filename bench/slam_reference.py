"""Which rows of a log's reference contradict the reference's own map? No estimate of ours is used.

For each row the scan is laid over what at least four of the other rows within 4 m saw, all at the
reference's poses: the fraction of its points within 10 cm of that, and the largest fraction within
10 cm and 0.5 rad around the row's pose. A row whose fraction grows much by a turn is wrong by it.

Usage: python bench/slam_reference.py [LOG ...] [--shared FOLDER]. Prints a table; asserts nothing.
"""

from __future__ import annotations

import argparse
import itertools
import os
import tempfile
from pathlib import Path

import numpy as np
from bench_slam import HERE, scans_of
from scipy.spatial import cKDTree

from tccm_ros.config import Config
from tccm_ros.evaluate.truth_files import read_reference, read_stamps
from tccm_ros.geometry import planar, transform2
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_sim.carmen import import_carmen

NEAR, MATCHED = 4.0, 0.10  # m
YAWS = np.arange(-0.48, 0.481, 0.04)  # rad
SHIFTS = (-0.1, 0.0, 0.1)  # m
CELL, WITNESSES = 0.10, 4
"""Cells (m) that so many rows saw make the map: few rows with one error do not carry each other."""

GAIN = 0.2
"""Rows whose fraction grows by more than this are listed."""


def read_rows(log: Path) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return scan indices, poses (N, 3) and points (M, 2) in the base of the reference's rows."""
    truth = read_reference(log.with_name(log.name.replace(".clf.bz2", "_reference.txt")))
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        import_carmen(log, bag)
        by_stamp = {s.scan.stamp_ns: s for s in scans_of(bag)}
        stamps = read_stamps(bag / "stamps.csv")
    config = Config()
    scans = [by_stamp[stamps[int(i)]] for i in truth.scan_index]
    return truth.scan_index, planar(truth.poses), [make_level_scan(s, config).beams for s in scans]


def seen_by_several(points: list[np.ndarray]) -> np.ndarray:
    """Return the centres (M, 2) of the cells in which several rows have points."""
    cells = [np.unique(np.floor(p / CELL).astype(np.int64), axis=0) for p in points]
    found, count = np.unique(np.concatenate(cells), axis=0, return_counts=True)
    return (found[count >= WITNESSES] + 0.5) * CELL


def best_yaw(tree: cKDTree, points: np.ndarray, pose: np.ndarray) -> tuple[float, float, float]:
    """Return the fraction at the pose, the best fraction around it, and its yaw, rad."""

    def fraction(offset: tuple[float, float, float]) -> float:
        near = tree.query(transform2(pose + offset, points), distance_upper_bound=MATCHED)[0]
        return float(np.mean(np.isfinite(near)))

    here = fraction((0.0, 0.0, 0.0))
    tries = [(x, y, t) for t, x, y in itertools.product(YAWS, SHIFTS, SHIFTS)]
    fractions = [fraction(offset) for offset in tries]
    best = int(np.argmax(fractions))
    return here, max(fractions[best], here), tries[best][2] if fractions[best] > here else 0.0


def check(log: Path) -> None:
    index, poses, points = read_rows(log)
    found = []
    for i, pose in enumerate(poses):
        away = np.hypot(*(poses[:, :2] - pose[:2]).T)
        near = [j for j in np.flatnonzero(away < NEAR) if j != i]
        if len(near) < WITNESSES:
            continue
        tree = cKDTree(seen_by_several([transform2(poses[j], points[j]) for j in near]))
        found.append((int(index[i]), len(near), *best_yaw(tree, points[i], pose)))
    fractions = np.array([row[2] for row in found])
    print(
        f"{log.name.split('.')[0]}: {len(found)} rows; fraction of matched points: median "
        f"{np.median(fractions):.2f}, 5 % of the rows below {np.quantile(fractions, 0.05):.2f}"
    )
    for scan, near, here, best, yaw in found:
        if best - here > GAIN:
            print(
                f"  scan {scan}: {here:.2f} at the reference's pose, {best:.2f} turned by "
                f"{yaw:+.2f} rad ({near} rows near)"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = os.environ.get("TCCM_SHARED", HERE.parents[1] / "shared")
    parser.add_argument("logs", nargs="*", default=["mit-csail"])
    parser.add_argument("--shared", type=Path, default=Path(default))
    options = parser.parse_args()
    for name in options.logs:
        log = options.shared / "data" / "carmen" / f"{name}.clf.bz2"
        if log.exists():
            check(log)
        else:
            print(f"{name}: skipped, {log} is not here")


if __name__ == "__main__":
    main()
