"""The second paper's wall SLAM and surfaces, config/paper.yaml, beside ours: a Markdown table.

Usage: python bench/paper_slam.py [--shared FOLDER] [--worlds flat ring random-1 intel mit-csail]

Simulated worlds are compared with the truth of every pose and surface (their names are explained in
drives.py). Public logs are compared with their references, by pairs of rows less than 3 m from each
other with more than 10 m of path between them. Below the table: surfaces of the truth that were not
found, and false ones.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
from bench_slam import HERE, scans_of
from drives import run_drives

from tccm_ros.config.reader import read_config
from tccm_ros.evaluate.surfaces import score_surfaces
from tccm_ros.evaluate.trajectory_errors import (
    absolute_errors,
    pairs_that_meet,
    poses_at,
    relation_errors,
)
from tccm_ros.evaluate.truth_files import read_reference, read_stamps
from tccm_ros.geometry import inverse, spatial
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.replay.replay import replay
from tccm_ros.results.trajectory import read_tum
from tccm_sim.carmen import import_carmen

ROOT = HERE.parent
CONFIGS = {"ours": None, "config/paper.yaml": ROOT / "config" / "paper.yaml"}


WRONG: list[str] = []
"""Surfaces that were not found or are false, for the list below the table."""


def simulated(world: str, bag: Path, folder: Path) -> None:
    """Print the rows of a simulated world."""
    truth = read_tum(bag / "truth.tum")
    for name, path in CONFIGS.items():
        out = folder / f"{world}-{name.replace('/', '-')}"
        start = time.process_time()
        replay(bag, out, read_config(path), pictures=False)
        seconds = time.process_time() - start
        found = read_tum(out / "trajectory.tum")
        at, is_known = poses_at(truth.stamps_ns, truth.T_map_base, found.stamps_ns)
        poses = found.T_map_base[is_known]
        rms, raw = (
            np.sqrt(np.mean(absolute_errors(poses, at[is_known], aligned=a).translation ** 2))
            for a in (True, False)
        )
        surfaces = "-"
        truth_surfaces = bag / "truth.json"
        if json.loads(truth_surfaces.read_text()).get("surfaces"):
            score = score_surfaces(out / "surfaces.json", truth_surfaces)
            surfaces = f"{score.found} of {len(score.matches)}, {len(score.false)} false"
            where = f"{world}, {name}: "
            WRONG.extend(
                f"{where}{m.label} at {m.height:.2f} m, {m.area:.2f} m2: overlap {m.overlap:.2f},"
                f" {1e3 * m.height_error:+.0f} mm"
                for m in score.matches
                if not m.is_found
            )
            found_surfaces = json.loads((out / "surfaces.json").read_text())["surfaces"]
            WRONG.extend(
                f"{where}false: {s['label']} at {s['height']:.2f} m, {s['area']:.2f} m2,"
                f" {len(s['views'])} views"
                for s in found_surfaces
                if s["id"] in score.false
            )
        walls = len(json.loads((out / "walls.json").read_text())["walls"])
        print(
            f"| {world} | {name} | {1e3 * rms:.1f} mm, {1e3 * raw:.1f} mm | {walls} | {surfaces} |"
            f" {seconds:.0f} |",
            flush=True,
        )


def recorded(log: Path, folder: Path) -> None:
    """Print the rows of a public log."""
    bag = folder / log.name.split(".")[0]
    import_carmen(log, bag)
    scans, stamps = scans_of(bag), read_stamps(bag / "stamps.csv")
    truth = read_reference(log.with_name(f"{bag.name}_reference.txt"))
    i, j = pairs_that_meet(truth.poses[:, :3, 3]).T
    for name, path in CONFIGS.items():
        walls = SurfaceSlam(read_config(path)).wall_slam
        start = time.process_time()
        for scan in scans:
            walls.add_scan(scan)
        solution = walls.solve()
        seconds = time.process_time() - start
        poses = spatial(solution.pose_at([stamps[int(k)] for k in truth.scan_index]))
        errors = relation_errors(poses[i], poses[j], inverse(truth.poses[i]) @ truth.poses[j])
        print(
            f"| {bag.name} | {name} | {errors.translation.mean():.3f} +-"
            f" {errors.translation.std():.3f} m between pairs | {len(solution.walls)} | - |"
            f" {seconds:.0f} |",
            flush=True,
        )


def main() -> None:
    """Print the table."""
    run_drives(
        __doc__,
        ("drive", "configuration", "position", "walls", "surfaces found", "seconds"),
        simulated,
        recorded,
    )
    print("".join(f"\n- {text}" for text in WRONG))


if __name__ == "__main__":
    main()
