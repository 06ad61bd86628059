"""Outlines of results over the true ones, in one picture.

Usage: python bench/draw_outlines.py TRUTH PICTURE RESULT... [--view XMIN XMAX YMIN YMAX]

A panel for each result folder: true outlines grey, found ones blue.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np


def outlines(path: Path) -> list[np.ndarray]:
    """Return the boundaries of the surfaces of a file that are no floor, float64 (N, 2), m."""
    surfaces = json.loads(path.read_text())["surfaces"]
    return [np.array(s["boundary"])[:, :2] for s in surfaces if s["label"] != "floor"]


def main() -> None:
    """Draw one panel for each result."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("truth", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("results", type=Path, nargs="+")
    parser.add_argument("--view", type=float, nargs=4, help="x and y limits, m")
    arguments = parser.parse_args()
    _, axes = plt.subplots(
        1, len(arguments.results), figsize=(6.0 * len(arguments.results), 5.0), squeeze=False
    )
    for axis, result in zip(axes[0], arguments.results):
        for ring in outlines(arguments.truth):
            axis.fill(*ring.T, facecolor="0.9", edgecolor="0.4", linewidth=0.8)
        for ring in outlines(result / "surfaces.json"):
            axis.plot(*np.vstack([ring, ring[:1]]).T, color="C0", linewidth=1.2)
        axis.set(title=result.name, aspect="equal", xlabel="x, m", ylabel="y, m")
        if arguments.view:
            axis.set(xlim=arguments.view[:2], ylim=arguments.view[2:])
    plt.tight_layout()
    plt.savefig(arguments.picture, dpi=110)


if __name__ == "__main__":
    main()
