"""Errors of the seen edges of surfaces against truth, over the standard deviation of each.

    python bench/bench_edges.py bags/flat bags/rgbd_kitchen
    python bench/bench_edges.py bags/flat=RESULT     (of an earlier `tccm replay`)

An edge counts where it is called seen, is at least 0.25 m long, and belongs to a surface that
covers a true one. Its error is the distance of its middle from the nearest true edge of about its
direction. A right standard deviation gives an rms of 1, and 0.3 % of the edges beyond 3.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

MIN_LENGTH = 0.25
"""Shorter edges do not count, m."""

MAX_HEIGHT_ERROR, MIN_OVERLAP = 0.04, 0.5
"""A mapped surface is a true one within this height, m, and from this intersection over union."""

MAX_YAW = np.radians(10.0)
"""A true edge has the direction of a mapped one within this, rad."""


def polygon_of(surface: dict[str, Any]) -> Polygon:
    """Return the outline of a surface of surfaces.json, seen from above."""
    holes = [[p[:2] for p in hole] for hole in surface.get("holes", [])]
    return Polygon([p[:2] for p in surface["boundary"]], holes).buffer(0)


def errors_of(result: dict[str, Any], truth: dict[str, Any]) -> NDArray[np.float64]:
    """Return error and sigma of each seen edge, float64 (N, 2), m; positive: too far out."""
    rows = []
    for true in truth["surfaces"]:
        outline = polygon_of(true)
        height = np.mean([p[2] for p in true["boundary"]])
        for surface in result["surfaces"]:
            mapped = polygon_of(surface)
            z = np.mean([p[2] for p in surface["boundary"]])
            shared = mapped.intersection(outline).area
            if abs(z - height) > MAX_HEIGHT_ERROR or surface["label"] == "floor":
                continue
            if shared < MIN_OVERLAP * (mapped.area + outline.area - shared):
                continue
            for edge in surface["edges"]:
                if edge["state"] == "seen" and edge["sigma"] is not None:
                    rows += _error(edge, outline)
    return np.reshape(rows, (-1, 2))


def _error(edge: dict[str, Any], outline: Polygon) -> list[tuple[float, float]]:
    """Return error and sigma of an edge, if it is long enough."""
    start, end = np.array(edge["start"][:2]), np.array(edge["end"][:2])
    length = float(np.hypot(*(end - start)))
    if length < MIN_LENGTH:
        return []
    along = (end - start) / length
    outward, middle = np.array([along[1], -along[0]]), 0.5 * (start + end)
    found = []
    ring = np.asarray(outline.exterior.coords)
    for a, b in pairwise(ring):
        step = b - a
        side = np.hypot(*step)
        if side > 0.0 and abs(step @ outward) <= np.sin(MAX_YAW) * side:
            at = np.clip((middle - a) @ step / side**2, 0.0, 1.0)
            nearest = a + at * step
            found.append(
                (float(np.hypot(*(middle - nearest))), float((middle - nearest) @ outward))
            )
    if not found:
        found = [(0.0, float(outline.exterior.distance(Polygon([start, end, start]).centroid)))]
    return [(min(found)[1], float(edge["sigma"]))]


def table_row(name: str, errors: NDArray[np.float64]) -> str:
    """Return a row of the table."""
    error, sigma = errors.T
    ratio = np.abs(error) / sigma
    return (
        f"| {name} | {len(error)} | {1e3 * np.sqrt(np.mean(error**2)):.1f} | "
        f"{1e3 * np.median(sigma):.1f} | {np.sqrt(np.mean(ratio**2)):.2f} | "
        f"{100.0 * np.mean(ratio > 3.0):.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bag", nargs="+", help="a recording with truth.json, or BAG=RESULT")
    print("| recording | edges | error, mm rms | sigma, mm median | error/sigma, rms | > 3, % |")
    print("|---|---|---|---|---|---|")
    for argument in parser.parse_args().bag:
        bag, _, folder = argument.partition("=")
        with tempfile.TemporaryDirectory() as new:
            if not folder:
                folder = new
                command = ["tccm", "replay", bag, "--out", folder]
                subprocess.run(command, check=True, capture_output=True)
            result = json.loads((Path(folder) / "surfaces.json").read_text())
        truth = json.loads((Path(bag) / "truth.json").read_text())
        print(table_row(Path(bag).name, errors_of(result, truth)))


if __name__ == "__main__":
    main()
