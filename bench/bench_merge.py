"""Maps of several robots merged: errors against the truth, other furniture, and a log in parts.

Usage: python bench/bench_merge.py [CASE ...] [--folder FOLDER] [--shared FOLDER]

Cases: ``flat`` and ``ring`` (four robots each), ``other`` (two more in a flat with the same walls
and other furniture), ``intel`` (a public log in four parts, where it is). Recordings and maps are
made once, in ``--folder``. Prints tables; asserts nothing.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from merge_drives import write_drives

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.evaluate.trajectory_errors import (
    Errors,
    pairs_that_meet,
    poses_at,
    relation_errors,
)
from tccm_ros.evaluate.truth_files import read_reference, read_stamps
from tccm_ros.fleet.cluster import Workers
from tccm_ros.fleet.merge import MergeSummary, merge_maps
from tccm_ros.geometry import between2, compose2, inverse, planar, spatial
from tccm_ros.replay.replay import replay
from tccm_ros.results.map_file import load_map
from tccm_ros.results.trajectory import read_tum
from tccm_sim.carmen import import_carmen

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "test" / "helpers"))
from map_truth import surface_errors, surfaces_of_tops, wall_errors  # noqa: E402
from split_bag import split_bag  # noqa: E402

PARTS = 4
"""Of the log."""

MAX_ERROR_MM = 15.0
"""Walls beyond it are counted."""


def maps_of(bags: Sequence[Path], folder: Path) -> list[Path]:
    """Return the result folders of recordings; those that are there are left."""
    made = [folder / bag.stem for bag in bags]
    for bag, out in zip(bags, made):
        if not out.exists():
            replay(bag, out, Config(), pictures=False)
    return made


def merge(maps: Sequence[Path], out: Path) -> MergeSummary:
    """Merge maps on two workers, and print the components."""
    merged = merge_maps(maps, out, Config(), workers=Workers(2))
    sizes = [len(component.maps) for component in merged.content.components]
    pairs = merged.content.pairs
    accepted = sum(pair.accepted for pair in pairs)
    print(f"\n{out.name}: components of {sizes} maps; {accepted} of {len(pairs)} pairs accepted")
    for pair in pairs:
        if not pair.accepted:
            names = " and ".join(Path(name).name for name in (pair.one, pair.other))
            print(f"- {names}: {pair.reason} ({pair.loops} keyframes)")
    return merged


def print_errors(folders: Sequence[Path], bags: Sequence[Path]) -> None:
    """Print the errors of maps against the truth in their frame."""
    print("\n| map | walls | fitted, max mm | median | > 15 | in its frame, max | ", end="")
    print("tops | missing | double | height, max mm |\n" + "|---" * 10 + "|")
    for folder, bag in zip(folders, bags):
        fitted, walls = (1e3 * wall_errors(folder, bag, fitted=flag) for flag in (True, False))
        heights, counts = surface_errors(folder, bag)
        print(
            f"| {folder.name} | {len(walls)} | {fitted.max():.1f} | {np.median(fitted):.1f} "
            f"| {(fitted > MAX_ERROR_MM).sum()} | {walls.max():.1f} | {len(counts)} "
            f"| {(counts == 0).sum()} | {(counts > 1).sum()} | {1e3 * heights.max():.1f} |",
            flush=True,
        )


def bench_building(folder: Path, building: str) -> None:
    """Merge the maps of four robots in one building."""
    bags = write_drives(folder / "bags", building)
    maps = maps_of(bags, folder / "maps")
    merged = merge(maps, folder / f"merged {building}")
    print_errors([merged.out, *maps], [bags[0], *bags])
    print_ids(merged, maps, bags)


def print_ids(merged: MergeSummary, maps: Sequence[Path], bags: Sequence[Path]) -> None:
    """Print how many tops have one id in the merged map, whichever map is asked."""
    entries = {entry.map: entry for entry in merged.content.components[0].maps}
    ids: list[set[int | None]] = []
    for folder, bag in zip(maps, bags):
        new = {entry.old: entry.new for entry in entries[str(folder)].surfaces}
        tops = surfaces_of_tops(folder, bag)
        ids = ids or [set() for _ in tops]
        for known, surfaces in zip(ids, tops):
            known |= {new[surface["id"]] for surface in surfaces[:1]}
    print(f"\n{sum(len(known) == 1 for known in ids)} of {len(ids)} tops have one id")


def bench_other(folder: Path) -> None:
    """Merge the maps of a flat with those of another one with the same walls."""
    bags = [write_drives(folder / "bags", building) for building in ("flat", "other")]
    bags = [bags[0], bags[1][:2]]
    maps = [maps_of(group, folder / "maps") for group in bags]
    merged = merge([*maps[0], *maps[1]], folder / "merged flat and other")
    parts = [merged.out / component.folder for component in merged.content.components]
    print_errors(parts, [group[0] for group in bags])


def bench_log(folder: Path, log: Path) -> None:
    """Merge a log's parts; compare its relations with those of the whole."""
    bag, parts = folder / "bags" / "intel", folder / "bags" / "intel parts"
    if not bag.exists():
        import_carmen(log, bag)
    if not parts.exists():
        with tempfile.TemporaryDirectory(dir=bag.parent) as made:
            split_bag(next(bag.glob("*.mcap")), made, PARTS)
            Path(made).rename(parts)
            Path(made).mkdir()
    whole, *maps = maps_of([bag, *sorted(parts.iterdir())], folder / "maps")
    merged = merge(maps, folder / "merged intel")
    compare_relations(log, bag, whole, merged)


def compare_relations(log: Path, bag: Path, whole: Path, merged: MergeSummary) -> None:
    """Print the relations of a log's whole map and of the merged one."""
    truth = read_reference(log.with_name("intel_reference.txt"))
    stamps = read_stamps(bag / "stamps.csv")
    asked = np.array([stamps[int(k)] for k in truth.scan_index])
    i, j = pairs_that_meet(truth.poses[:, :3, 3]).T
    found = [poses_in_whole(whole, asked), poses_in_merged(merged, asked)]
    is_known = np.logical_and.reduce([np.isfinite(poses[:, 0, 0]) for poses in found])
    kept = is_known[i] & is_known[j]
    i, j = i[kept], j[kept]
    print(
        "\n| relations of intel | pairs | mean, m | median, m | mean, deg |\n|---|---|---|---|---|"
    )
    deltas = inverse(truth.poses[i]) @ truth.poses[j]
    for name, poses in zip(("whole", "merged"), found):
        print_relations(name, relation_errors(poses[i], poses[j], deltas))
    deltas = inverse(found[0][i]) @ found[0][j]
    print_relations("merged against whole", relation_errors(found[1][i], found[1][j], deltas))


def print_relations(name: str, errors: Errors) -> None:
    """Print a row of a table."""
    metres, degrees = errors.translation, np.degrees(errors.rotation)
    cells = f"{len(errors)} | {metres.mean():.4f} | {np.median(metres):.4f} | {degrees.mean():.3f}"
    print(f"| {name} | {cells} |", flush=True)


def poses_in_whole(folder: Path, asked_ns: Int64) -> Float64:
    """Return the poses (N, 4, 4) of a result folder's trajectory; nan where it has none."""
    trajectory = read_tum(folder / "trajectory.tum")
    poses, is_known = poses_at(trajectory.stamps_ns, trajectory.T_map_base, asked_ns)
    poses[~is_known] = np.nan
    return poses


def poses_in_merged(merged: MergeSummary, asked_ns: Int64) -> Float64:
    """Return the poses (N, 4, 4) of all trajectories, moved with the keyframe before; or nan."""
    saved = load_map(merged.out / "map.mcap").walls
    stamps, poses = np.asarray(saved["keyframe_stamp_ns"]), np.asarray(saved["keyframe_pose"])
    order = np.argsort(stamps)
    found = np.full((len(asked_ns), 4, 4), np.nan)
    for entry in merged.content.components[0].maps:
        own = poses_in_whole(Path(entry.map), asked_ns)
        at_keyframes = poses_in_whole(Path(entry.map), stamps)
        for k in np.flatnonzero(np.isfinite(own[:, 0, 0])):
            before = order[np.searchsorted(stamps[order], asked_ns[k], side="right") - 1]
            T_keyframe = between2(planar(at_keyframes[before][None]), planar(own[k][None]))
            found[k] = spatial(compose2(poses[before], T_keyframe[0]))
    return found


def main() -> None:
    """Run the cases."""
    cases = ("flat", "other", "ring", "intel")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=list(cases))
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "tccm_merge")
    default = os.environ.get("TCCM_SHARED", HERE.parents[1] / "shared")
    parser.add_argument("--shared", type=Path, default=Path(default))
    arguments = parser.parse_args()
    for case in arguments.cases:
        log = arguments.shared / "data" / "carmen" / "intel.clf.bz2"
        if case not in cases:
            parser.error(f"no case {case}; there are: {', '.join(cases)}")
        elif case == "other":
            bench_other(arguments.folder)
        elif case != "intel":
            bench_building(arguments.folder, case)
        elif log.exists():
            bench_log(arguments.folder, log)
        else:
            print(f"intel: {log} is not here")


if __name__ == "__main__":
    main()
