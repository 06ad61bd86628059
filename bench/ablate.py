"""Effect of each named constant, and of each rule, of surfaces and outlines on saved views.

    python bench/ablate.py --save bags/flat bags/rgbd_kitchen ../shared/data/real/hololens
    python bench/ablate.py --out TABLE.md [--only NAME ...]

The first command replays recordings and keeps what the surface map took: records of views, poses
and walls. The second one builds the map of them with one constant halved, doubled or neutralised
(0, or infinite where 0 is no value), or with one rule switched off, and prints what that changes:
the mean overlap with the true surfaces, surfaces that are none, and objects. Trials that the table
has are not run again. Poses are as they were: registration and the cycle are not tried.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import multiprocessing
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from shapely import Polygon

import tccm_ros
from tccm_ros.config import Config
from tccm_ros.replay.run import run_bag
from tccm_ros.surfaces.object_tracks import track_objects
from tccm_ros.surfaces.scene_objects import scene_objects
from tccm_ros.surfaces.surface_map import MappedSurfaces, SurfaceMap

SAVED = Path(tempfile.gettempdir()) / "tccm_ablate"
"""Folder of what is saved."""

ROOMS = ("surfaces", "outlines")

MAX_HEIGHT_ERROR = 0.04
"""A mapped surface may be a true one within this height, m."""

MIN_OVERLAP = 0.1
"""A mapped surface is one that is there if it covers this fraction of itself with true ones."""

FACTORS = {"half": 0.5, "double": 2.0, "zero": 0.0}

RULES: dict[str, tuple[str, Callable[..., Any]]] = {}
"""Rules that are switched off: name of a function, and what stands in for it."""


def save(bag: Path) -> None:
    """Replay a recording and keep the records, poses and walls of its surface map."""
    kept: dict[str, Any] = {"records": []}
    add, build = SurfaceMap.add, SurfaceMap.build

    def adding(self: SurfaceMap, record: Any) -> None:
        kept["records"].append(record)
        add(self, record)

    def building(self: SurfaceMap, poses: Any, walls: Any = None) -> MappedSurfaces:
        kept.update(keys=[view.key for view in self.views], poses=poses, walls=walls)
        return build(self, poses, walls)

    SurfaceMap.add, SurfaceMap.build = adding, building  # type: ignore[method-assign]
    try:
        kept["objects"] = len(run_bag(bag, Config()).solution.objects)
    finally:
        SurfaceMap.add, SurfaceMap.build = add, build  # type: ignore[method-assign]
    kept["truth"] = json.loads((bag / "truth.json").read_text())
    SAVED.mkdir(exist_ok=True)
    (SAVED / f"{bag.name}.pkl").write_bytes(pickle.dumps(kept))


def built(kept: dict[str, Any]) -> tuple[MappedSurfaces, int]:
    """Return the map of what was kept, and its number of objects."""
    config = Config()
    surface_map = SurfaceMap(config)
    for record in kept["records"]:
        surface_map.add(record)
    for key in set(surface_map._views) - set(kept["keys"]):
        del surface_map._views[key]
    mapped = surface_map.build(kept["poses"], kept["walls"])
    tracks = track_objects(surface_map.views, kept["poses"].T_map_view, config).tracks
    return mapped, len(scene_objects(mapped.surfaces, tracks))


def scores(kept: dict[str, Any]) -> tuple[float, int, int, float]:
    """Return mean overlap, surfaces that are none, objects, and the time, s."""
    start = time.monotonic()
    mapped, objects = built(kept)
    truth, floor = kept["truth"], mapped.floor_z or 0.0
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


def constants() -> Iterator[tuple[str, str, Any]]:
    """Return module, name and value of each numeric constant of the rooms."""
    root = Path(tccm_ros.__file__).parent
    for room in ROOMS:
        for path in sorted((root / room).glob("*.py")):
            module = f"tccm_ros.{room}.{path.stem}"
            for node in ast.parse(path.read_text()).body:
                if isinstance(node, ast.Assign):
                    for name in ast.walk(node.targets[0]):
                        if isinstance(name, ast.Name) and name.id.isupper():
                            value = getattr(importlib.import_module(module), name.id)
                            if isinstance(value, int | float | tuple) and not isinstance(value, bool):
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


def trial(change: tuple[str, str, str], recordings: list[str], results: Any) -> None:
    """Run one trial in a process of its own, and put its scores into `results`."""
    module, name, how = change
    if how == "off":
        function = getattr(importlib.import_module(module), name)
        set_everywhere(name, function, RULES[name][1])
    elif module:
        value = getattr(importlib.import_module(module), name)
        set_everywhere(name, value, scaled(value, FACTORS[how]))
    for recording in recordings:
        kept = pickle.loads((SAVED / f"{recording}.pkl").read_bytes())
        try:
            results.put((recording, *scores(kept)))
        except Exception as error:  # a trial may break what it tries
            results.put((recording, type(error).__name__))
    results.put(None)


def run(change: tuple[str, str, str], recordings: list[str]) -> list[Any]:
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
        f"{row[1]:.4f} {row[2]} {row[3]}" if len(row) > 2 else str(row[1]) for row in rows
    ]
    module = change[0].removeprefix("tccm_ros.")
    return f"| {module} | {change[1]} | {change[2]} | " + " | ".join(cells) + " |"


def main() -> None:
    """Save recordings, or run the trials that the table does not have."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", nargs="+", type=Path, default=[])
    parser.add_argument("--out", type=Path, default=SAVED / "table.md")
    parser.add_argument("--only", nargs="*", default=[], help="names, or modules")
    parser.add_argument("--how", nargs="*", default=["zero", "half", "double"])
    parser.add_argument("--on", nargs="*", default=[], help="names of saved recordings")
    arguments = parser.parse_args()
    for bag in arguments.save:
        save(bag)
    if arguments.save:
        return
    recordings = arguments.on or sorted(path.stem for path in SAVED.glob("*.pkl"))
    out: Path = arguments.out
    if not out.exists():
        titles = " | ".join(f"{name}: overlap, others, objects" for name in recordings)
        out.write_text(f"| module | name | change | {titles} |\n{'|---' * (len(recordings) + 3)}|\n")
    done = {tuple(line.split(" | ")[:3]) for line in out.read_text().splitlines()}
    changes = [("", "", "none")]
    for module, name, _ in constants():
        if not arguments.only or name in arguments.only or module.split(".")[-1] in arguments.only:
            changes += [(module, name, how) for how in arguments.how]
    changes += [(m, n, "off") for n, (m, _) in RULES.items() if n in arguments.only or not arguments.only]
    for change in changes:
        if ("| " + change[0].removeprefix("tccm_ros."), *change[1:]) in done:
            continue
        line = row_of(change, run(change, recordings))
        with out.open("a") as file:
            file.write(line + "\n")
        print(line, flush=True)


if __name__ == "__main__":
    main()
