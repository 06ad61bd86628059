"""Effect of each named constant, and of some rules, of the rooms from points to surfaces.

    python bench/ablate.py --out TABLE.md RESULT=BAG ... [--only NAME ...]
    python bench/ablate.py --out TABLE.md FILE.pkl ... [--only NAME ...]

RESULT is the folder of a `tccm replay` of BAG, whose truth.json holds the true surfaces. The map of
its views, outlined anew, at their poses, is built with one constant halved, doubled or set to zero,
or with one rule switched off. A row has for each recording the mean overlap with the true surfaces,
surfaces of 0.1 m2 that are none, and objects. Registration and the patches of views are not tried
in this way.

FILE.pkl holds tilt cycles (`saved_cycles.py`), for constants and rules of planes and objects on
them; its rows are those of `saved_cycles`. A constant of a kernel is compiled into it, and each
trial compiles it anew. Trials that the table has are not run again.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from saved_cycles import load as load_cycles
from shapely import Polygon

import tccm_ros
from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.kernels import kernel
from tccm_ros.records import SensorKind
from tccm_ros.results.map_file import load_map
from tccm_ros.surfaces import outline as outline_module
from tccm_ros.surfaces.object_tracks import track_objects
from tccm_ros.surfaces.scene_objects import scene_objects
from tccm_ros.surfaces.surface_map import MappedSurfaces, SurfaceMap, ViewPoses
from tccm_ros.surfaces.views import Patch, View

ROOMS = ("surfaces", "outlines")
CYCLE_ROOMS = ("planes", "tabletop", "cuboids", "mapping")
"""Rooms whose constants are tried on views, and on tilt cycles."""

MAX_HEIGHT_ERROR = 0.04
"""A mapped surface may be a true one within this height, m."""

MIN_OVERLAP = 0.1
"""A mapped surface is one that is there if it covers this fraction of itself with true ones."""


FACTORS = {"half": 0.5, "double": 2.0, "zero": 0.0}

RULES: dict[str, tuple[str, Callable[..., Any]]] = {
    "_reaches_wall": ("tccm_ros.surfaces.shapes", lambda *_: False),
    "_to_ends_of_fronts": ("tccm_ros.surfaces.shapes", lambda model, *_: model),
    "doubting_wall_points": ("tccm_ros.surfaces.shapes", lambda samples, _: samples),
    "wall_across": ("tccm_ros.surfaces.edge_walls", lambda *_: None),
    "_with_occluded_areas": ("tccm_ros.surfaces.merged_surface", lambda polygon, *_: polygon),
    "is_sparse": ("tccm_ros.surfaces.merged_surface", lambda *_: False),
    "join_over_occlusions": ("tccm_ros.surfaces.joining", lambda pieces, *_: list(pieces)),
    "_is_wall_between": ("tccm_ros.surfaces.joining", lambda *_: False),
    "expected_area": ("tccm_ros.surfaces.outline", lambda area, _: area),
    "_is_part": ("tccm_ros.surfaces.scene_objects", lambda *_: False),
}
"""Rules that are switched off: module of a function, and what stands in for it."""

CYCLE_RULES: dict[str, tuple[str, Callable[..., Any]]] = {
    "horizontal_strips": ("tccm_ros.mapping.surface_message", lambda _, __, surface, ___: surface),
    "top_planes": (
        "tccm_ros.mapping.surface_message",
        lambda points, *_: np.full(len(points), -1, np.int64),
    ),
    "are_too_thick": (
        "tccm_ros.mapping.surface_message",
        lambda _, __, normals, *___: np.zeros(len(normals), np.bool_),
    ),
    "best_split": ("tccm_ros.planes.horizontal_strips", kernel(lambda sums, low, high: -1)),
    "find_vertical_runs": (
        "tccm_ros.planes.horizontal_strips",
        lambda *arguments: np.zeros(len(arguments[-1]), np.bool_),
    ),
    "_plane_of_runs": (
        "tccm_ros.planes.horizontal_strips",
        lambda _, __, runs: np.full(runs, -1, np.int64),
    ),
    "part_by_height": ("tccm_ros.tabletop.objects", lambda mean, *_: [np.arange(len(mean))]),
    "part_around": ("tccm_ros.tabletop.objects", lambda mean, *_: [np.arange(len(mean))]),
    "_carries": ("tccm_ros.tabletop.objects", lambda *_: False),
    "drop_edge_planes": (
        "tccm_ros.planes.search",
        kernel(lambda cuboids, blocks, labels, planes, is_vertical: planes),
    ),
    "reassign_inliers": (
        "tccm_ros.planes.search",
        kernel(lambda M, blocks, labels, planes, is_vertical: planes),
    ),
}
"""The same for tilt cycles."""


class Saved(NamedTuple):
    """Views, their poses, walls (W, 2, 2) and truth.json of a recording."""

    views: list[View]
    poses: ViewPoses
    walls: Float64
    truth: dict[str, Any]


def load(result: Path, bag: Path) -> Saved:
    """Return what a replay has saved, and the truth."""
    saved = load_map(result / "map.mcap").views
    graph = json.loads((result / "graph.json").read_text())
    walls = json.loads((result / "walls.json").read_text())["walls"]
    keyframes = {k["id"]: spatial(np.array(k["pose"])) for k in graph["keyframes"]}
    anchors = [keyframes[s.keyframe] if s.is_on_keyframe else np.eye(4) for s in saved]
    poses = ViewPoses(
        np.stack([T @ s.T_anchor_view for T, s in zip(anchors, saved)]),
        np.stack([s.cov_z_roll_pitch for s in saved]),
        np.array([s.keyframe for s in saved]),
    )
    lines = np.array([wall["endpoints"] for wall in walls]).reshape(-1, 2, 2)
    truth = json.loads((bag / "truth.json").read_text())
    return Saved([s.view for s in saved], poses, lines, truth)


def built(saved: Saved) -> tuple[MappedSurfaces, int]:
    """Return the map of saved views, and its number of objects."""
    config = Config()
    surface_map = SurfaceMap(config)
    for view in saved.views:
        patches = tuple(_outlined(patch, view.sensor) for patch in view.patches)
        surface_map.add_view(replace(view, patches=patches))
    mapped = surface_map.build(saved.poses, saved.walls)
    tracks = track_objects(saved.views, saved.poses.T_map_view, config).tracks
    return mapped, len(scene_objects(mapped.surfaces, tracks))


def _outlined(patch: Patch, sensor: SensorKind) -> Patch:
    """Return a patch with the outline of its points."""
    distance = Config().surfaces.merge_distance
    outline, spacing = outline_module.horizontal_outline(
        patch.points[:, :2].astype(np.float64), distance, sensor
    )
    return replace(patch, outline=outline, spacing=spacing)


def scores(saved: Saved) -> tuple[float, int, int, float]:
    """Return mean overlap, surfaces that are none, objects, and the time, s."""
    start = time.monotonic()
    mapped, objects = built(saved)
    truth, floor = saved.truth, mapped.floor_z or 0.0
    is_part = {"free"}  # of real rooms: the part that was in view
    true = [
        (Polygon([p[:2] for p in s["boundary"]]), _height(s, truth), s["label"] in is_part)
        for s in truth["surfaces"]
        if s["label"] != "floor"
    ]
    found = [s for s in mapped.surfaces if s.label != "floor" and s.area >= 0.1]
    whole = [Polygon(s.boundary[:, :2]).buffer(0) for s in found]
    seen = [Polygon(s.boundary_seen[:, :2]).buffer(0) for s in found]
    heights = [float(s.boundary[:, 2].mean()) - floor for s in found]
    overlaps, is_there = [], np.zeros(len(found), bool)
    for outline, height, part in true:
        best = 0.0
        for k, mine in enumerate(seen if part else whole):
            if abs(heights[k] - height) <= MAX_HEIGHT_ERROR:
                shared = mine.intersection(outline).area
                is_there[k] |= shared > MIN_OVERLAP * mine.area
                best = max(best, shared / (mine.area + outline.area - shared))
        overlaps.append(best)
    others = int((~is_there).sum())
    return float(np.mean(overlaps)), others, objects, time.monotonic() - start


def _height(surface: dict[str, Any], truth: dict[str, Any]) -> float:
    """Return the height of a true surface over the floor, m."""
    if "floor" in truth:
        return float(surface["height"]) - float(truth["floor"])
    return float(np.mean([p[2] for p in surface["boundary"]])) - float(truth.get("floor_z") or 0.0)


def constants(rooms: Sequence[str]) -> Iterator[tuple[str, str, Any]]:
    """Return module, name and value of each numeric constant of some rooms."""
    root = Path(tccm_ros.__file__).parent
    for room in rooms:
        for path in sorted((root / room).glob("*.py")):
            module = f"tccm_ros.{room}.{path.stem}"
            for node in ast.parse(path.read_text()).body:
                if isinstance(node, ast.Assign):
                    for name in ast.walk(node.targets[0]):
                        if isinstance(name, ast.Name) and name.id.isupper():
                            value = getattr(importlib.import_module(module), name.id)
                            if isinstance(value, int | float | tuple) and not isinstance(
                                value, bool
                            ):
                                yield module, name.id, value


def set_everywhere(name: str, old: Any, new: Any) -> None:
    """Give a name of the package another value in all modules that have it."""
    for key, module in list(sys.modules.items()):
        if key.startswith("tccm_ros") and getattr(module, name, None) is old:
            setattr(module, name, new)


def scaled(value: Any, factor: float) -> Any:
    """Return a constant times a factor; integers stay integers."""
    if isinstance(value, tuple):
        return tuple(scaled(v, factor) for v in value)
    if isinstance(value, int):
        return round(value * factor)
    return value * factor


def trial(change: tuple[str, str, str], recordings: Sequence[Any], results: Any) -> None:
    """Run one trial in a process of its own, and put its scores into `results`."""
    module, name, how = change
    if how == "off":
        function = getattr(importlib.import_module(module), name)
        set_everywhere(name, function, (RULES | CYCLE_RULES)[name][1])
    elif module:
        value = getattr(importlib.import_module(module), name)
        set_everywhere(name, value, scaled(value, FACTORS[how]))
    for saved in recordings:
        try:
            results.put(scores(saved) if isinstance(saved, Saved) else saved.row())
        except Exception as error:  # a trial may break what it tries
            results.put((type(error).__name__,))
    results.put(None)


def run(change: tuple[str, str, str], recordings: Sequence[Any]) -> list[Any]:
    """Return the scores of one trial."""
    context = multiprocessing.get_context("fork")
    results = context.Queue()
    process = context.Process(target=trial, args=(change, recordings, results))
    process.start()
    rows = list(iter(results.get, None))
    process.join()
    return rows


def row_of(change: tuple[str, str, str], rows: list[Any]) -> str:
    """Return a row of the table."""
    cells = [
        row if isinstance(row, str) else f"{row[0]:.4f} {row[1]} {row[2]}" if row[1:] else row[0]
        for row in rows
    ]
    return " | ".join(("| " + change[0].removeprefix("tccm_ros."), *change[1:], *cells)) + " |"


def main() -> None:
    """Run the trials that the table does not have."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("saved", nargs="+", help="RESULT=BAG, or FILE.pkl")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[], help="names of constants, rules, modules")
    parser.add_argument("--how", nargs="*", default=list(FACTORS), choices=list(FACTORS))
    arguments = parser.parse_args()
    pairs = [argument.partition("=") for argument in arguments.saved]
    recordings: list[Any] = [
        load(Path(name), Path(bag)) if bag else load_cycles(Path(name)) for name, _, bag in pairs
    ]
    of_cycles = not pairs[0][2]
    rooms, rules = (CYCLE_ROOMS, CYCLE_RULES) if of_cycles else (ROOMS, RULES)
    out, only = arguments.out, set(arguments.only)
    if not out.exists():
        titles = " | ".join(Path(bag or name).stem for name, _, bag in pairs)
        rule = "|---" * (len(pairs) + 3)
        out.write_text(f"| module | name | change | {titles} |\n{rule}|\n")
    done = {tuple(line.split(" | ")[:3]) for line in out.read_text().splitlines()}
    changes = [("", "", "none")]
    for module, name, _ in constants(rooms):
        if not only or only & {name, module.rsplit(".", 1)[-1]}:
            changes += [(module, name, how) for how in arguments.how]
    changes += [(rule[0], name, "off") for name, rule in rules.items() if not only or name in only]
    for change in changes:
        if ("| " + change[0].removeprefix("tccm_ros."), *change[1:]) not in done:
            line = row_of(change, run(change, recordings))
            with out.open("a") as file:
                file.write(line + "\n")
            print(line, flush=True)


if __name__ == "__main__":
    main()
