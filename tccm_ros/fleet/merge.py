"""`tccm merge`: maps of many robots and sessions of one building become one map in one frame."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client, as_completed
from distributed.scheduler import KilledWorker

from tccm_ros.arrays import Float64
from tccm_ros.atomic import output_file, output_folder
from tccm_ros.config import Config
from tccm_ros.errors import FleetError, one_line
from tccm_ros.fleet.cluster import Workers, connected
from tccm_ros.fleet.map_inputs import MapInput, checksum_of, find_maps, read_map
from tccm_ros.fleet.pair_matching import (
    PairMatch,
    PairReason,
    match_files,
    pair_file,
    read_pair,
)
from tccm_ros.fleet.pair_selection import Component, Pair, select_pairs
from tccm_ros.geometry import compose2, spatial
from tccm_ros.progress import Bars, Silent
from tccm_ros.records import Surface
from tccm_ros.results.exports import write_solution
from tccm_ros.results.map_file import save_map
from tccm_ros.results.models import Vector
from tccm_ros.results.numbers import json_text
from tccm_ros.slam.chain import AnchoredPose
from tccm_ros.slam.landmarks import AnchoredObservation
from tccm_ros.slam.loop_matching import Proposal
from tccm_ros.slam.saved_walls import SavedWalls, pack_walls
from tccm_ros.surfaces.saved_map import SavedMap, SavedView
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution

RECORD = "merge.json"
"""In the folder of a merged map: its maps, their pairs, and the table of ids."""


@dataclass(frozen=True, slots=True)
class IdEntry:
    """Where a surface of a map is in the merged one.

    Attributes
    ----------
    old
        Id in its map.
    new
        Id in the merged map; None: not there any more.
    """

    old: int
    new: int | None


@dataclass(frozen=True, slots=True, eq=False)
class MergedMapEntry:
    """A map in a merged one.

    Attributes
    ----------
    map
        Its path.
    T_map_old
        float64 (3,), planar pose of its frame in that of the merged map, by one match.
    surfaces
        The table of ids.
    """

    map: str
    T_map_old: Vector
    surfaces: tuple[IdEntry, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PairEntry:
    """A pair of maps.

    Attributes
    ----------
    one, other
        Paths of the maps.
    accepted
        Whether it is part of the graph.
    reason
        Why, or why not.
    loops
        Keyframes of the one that were found in the other.
    """

    one: str
    other: str
    accepted: bool
    reason: str
    loops: int


@dataclass(frozen=True, slots=True, eq=False)
class ComponentEntry:
    """A component: maps in one frame.

    Attributes
    ----------
    folder
        Of its files, within that of the result; ``.``: that itself.
    maps
        In it.
    """

    folder: str
    maps: tuple[MergedMapEntry, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MergeFile:
    """merge.json: what was merged.

    Attributes
    ----------
    components
        The largest first.
    pairs
        All that were matched.
    identical
        Maps that are the same bytes as an earlier one and were not merged with it.
    """

    components: tuple[ComponentEntry, ...]
    pairs: tuple[PairEntry, ...]
    identical: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class MergeSummary:
    """A finished merge.

    Attributes
    ----------
    out
        Folder of the result.
    content
        Of merge.json.
    matched
        Pairs that were matched now; the others were remembered.
    """

    out: Path
    content: MergeFile
    matched: int

    def to_json(self) -> dict[str, Any]:
        """Return the numbers as plain data."""
        sizes = [len(component.maps) for component in self.content.components]
        pairs = self.content.pairs
        return {
            "out": str(self.out),
            "components": sizes,
            "pairs": len(pairs),
            "accepted": sum(pair.accepted for pair in pairs),
            "matched": self.matched,
            "identical": self.content.identical,
        }

    def text(self) -> str:
        """Return a few lines for a terminal."""
        lines = [
            f"{name}: the same bytes as another map; --same-building merges the two"
            for name in self.content.identical
        ]
        first, *others = self.content.components
        lines.append(f"{len(first.maps)} maps merged: {self.out / 'surfaces.json'}")
        for component in others:
            names = ", ".join(entry.map for entry in component.maps)
            lines.append(f"shares nothing with it: {names} ({self.out / component.folder})")
        accepted = sum(pair.accepted for pair in self.content.pairs)
        lines.append(
            f"{len(self.content.pairs)} pairs, {accepted} accepted, {self.matched} matched now"
        )
        lines.append(f"ids       {self.out / RECORD}")
        return "\n".join(lines)


def merge_maps(
    sources: Sequence[Path],
    out: Path | str,
    config: Config,
    *,
    same_building: bool = False,
    workers: Workers | None = None,
    bars: Bars | None = None,
) -> MergeSummary:
    """Merge maps, and write the result: the largest component, and folders of the others.

    Parameters
    ----------
    sources
        Map files, result folders, or folders of fleets; the frame is that of a component's first.
    out
        Folder of the result; matches are remembered in another one beside it.
    config
        Of matching, graph and surfaces.
    same_building
        Whether maps of the same bytes are of one place; else they may be of two that are equal.
    workers
        To match pairs; None: one.
    bars
        Shows the progress.

    Raises
    ------
    FleetError
        For fewer than two maps, or where no worker could match a pair.
    MapError
        If a map is damaged or has no walls.
    OutputError
        If the result cannot be written.
    """
    bars, out = bars or Silent(), Path(out).absolute()
    paths = [path.absolute() for path in find_maps(sources)]
    checksums = [checksum_of(path) for path in paths]
    first = {checksum: k for k, checksum in reversed(list(enumerate(checksums)))}
    twins = [k for k, checksum in enumerate(checksums) if first[checksum] != k]
    used = [k for k in range(len(paths)) if k not in twins]
    files = {
        (i, j): pair_file(_remembered(out), checksums[i], checksums[j], config)
        for i, j in itertools.combinations(used, 2)
    }
    missing = [pair for pair, file in files.items() if read_pair(file) is None]
    _match(missing, paths, files, config, workers or Workers(), bars)
    matches = {pair: _remembered_pair(file) for pair, file in files.items()}
    accepted = {pair: match for pair, match in matches.items() if match.is_accepted}
    components, contradicting = select_pairs(len(paths), accepted)
    if same_building:
        components = _with_twins(components, {k: first[checksums[k]] for k in twins})
    bars.start("merge", float(len(components)))
    inputs = [read_map(path, config) for path in paths]
    with output_folder(out, is_replaced=True) as made:
        entries = []
        for number, component in enumerate(components):
            folder = "." if number == 0 else f"component_{number + 1}"
            solution = _write(made / folder, component, inputs, accepted, config)
            entries.append(_entry(folder, component, inputs, solution))
            bars.advance(1.0)
        pairs = [_pair_entry(p, m, inputs, p in contradicting) for p, m in matches.items()]
        identical = () if same_building else tuple(inputs[k].name for k in twins)
        content = MergeFile(tuple(entries), tuple(pairs), identical)
        with output_file(made / RECORD) as file:
            file.write_text(json_text(content), encoding="utf-8")
    return MergeSummary(out, content, len(missing))


def _remembered(out: Path) -> Path:
    return out.with_name(f"{out.name}.pairs")


def _remembered_pair(file: Path) -> PairMatch:
    match = read_pair(file)
    if match is None:
        raise FleetError(f"{file}: the match of two maps is not there; run the command again")
    return match


def _match(
    pairs: Sequence[Pair],
    paths: Sequence[Path],
    files: Mapping[Pair, Path],
    config: Config,
    workers: Workers,
    bars: Bars,
) -> None:
    """Match pairs as tasks."""
    bars.start("match", float(len(pairs)), "pairs")
    if not pairs:
        return
    with connected(workers) as client:
        _run(client, pairs, paths, files, config, bars)


def _run(
    client: Client,
    pairs: Sequence[Pair],
    paths: Sequence[Path],
    files: Mapping[Pair, Path],
    config: Config,
    bars: Bars,
) -> None:
    futures = {
        client.submit(match_files, paths[i], paths[j], config, files[i, j], pure=False): (i, j)
        for i, j in pairs
    }
    for future in as_completed(futures):
        try:
            future.result()
        except (KilledWorker, CancelledError) as error:
            i, j = futures[future]
            raise FleetError(f"{paths[i]} and {paths[j]}: {one_line(error)}") from None
        bars.advance(1.0)


def _with_twins(components: list[Component], twins: Mapping[int, int]) -> list[Component]:
    """Put maps of the same bytes into the component of the first of them."""
    kept = [c for c in components if not set(c.T_root_map) <= set(twins)]
    for twin, first in twins.items():
        component = next(c for c in kept if first in c.T_root_map)
        component.T_root_map[twin] = component.T_root_map[first]
    return kept


def _write(
    folder: Path,
    component: Component,
    inputs: Sequence[MapInput],
    matches: Mapping[Pair, PairMatch],
    config: Config,
) -> SurfaceSolution:
    """Solve a component and write its files."""
    folder.mkdir(exist_ok=True)
    merged = merged_map(component, inputs, matches)
    solution = SurfaceSlam.from_saved(config, merged).solve()
    poses = np.array([keyframe.pose for keyframe in solution.slam.keyframes])
    solved = replace(merged, walls={**merged.walls, "keyframe_pose": poses})
    write_solution(folder, solution, config)
    save_map(folder / "map.mcap", solved, solution, config.frames.map_name)
    return solution


def merged_map(
    component: Component, inputs: Sequence[MapInput], matches: Mapping[Pair, PairMatch]
) -> SavedMap:
    """Return the maps of a component as one, each at the pose that the pairs give it.

    The loop closures are those of each map and the matches of the pairs. Maps of the same bytes are
    contained once.

    Parameters
    ----------
    component
        Which maps, and where they are.
    inputs
        All maps.
    matches
        Of the pairs.
    """
    members = _distinct(component, inputs)
    first = dict(zip(members, _starts([len(inputs[k].walls.keyframes) for k in members])))
    sessions = dict(zip(members, _starts([_sessions(inputs[k]) for k in members])))
    views: list[SavedView] = []
    parts = []
    for k in members:
        moved = _moved(inputs[k].walls, component.T_root_map[k], first[k], sessions[k])
        parts.append(moved)
        T = spatial(component.T_root_map[k])
        for saved in inputs[k].saved.views:
            anchor = saved.T_anchor_view if saved.is_on_keyframe else T @ saved.T_anchor_view
            view = replace(saved.view, session=saved.view.session + sessions[k])
            at = saved.keyframe + first[k] if saved.keyframe >= 0 else -1
            views.append(replace(saved, view=view, keyframe=at, T_anchor_view=anchor))
    loops = [
        Proposal(p.a + first[i], p.b + first[j], p.delta, p.cov, p.inliers, p.score, p.window)
        for i, j in component.pairs
        for p in matches[i, j].loops
    ]
    walls = SavedWalls(
        [keyframe for part in parts for keyframe in part.keyframes],
        [lines for part in parts for lines in part.lines],
        np.concatenate([part.poses for part in parts]),
        [loop for part in parts for loop in part.loops] + loops,
        [seen for part in parts for seen in part.observations],
        [view for part in parts for view in part.sign_views],
    )
    return SavedMap(pack_walls(walls), tuple(views))


def _distinct(component: Component, inputs: Sequence[MapInput]) -> list[int]:
    """Return the maps of a component without those of the same bytes as an earlier one."""
    first: dict[str, int] = {}
    for k in sorted(component.T_root_map):
        first.setdefault(inputs[k].checksum, k)
    return sorted(first.values())


def _starts(counts: Sequence[int]) -> list[int]:
    return [0, *itertools.accumulate(counts)][: len(counts)]


def _sessions(item: MapInput) -> int:
    keyframes = max((keyframe.session for keyframe in item.walls.keyframes), default=-1)
    return 1 + max([keyframes, *(saved.view.session for saved in item.saved.views)])


def _moved(walls: SavedWalls, T_root_map: Float64, first: int, session: int) -> SavedWalls:
    """Return a map's keyframes with other ids and sessions, in another frame."""
    keyframes = [
        replace(keyframe, id=keyframe.id + first, session=keyframe.session + session)
        for keyframe in walls.keyframes
    ]
    loops = [replace(loop, a=loop.a + first, b=loop.b + first) for loop in walls.loops]

    def on(anchored: AnchoredPose) -> AnchoredPose:
        return replace(anchored, keyframe=anchored.keyframe + first)

    seen = [AnchoredObservation(s.observation, on(s.anchored)) for s in walls.observations]
    # Ids of signs are those of one map: the merged one numbers its signs anew.
    signs = [replace(v, anchored=on(v.anchored), sign=-1) for v in walls.sign_views]
    poses = compose2(T_root_map, walls.poses)
    return SavedWalls(keyframes, walls.lines, poses, loops, seen, signs)


def _entry(
    folder: str, component: Component, inputs: Sequence[MapInput], solution: SurfaceSolution
) -> ComponentEntry:
    members = _distinct(component, inputs)
    patches = [sum(len(s.view.patches) for s in inputs[k].saved.views) for k in members]
    offsets = {inputs[k].checksum: start for k, start in zip(members, _starts(patches))}
    owners = _owners(solution.surfaces)
    maps = [
        MergedMapEntry(
            inputs[k].name,
            T,
            tuple(
                IdEntry(s.id, owners.get(s.id + offsets[inputs[k].checksum]))
                for s in inputs[k].surfaces
            ),
        )
        for k, T in component.T_root_map.items()
    ]
    return ComponentEntry(folder, tuple(maps))


def _owners(surfaces: Sequence[Surface]) -> dict[int, int]:
    """Return the surface that each number of a patch belongs to now."""
    return {number: s.id for s in surfaces for number in (s.id, *s.merged_ids)}


def _pair_entry(
    pair: Pair, match: PairMatch, inputs: Sequence[MapInput], is_contradicting: bool
) -> PairEntry:
    reason = PairReason.CONTRADICTED if is_contradicting else match.reason
    is_accepted = match.is_accepted and not is_contradicting
    one, other = inputs[pair[0]].name, inputs[pair[1]].name
    return PairEntry(one, other, is_accepted, str(reason), len(match.loops))
