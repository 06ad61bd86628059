"""Effect of each named constant, and of some rules, of surfaces and outlines on the map.

    python bench/ablate_views.py --out TABLE.md RESULT=BAG ... [--groups] [--only NAME ...]

BAG is a recording with truth.json, or the seed of a sequence of `bench_changes.py`. RESULT is the
folder of its replay, which is made if there is none; it keeps what the map was built from. The
views are made anew from their clouds, registered, and the map is built at the poses of the replay,
with one constant halved, doubled or set to zero, with all constants of a module so (`--groups`), or
with one rule switched off.

A row has for each recording the mean overlap with the true surfaces, surfaces of 0.1 m2 that are
none, objects, factors of registration, and their median error in position against the poses of
the replay, mm; of a sequence the true events that are told, wrong ones, and surfaces. It has "same"
where nothing at all changes, labels, edges, sigmas and ids included. Each trial compiles the
kernels that it changes. Trials that the table has are not run again. The cycle before the surface
clouds is not tried.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import importlib
import json
import pickle
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import saved_rooms
from ablation import (
    Change,
    add_row,
    constants,
    in_process,
    is_done,
    scaled,
    set_constant,
    set_everywhere,
)
from saved_rooms import Rooms
from shapely import Polygon

from tccm_ros.arrays import Bool, Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse
from tccm_ros.replay.replay import replay
from tccm_ros.slam.factors.keys import view_key
from tccm_ros.slam.solution import Solution
from tccm_ros.surfaces.objects.object_tracks import track_objects
from tccm_ros.surfaces.objects.scene_objects import scene_objects
from tccm_ros.surfaces.registration.registration import Registration
from tccm_ros.surfaces.surface_map import MappedSurfaces, SurfaceMap, ViewPoses
from tccm_ros.surfaces.views.views import View

FOLDERS = ("surfaces", "outlines")

MAX_HEIGHT_ERROR = 0.04
"""A mapped surface may be a true one within this height, m."""

MIN_OVERLAP = 0.1
"""A mapped surface is one that is there if it covers this fraction of itself with true ones."""


FACTORS = {"half": 0.5, "double": 2.0, "zero": 0.0, "huge": 1e6}

VIEWS = "tccm_ros.surfaces.views.views"
"""Module that makes views."""

REGISTRATION = "tccm_ros.surfaces.registration.registration"
"""Module that finds factors between views."""

MAP = "tccm_ros.surfaces.surface_map", "tccm_ros.surfaces.objects.scene_objects"
"""Modules that build the map and its objects."""

SURFACES = "tccm_ros.surfaces."


def _none_of(points: Float64, *_: Any) -> Bool:
    return np.zeros(len(points), bool)


RULES: dict[str, tuple[str, Callable[..., Any]]] = {
    "mark_strays": ("views.views", _none_of),
    "_was_moved": ("merging.carving", lambda *_: False),
    "_in_block": ("merging.carving", lambda points, chosen, size: chosen),
    "_with_strays": ("merging.carving", lambda gone, keep: gone),
    "_with_occluded_areas": ("merging.merged_surface", lambda polygon, *_: polygon),
    "is_sparse": ("merging.merged_surface", lambda *_: False),
    "join_over_occlusions": ("merging.joining", lambda pieces, *_: list(pieces)),
    "join_floor": ("merging.floor", lambda surfaces, *_: surfaces),
    "_is_wall_between": ("merging.joining", lambda *_: False),
    "expected_area": ("views.outline", lambda area, _: area),
    "_refined": ("edges.shapes", lambda model, *_: (model, np.full(len(model.corners()), 0.01))),
    "_refined_round": ("edges.shapes", lambda model, _: (model, np.full(64, 0.01))),
    "_reaches_wall": ("edges.shapes", lambda *_: False),
    "_to_ends_of_fronts": ("edges.shapes", lambda model, *_: model),
    "downweight_wall_points": ("edges.shapes", lambda samples, _: samples),
    "wall_across": ("edges.edge_walls", lambda *_: None),
    "_walls_behind": ("edges.edge_walls", lambda *_: iter(())),
    "_is_crossed": ("edges.edge_walls", lambda *_: False),
    "EdgeSampler._line_ends": (
        "edges.edge_samples",
        lambda self, *edge: self._pieces(*edge),
    ),
    "EdgeSampler.ragged_sigma": ("edges.edge_samples", lambda *_: 0.0),
    "EdgeSampler.shared_sigma": ("edges.edge_samples", lambda *_: 0.0),
    "EdgeSampler.seen_fraction": ("edges.edge_samples", lambda *_: 1.0),
    "EdgeSampler.reached_fraction": ("edges.edge_samples", lambda *_: 0.0),
    "EdgeSampler.hides": ("edges.edge_samples", lambda *_: False),
    "adopt_ids": ("identity.recognition", lambda surfaces, *_: (surfaces, {})),
    "_PlacedSurface.lies_close_to": ("identity.recognition", lambda *_: False),
    "_views_over": ("objects.object_tracks", lambda tracks, *_: np.zeros(len(tracks), np.int64)),
    "_is_lower": ("objects.object_tracks", lambda *_: False),
    "without_noise": ("objects.object_footprints", lambda footprint, *_: footprint),
    "joined_footprint": ("objects.object_footprints", lambda older, newest, *_: newest),
    "_is_part": ("objects.scene_objects", lambda *_: False),
    "_has_rival": ("registration.side_matching", lambda *_: False),
    "variance_factor": ("registration.registration", lambda *_: 1.0),
    "_remaining": ("registration.registration", lambda sides, _: sides),
}
"""Rules that are switched off: module of a function, and what stands in for it."""


class Saved(NamedTuple):
    """What the map of a recording was built from.

    Attributes
    ----------
    records
        Records of all views, as `SurfaceMap.add` takes them.
    keys
        Views of the last solution: session and stamp.
    prior
        Solution of the graph without registration.
    poses, walls
        Arguments of the last `SurfaceMap.build`.
    truth
        Content of truth.json.
    """

    records: list[Any]
    keys: list[tuple[int, int]]
    prior: Solution | None
    poses: ViewPoses
    walls: Float64
    truth: dict[str, Any]


class Stage(NamedTuple):
    """Result of a stage on one recording: what the table shows, and a digest of everything."""

    text: str
    digest: str


Trial = tuple[Stage, Stage]
"""Results of the map and of registration on one recording."""

NOT_TRIED: Trial = Stage("", ""), Stage("", "")


class Known(NamedTuple):
    """A recording, its views (none of a sequence) and its results without a change."""

    saved: Saved | Rooms
    views: list[View]
    trial: Trial


def load(result: Path, bag: Path, max_views: int) -> Saved | Rooms:
    """Return what a replay has kept, and the truth; replay the recording if there is no replay.

    Of more than `max_views` views, so many evenly spaced ones are used.
    """
    kept = result / "kept.pickle"
    if bag.name.isdecimal():
        if not kept.exists():
            result.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(pickle.dumps(saved_rooms.record(int(bag.name))))
        rooms: Rooms = pickle.loads(kept.read_bytes())
        return rooms
    if not kept.exists():
        _replay(result, bag)
    truth = json.loads((bag / "truth.json").read_text())
    saved: Saved = pickle.loads(kept.read_bytes())
    count = len(saved.keys)
    chosen = np.unique(np.linspace(0, count - 1, min(max_views, count)).astype(int))
    poses, prior = saved.poses, saved.prior
    if prior is not None:
        T, cov, keyframes = prior.T_map_views, prior.cov_views, prior.view_keyframes
        prior = replace(
            prior, T_map_views=T[chosen], cov_views=cov[chosen], view_keyframes=keyframes[chosen]
        )
    return saved._replace(
        keys=[saved.keys[k] for k in chosen],
        prior=prior,
        poses=ViewPoses(
            poses.T_map_view[chosen], poses.cov_z_roll_pitch[chosen], poses.keyframes[chosen]
        ),
        truth=truth,
    )


def _replay(result: Path, bag: Path) -> None:
    """Replay a recording and keep the inputs of its map beside the results."""
    records: list[Any] = []
    last: dict[str, Any] = {"prior": None}
    add, build, side_factors = SurfaceMap.add, SurfaceMap.build, Registration.side_factors

    def kept_add(surface_map: SurfaceMap, record: Any) -> None:
        records.append(record)
        add(surface_map, record)

    def kept_build(surface_map: SurfaceMap, poses: ViewPoses, walls: Float64) -> MappedSurfaces:
        last.update(keys=[view.key for view in surface_map.views], poses=poses, walls=walls)
        return build(surface_map, poses, walls)

    def kept_factors(registration: Registration, views: Any, known: Solution) -> Any:
        last.update(prior=known)
        return side_factors(registration, views, known)

    with (
        mock.patch.object(SurfaceMap, "add", kept_add),
        mock.patch.object(SurfaceMap, "build", kept_build),
        mock.patch.object(Registration, "side_factors", kept_factors),
    ):
        replay(bag, result, Config(), pictures=False)
    content = Saved(records, last["keys"], last["prior"], last["poses"], last["walls"], {})
    (result / "kept.pickle").write_bytes(pickle.dumps(content))


def digest_of(value: Any) -> str:
    """Return a hash of arrays, records and plain values."""
    found = hashlib.sha256()

    def add(item: Any) -> None:
        if isinstance(item, np.ndarray):
            found.update(np.ascontiguousarray(item).tobytes())
        elif is_dataclass(item):
            add([getattr(item, field.name) for field in fields(item)])
        elif isinstance(item, list | tuple):
            for part in item:
                add(part)
        else:
            found.update(repr(item).encode())

    add(value)
    return found.hexdigest()


def views_of(saved: Saved) -> list[View]:
    """Return the views of the last solution, made from their records."""
    surface_map = SurfaceMap(Config())
    stamps = {stamp for _, stamp in saved.keys}
    for record in saved.records:
        if record.stamp_ns in stamps:
            surface_map.add(record)
    return surface_map.views


def registered(saved: Saved, views: list[View]) -> Stage:
    """Return the number of factors between views, and their median error in position, mm."""
    if saved.prior is None:
        return Stage("", "")
    registration = Registration(Config())
    factors = registration.side_factors(views, saved.prior)
    levelled = registration.with_adjusted_planes(saved.prior).T_map_views
    T_map = {view_key(v.stamp_ns): T for v, T in zip(views, saved.poses.T_map_view)}
    moved = [inverse(T_map[f.j]) @ T_map[f.i] @ f.T_i_j for f in factors]
    error = [1e3 * float(np.linalg.norm(T[:2, 3])) for T in moved]
    text = f"{len(error)} {np.median(error):.1f}" if error else "0"
    return Stage(text, digest_of([[(f.T_i_j, f.cov) for f in factors], levelled]))


def built(saved: Saved, views: list[View]) -> Stage:
    """Return mean overlap, surfaces that are none, and objects of the map of views."""
    config = Config()
    surface_map = SurfaceMap(config)
    for view in views:
        surface_map.add_view(view)
    mapped = surface_map.build(saved.poses, saved.walls)
    tracks = track_objects(views, saved.poses.T_map_view, config).tracks
    objects = scene_objects(mapped.surfaces, tracks)
    overlap, others = overlaps(saved, mapped)
    text = f"{overlap:.4f} {others} {len(objects)}"
    return Stage(text, digest_of([mapped.surfaces, objects]))


def overlaps(saved: Saved, mapped: MappedSurfaces) -> tuple[float, int]:
    """Return the mean overlap with true surfaces, and the number of surfaces that are none."""
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
    found_overlaps, is_there = [], np.zeros(len(found), bool)
    for outline, height, part in true:
        best = 0.0
        for k, mine in enumerate(seen if part else whole):
            if abs(heights[k] - height) <= MAX_HEIGHT_ERROR:
                shared = mine.intersection(outline).area
                is_there[k] |= shared > MIN_OVERLAP * mine.area
                best = max(best, shared / (mine.area + outline.area - shared))
        found_overlaps.append(best)
    return float(np.mean(found_overlaps)), int((~is_there).sum())


def _height(surface: dict[str, Any], truth: dict[str, Any]) -> float:
    """Return the height of a true surface over the floor, m."""
    if "floor" in truth:
        return float(surface["height"]) - float(truth["floor"])
    return float(np.mean([p[2] for p in surface["boundary"]])) - float(truth.get("floor_z") or 0.0)


def switch_off(module: ModuleType, name: str) -> None:
    """Replace a function, or the method of a class, by what stands in for it."""
    owner, _, method = name.partition(".")
    if method:
        setattr(getattr(module, owner), method, RULES[name][1])
    else:
        set_everywhere(name, getattr(module, name), RULES[name][1])


def known(saved: Saved | Rooms) -> Known:
    """Return a recording with its results without a change."""
    views = [] if isinstance(saved, Rooms) else views_of(saved)
    return Known(saved, views, tried(Known(saved, views, NOT_TRIED), ""))


def tried(known: Known, module: str) -> Trial:
    """Return the results on a recording after a change of a module.

    Stages that do not use the module have their results without a change.
    """
    saved, views, before = known
    is_by_map = not module or any(module in used_by(maker) for maker in MAP)
    if isinstance(saved, Rooms):
        if not is_by_map:
            return before
        text, found = saved.row()
        return Stage(text, digest_of(found)), before[1]
    if module in used_by(VIEWS):
        views = views_of(saved)
    return (
        built(saved, views) if is_by_map else before[0],
        registered(saved, views) if not module or module in used_by(REGISTRATION) else before[1],
    )


@cache
def used_by(module: str) -> frozenset[str]:
    """Return a module of the package, and those that it imports, directly or not."""
    found, new = {module}, [module]
    while new:
        source = Path(importlib.import_module(new.pop()).__file__ or "").read_text()
        imported = {n.module for n in ast.walk(ast.parse(source)) if isinstance(n, ast.ImportFrom)}
        folders = tuple(f"tccm_ros.{folder}." for folder in FOLDERS)
        new += [name for name in imported - found if name and name.startswith(folders)]
        found.update(new)
    return frozenset(found)


def apply(change: Change) -> None:
    """Scale constants of a module, or switch a rule off."""
    module, name, how = change
    if how == "off":
        switch_off(importlib.import_module(module), name)
    for _, constant, value in [c for c in constants(FOLDERS) if c[0] == module]:
        if how in FACTORS and name in ("all", constant):
            set_constant(module, constant, scaled(value, FACTORS[how]))


def run(change: Change, recordings: Sequence[Known]) -> list[str]:
    """Return the cells of one trial."""
    found = in_process(lambda: apply(change), lambda one: tried(one, change[0]), recordings)
    return [
        after if isinstance(after, str) else cell(after, one.trial)
        for after, one in zip(found, recordings)
    ]


def cell(after: Trial, before: Trial) -> str:
    """Return a cell of the table."""
    parts = ["same" if a.digest == b.digest else a.text for a, b in zip(after, before)]
    return "same" if parts == ["same", "same"] else ", ".join(filter(None, parts))


def changes_of(only: set[str], how: Sequence[str], *, groups: bool) -> list[Change]:
    """Return the trials: of constants or of modules, and of rules; `only` names them if any."""
    used = set().union(*map(used_by, (VIEWS, REGISTRATION, *MAP)))
    names = [
        (module, "all" if groups else name)
        for module, name, value in constants(FOLDERS)
        if module in used and not hasattr(value, "_fields")
    ]
    found = [
        (module, name, factor)
        for module, name in dict.fromkeys(names)
        if not only or only & {name, module.rsplit(".", 1)[-1]}
        for factor in how
    ]
    rules = [] if groups else RULES.items()
    return [
        *found,
        *((SURFACES + r[0], name, "off") for name, r in rules if not only or name in only),
    ]


def main() -> None:
    """Run the trials that the table does not have."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("saved", nargs="+", help="RESULT=BAG")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[], help="names of constants, rules, modules")
    parser.add_argument("--how", nargs="*", default=list(FACTORS), choices=list(FACTORS))
    parser.add_argument("--max-views", type=int, default=1000, help="of each recording")
    parser.add_argument("--groups", action="store_true", help="all constants of a module at once")
    arguments = parser.parse_args()
    pairs = [argument.partition("=") for argument in arguments.saved]
    saved = [load(Path(result), Path(bag), arguments.max_views) for result, _, bag in pairs]
    # In a process of its own: kernels that this one has compiled would be those of all trials.
    recordings: list[Known] = in_process(lambda: None, known, saved)
    out = arguments.out
    if not out.exists():
        titles = " | ".join(Path(bag).name for _, _, bag in pairs)
        rule = "|---" * (len(pairs) + 3)
        first = " | ".join(["|  |  | none", *(cell(one.trial, NOT_TRIED) for one in recordings)])
        out.write_text(f"| module | name | change | {titles} |\n{rule}|\n{first} |\n")
    for change in changes_of(set(arguments.only), arguments.how, groups=arguments.groups):
        if not is_done(change, out):
            add_row(change, run(change, recordings), out)


if __name__ == "__main__":
    main()
