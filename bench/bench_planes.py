"""Planes against least squares on the true points, the paper's detector, PCL and Open3D.

Situations A to D of the simulator, range noise 0, 2.5 and 5 mm. Position is the distance of the
plane from the true one, along the true normal at the middle of the subject's points. Outlines are
worked out only when asked for, and are not in the times. What counts are ratios in one run.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "bench"), str(ROOT / "test" / "helpers")]

from plane_scenes import (  # noqa: E402
    MISS_DEG,
    MISS_MM,
    REGION,
    error,
    eye,
    fitted_plane,
    in_region,
    median_ms,
    part_map_of,
    pcl_planes,
    subject_fit,
    subject_points,
)
from situation_cycle import Cycle, cycle  # noqa: E402

from tccm_ros.baselines.center_cores import (  # noqa: E402
    CenterCores,
    center_cores,
    find_core_plane,
)
from tccm_ros.baselines.neighbour_planes import label_neighbours  # noqa: E402
from tccm_ros.config import Config  # noqa: E402
from tccm_ros.cuboids.cuboids import Cuboids  # noqa: E402
from tccm_ros.cuboids.inclination import OUTLINED_BY_COLUMNS  # noqa: E402
from tccm_ros.outlines.boundary import members_by_plane, outlines  # noqa: E402
from tccm_ros.planes import find_planes  # noqa: E402
from tccm_ros.planes.horizontal_clusters import label_horizontal  # noqa: E402

Array = NDArray[np.float64]
CONFIG = Config()
SIGMAS = (0.0, 0.0025, 0.005)
NAMES = "abcd"
TRUE_MM = {"a": 700.0, "b": 600.0, "c": 700.0, "d": 600.0}

PCL_TRIALS = {"at most 50 trials": 50, "until 99 % sure": 1000}
"""PCL's default ends after 50 trials, sure or not; with at most 1,000 its own rule ends it."""

PCL_RUNS = 25
"""Runs of PCL on each cloud, with other draws each."""

CORES = {
    "40 mm": (0.04, 0.016),
    "20 mm": (0.02, 0.006),
}
"""Cell sizes of the paper, m, and the shortest core that is used, m: one setting for A to D;
`--tables cells` shows how many others miss."""

TRIALS = (50, 10)
"""Trials of the published detector in the paper's tables."""

CORE_MISS_DEG = 10.0
"""A plane of center cores that is further off is a miss; the paper tells positions alone."""

PAPER = {
    "PCL": "698.46 0.00|599.37 0.00|698.27 0.00|599.73 0.00/698.02 0.15|599.37 0.02|697.63 0.15|"
    "609.31 4.08/697.91 0.11|599.23 0.26|696.60 0.14|601.13 1.82",
    "cores, 50 trials": "699.90 0.34|600.00 0.01|699.86 0.61|600.05 0.68/699.14 3.21|599.15 1.46|"
    "699.08 3.08|600.24 2.65/699.49 4.41|597.94 3.06|700.05 4.04|598.15 3.16",
    "cores, 10 trials": "699.90 0.34|600.00 0.01|699.86 0.61|600.37 2.78/698.23 3.20|598.67 2.25|"
    "700.51 5.20|600.99 2.86/700.49 7.74|599.21 4.86|699.17 5.79|599.26 5.51",
}
"""Table I as published: mean and deviation, mm, situations A to D / rows of sigma."""

PAPER_MS = {
    "PCL": (26.72, 25.13, 24.84, 37.51, 22.34, 24.98, 24.83, 28.85, 23.66, 25.85, 27.42, 29.97),
    "cores, 50 trials": (
        28.59, 14.44, 25.70, 15.44, 16.96, 14.10, 15.83, 15.96, 17.78, 12.75, 16.16, 14.12
    ),
    "cores, 10 trials": (5.82, 3.50, 4.87, 3.05, 3.47, 2.82, 3.18, 3.58, 3.07, 2.58, 3.67, 3.67),
}  # fmt: skip
"""Table II as published, ms: A to D for each sigma."""


def table_one(tests: int) -> None:
    """Print Table I: mean and deviation of the position, misses, and the paper's own figures."""
    print(f"### Table I: position, mean and deviation in mm of {tests} tests (misses)\n")
    print("| detector | sigma, mm | " + " | ".join(n.upper() for n in NAMES) + " |")
    print("|---|---|" + "---|" * len(NAMES))
    for row, sigma in enumerate(SIGMAS):
        cells: dict[str, list[str]] = {}
        for name in NAMES:
            for method, values in positions(name, sigma, tests).items():
                cells.setdefault(method, []).append(statistic(values, TRUE_MM[name]))
        for method, texts in cells.items():
            print(f"| {method} | {1e3 * sigma:.1f} | " + " | ".join(texts) + " |")
        for method, text in PAPER.items():
            print(
                f"| *paper: {method}* | {1e3 * sigma:.1f} | *"
                + "* | *".join(text.split("/")[row].split("|"))
                + "* |"
            )


def positions(name: str, sigma: float, tests: int) -> dict[str, list[float]]:
    """Return the errors in mm of all methods on one situation; nan is a miss."""
    errors: dict[str, list[float]] = {}
    clouds, kept = [], []
    for seed in range(tests):
        simulated = cycle(name, sigma, seed, room=True)
        inliers = subject_points(simulated)
        middle = inliers.mean(axis=0)
        cuboids = part_map_of(simulated, CONFIG, REGION)

        def note(method, plane, simulated=simulated, middle=middle, miss_deg=MISS_DEG):
            value = np.nan
            if plane is not None:
                mm, deg = error(plane[0], plane[1], simulated, middle)
                value = mm if abs(mm) < MISS_MM and deg < miss_deg else np.nan
            errors.setdefault(method, []).append(value)

        fit = subject_fit(find_planes(cuboids, CONFIG, eye(simulated)), simulated, middle)
        note("least squares on the true points", fitted_plane(inliers))
        note("**pooled moments**", fit and (fit.normal, fit.offset))
        for size, (cell, min_length) in CORES.items():
            cores = core_map(simulated, cell, min_length)
            for trials in TRIALS:
                plane = find_core_plane(cores, CONFIG, trials, seed)
                found = plane and (plane.normal, plane.offset)
                note(f"cores, {size}, {trials} trials", found, miss_deg=CORE_MISS_DEG)
        clouds.append(simulated.points[in_region(simulated.points)])
        kept.append(note)
    for limit, trials in PCL_TRIALS.items():
        for note, runs in zip(kept, pcl_planes(clouds, trials) or [], strict=False):
            note(f"PCL 10 mm, {limit}", (runs[0, 2:5], runs[0, 5]))
    return errors


def core_map(simulated: Cycle, cell: float, min_length: float) -> CenterCores:
    """Return the center cores of one tilt cycle in cells of a size, m."""
    return center_cores(part_map_of(simulated, sized(cell), REGION), min_length)


def sized(cell: float) -> Config:
    """Return the configuration with cells of a size, m."""
    return Config.model_validate({"map": {"cell_size": cell}})


def core_time(cuboids: Cuboids, min_length: float, trials: int) -> float:
    """Return the median time of the published detector, with the cores, ms."""
    return median_ms(
        lambda: find_core_plane(center_cores(cuboids, min_length), CONFIG, trials, 1), 20
    )


def table_cells(tests: int) -> None:
    """Print what center cores find at the paper's cell sizes, with short cores left out."""
    print(f"\n### Center cores by cell size: sigma 2.5 mm, 50 trials, {tests} tests\n")
    print("| cell, mm | shortest core, mm | " + " | ".join(n.upper() for n in NAMES) + " |")
    print("|---|---|" + "---|" * len(NAMES))
    for cell in (0.01, 0.02, 0.03, 0.04):
        for min_length in (0.0, 0.006, 0.012, 0.016):
            texts = []
            for name in NAMES:
                values = [core_error(name, seed, cell, min_length) for seed in range(tests)]
                texts.append(statistic([mm for mm, _ in values], TRUE_MM[name]))
                texts[-1] += f", {sum(deg < MISS_DEG for _, deg in values)} within 2 deg"
            print(f"| {1e3 * cell:.0f} | {1e3 * min_length:.0f} | " + " | ".join(texts) + " |")


def core_error(name: str, seed: int, cell: float, min_length: float) -> tuple[float, float]:
    """Return the error, mm and deg, of the best plane of 50 trials; nan is a miss."""
    simulated = cycle(name, 0.0025, seed, room=True)
    plane = find_core_plane(core_map(simulated, cell, min_length), CONFIG, 50, seed)
    if plane is None:
        return np.nan, np.nan
    middle = subject_points(simulated).mean(axis=0)
    mm, deg = error(plane.normal, plane.offset, simulated, middle)
    return (mm, deg) if abs(mm) < MISS_MM and deg < CORE_MISS_DEG else (np.nan, np.nan)


def statistic(values: list[float], true_mm: float) -> str:
    """Return mean and deviation of what is no miss, and the misses."""
    good = np.array(values)[np.isfinite(values)]
    misses = len(values) - len(good)
    if len(good) == 0:
        return f"all {misses} missed"
    text = f"{true_mm + good.mean():.3f} {good.std():.3f}"
    return text + (f" ({misses})" if misses else "")


def table_two() -> None:
    """Print Table II: times and ratios."""
    print("\n### Table II: time in ms; pooled moments find all planes, the others one\n")
    limits = " | ".join(f"PCL 10 mm, {limit}" for limit in PCL_TRIALS)
    print(
        "| scene | cuboids | points | pooled moments | labels | labels of 8 neighbours |"
        f" {' | '.join(f'cores, {size}, {trials}' for size in CORES for trials in TRIALS)} |"
        f" {limits} |"
    )
    print("|---" * (6 + len(CORES) * len(TRIALS) + len(PCL_TRIALS)) + "|")
    ratios: dict[tuple[bool, str], list[str]] = {}
    for region in (REGION, None):
        for name in NAMES:
            simulated = cycle(name, 0.0025, 1, room=region is None)
            cuboids = part_map_of(simulated, CONFIG, region)
            points = (
                simulated.points
                if region is None
                else simulated.points[in_region(simulated.points)]
            )
            place = eye(simulated)
            ours = median_ms(lambda c=cuboids, p=place: find_planes(c, CONFIG, p), 200)
            labels = median_ms(lambda c=cuboids: label_horizontal(c), 200)
            eight = median_ms(lambda c=cuboids: label_neighbours(c, 0.010), 200)
            published = [
                core_time(part_map_of(simulated, sized(cell), region), length, trials)
                for cell, length in CORES.values()
                for trials in TRIALS
            ]
            peers = []
            for limit, trials in PCL_TRIALS.items():
                if (found := pcl_time(points, trials)) is None:
                    peers.append("not installed")
                    continue
                pcl, smaller = found
                peers.append(f"{pcl:.2f}" + (f" ({smaller})" if smaller else ""))
                part = ratios.setdefault((region is REGION, limit), [])
                part.append(f"{name.upper()} {pcl / ours:.1f}")
            where = "region" if region else "room"
            print(
                f"| {name.upper()}, {where} | {len(cuboids)} | {len(points)} | **{ours:.3f}** |"
                f" {labels:.3f} | {eight:.3f} | {' | '.join(f'{ms:.2f}' for ms in published)} |"
                f" {' | '.join(peers)} |"
            )
    print(f"\nIn brackets: of PCL's {PCL_RUNS} runs, those whose plane was not the largest.")
    print(
        "\nPaper (its own machine): "
        + "; ".join(
            f"{method} {min(times):.1f} to {max(times):.1f}" for method, times in PAPER_MS.items()
        )
        + "."
    )
    for (is_region, limit), part in ratios.items():
        where, want = ("region", 5) if is_region else ("room", 80)
        print(
            f"\nPCL's one plane, {limit}, / all planes of ours, {where} (target {want}): "
            + ", ".join(part)
            + "."
        )


def pcl_time(points: Array, trials: int) -> tuple[float, int] | None:
    """Return PCL's median time, ms, and how many of its runs end with a much smaller plane.

    None without PCL.
    """
    peers = pcl_planes([points], trials, repeats=PCL_RUNS)
    if peers is None:
        return None
    ms, inliers = peers[0][:, 0], peers[0][:, 1]
    return float(np.median(ms)), int((inliers < 0.9 * inliers.max()).sum())


def table_open3d() -> None:
    """Print Open3D's times and positions, where it is installed."""
    try:
        import open3d
    except ImportError:
        print("\nOpen3D is not installed: its rows are left out.")
        return
    print("\n### Open3D\n\n| scene | segment_plane, ms | detect_planar_patches, ms | planes |")
    print("|---|---|---|---|")
    for name in NAMES:
        simulated = cycle(name, 0.0025, 1, room=True)
        cloud = open3d.geometry.PointCloud()
        cloud.points = open3d.utility.Vector3dVector(simulated.points[in_region(simulated.points)])
        one = median_ms(lambda c=cloud: c.segment_plane(0.01, 3, 100), 20)
        cloud.estimate_normals()
        many = median_ms(lambda c=cloud: c.detect_planar_patches(), 3)
        print(f"| {name.upper()} | {one:.2f} | {many:.1f} | {len(cloud.detect_planar_patches())} |")


def table_outlines() -> None:
    """Print what outlines cost, ours and with shapely, of the planes that are seen from above."""
    print("\n### Outlines of all planes that are not vertical: ms\n")
    print("| scene | planes | ours | shapely: union of cells, simplified | shapely: concave hull |")
    print("|---|---|---|---|---|")
    for name in NAMES:
        simulated = cycle(name, 0.0025, 1, room=True)
        cuboids = part_map_of(simulated, CONFIG, None)
        fits = find_planes(cuboids, CONFIG, eye(simulated))
        kept = [f for f in fits if abs(f.normal[2]) >= OUTLINED_BY_COLUMNS]
        labels = np.full(len(cuboids), -1, np.int32)
        for k, fit in enumerate(kept):
            labels[fit.members] = k
        normals, offsets = np.array([f.normal for f in kept]), np.array([f.offset for f in kept])
        members, starts = members_by_plane(labels, len(kept))
        cells = [
            np.stack([cuboids.ix[own], cuboids.iy[own]], axis=1) * cuboids.cell_size
            for own in np.split(members, starts[1:-1])
        ]

        def union(cells: list[Array] = cells, size: float = cuboids.cell_size) -> None:
            for low in cells:
                whole = shapely.union_all(shapely.box(*low.T, *(low + size).T))
                whole.buffer(2.5 * size).buffer(-2.5 * size).simplify(size)

        def hull(cells: list[Array] = cells) -> None:
            for low in cells:
                shapely.concave_hull(shapely.multipoints(low), 0.1, allow_holes=True)

        ours = median_ms(
            lambda c=cuboids, m=members, s=starts, n=normals, d=offsets: outlines(c, m, s, n, d), 50
        )
        peers = median_ms(union, 5), median_ms(hull, 5)
        print(f"| {name.upper()} | {len(kept)} | {ours:.2f} | {peers[0]:.1f} | {peers[1]:.1f} |")


def main() -> int:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=20, help="tests of Table I")
    parser.add_argument(
        "--tables", nargs="*", default=["one", "cells", "two", "open3d", "outlines"]
    )
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    tables: dict[str, Callable[[], None]] = {
        "one": lambda: table_one(options.tests),
        "cells": lambda: table_cells(options.tests),
        "two": table_two,
        "open3d": table_open3d,
        "outlines": table_outlines,
    }
    for name in options.tables:
        tables[name]()
    return 0


if __name__ == "__main__":
    sys.exit(main())
