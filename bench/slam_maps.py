"""Draw the maps of the public logs, walls in red, for docs/design/experiments/wall_slam.md.

Usage: python bench/slam_maps.py [--shared FOLDER] [--out docs/images]
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np
from bench_slam import scans_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from tccm_ros.config import Config
from tccm_ros.geometry import transform2
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.wall_slam import WallSlam
from tccm_sim.carmen import import_carmen

HERE = Path(__file__).resolve().parent


def draw(log: Path, out: Path) -> None:
    """Solve a log and draw every fifth scan, the trajectory and the walls."""
    with tempfile.TemporaryDirectory() as folder:
        import_carmen(log, Path(folder) / "bag")
        scans = scans_of(Path(folder) / "bag")
    config = Config()
    slam = WallSlam(config)
    for scan in scans:
        slam.add_scan(scan)
    solution = slam.solve()
    points = [
        transform2(pose, make_level_scan(scan, config).beams)
        for pose, scan in zip(solution.poses[::5], scans[::5])
    ]
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot(*np.concatenate(points).T, ",", color="#404040", alpha=0.25, rasterized=True)
    axes.plot(*solution.poses[:, :2].T, color="#3070c0", linewidth=0.5)
    lines = [wall.endpoints for wall in solution.walls]
    axes.add_collection(LineCollection(lines, colors="#c03020", linewidths=1.4))
    low, high = np.quantile(np.concatenate(points), [0.002, 0.998], axis=0)
    axes.set(aspect="equal", xlabel="x, m", ylabel="y, m")
    axes.set(xlim=(low[0] - 1, high[0] + 1), ylim=(low[1] - 1, high[1] + 1))
    figure.savefig(out, dpi=90, metadata={"Software": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = os.environ.get("TCCM_SHARED", HERE.parents[1] / "shared")
    parser.add_argument("--shared", type=Path, default=Path(default))
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "images")
    options = parser.parse_args()
    for name in ("intel", "mit-csail"):
        log = options.shared / "data" / "carmen" / f"{name}.clf.bz2"
        if log.exists():
            draw(log, options.out / f"slam_{name}.png")
        else:
            print(f"{name}: skipped, {log} is not here")


if __name__ == "__main__":
    main()
