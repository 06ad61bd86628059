"""`tccm merge`: merge the maps of many robots and sessions of a building into one frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tccm_ros.atomic import output_folder
from tccm_ros.config import Config
from tccm_ros.fleet.cluster import Workers
from tccm_ros.fleet.map_inputs import MapInput, checksum_of, find_maps, footprints_of, read_map
from tccm_ros.fleet.merge_file import (
    RECORD,
    ComponentEntry,
    MergedMapEntry,
    MergeFile,
    PairEntry,
)
from tccm_ros.fleet.merged_map import distinct_maps, id_table, merged_map, owners_of_patches, starts
from tccm_ros.fleet.pair_matching import PairMatch, PairReason
from tccm_ros.fleet.pair_selection import Component, Pair, select_pairs
from tccm_ros.fleet.pair_tasks import match_all
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.progress import Bars
from tccm_ros.results.exports import write_solution
from tccm_ros.results.map_file import save_map
from tccm_ros.results.numbers import write_json


@dataclass(frozen=True, slots=True, eq=False)
class MergeSummary:
    """Result of a merge.

    Attributes
    ----------
    out
        Output folder.
    content
        Content of merge.json.
    matched
        Number of pairs matched in this run; the others were cached.
    """

    out: Path
    content: MergeFile
    matched: int

    def to_json(self) -> dict[str, Any]:
        """Return the counts as plain data."""
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
        """Return the result as lines for a terminal."""
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
    """Merge maps and write the largest component, with the others in subfolders.

    Parameters
    ----------
    sources
        Map files, result folders, or fleet folders. A component has the frame of its first map.
    out
        Output folder; pair matches are cached in a folder next to it.
    config
        Configuration of matching, graph and surfaces.
    same_building
        Whether identical map files are of the same place; otherwise they may be of two equal
        places.
    workers
        Workers that match pairs; one if None.
    bars
        Progress bars.

    Raises
    ------
    FleetError
        If there are fewer than two maps, or no worker could match a pair.
    MapError
        If a map is damaged or has no walls.
    OutputError
        If the result cannot be written.
    """
    bars, out = bars or Bars(), Path(out).absolute()
    paths = [path.absolute() for path in find_maps(sources)]
    checksums = [checksum_of(path) for path in paths]
    first = {checksum: k for k, checksum in reversed(list(enumerate(checksums)))}
    copies = [k for k, checksum in enumerate(checksums) if first[checksum] != k]
    used = [k for k in range(len(paths)) if k not in copies]
    maps = {k: (paths[k], checksums[k]) for k in used}
    matches, matched = match_all(maps, _cache_folder(out), config, workers or Workers(), bars)
    accepted = {pair: match for pair, match in matches.items() if match.is_accepted}
    components, contradicting = select_pairs(len(paths), accepted)
    if same_building:
        components = _with_copies(components, {k: first[checksums[k]] for k in copies})
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
        identical = () if same_building else tuple(inputs[k].name for k in copies)
        content = MergeFile(tuple(entries), tuple(pairs), identical)
        write_json(made / RECORD, content)
    return MergeSummary(out, content, matched)


def _cache_folder(out: Path) -> Path:
    return out.with_name(f"{out.name}.pairs")


def _with_copies(components: list[Component], copies: Mapping[int, int]) -> list[Component]:
    """Add identical maps to the component of the first of them."""
    kept = [c for c in components if not set(c.p_root_map) <= set(copies)]
    for copy, first in copies.items():
        component = next(c for c in kept if first in c.p_root_map)
        component.p_root_map[copy] = component.p_root_map[first]
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
    poses = np.array([keyframe.pose for keyframe in solution.graph.keyframes])
    solved = replace(merged, walls={**merged.walls, "keyframe_pose": poses})
    write_solution(folder, solution, config)
    save_map(folder / "map.mcap", solved, solution, config.frames.map_name)
    return solution


def _entry(
    folder: str, component: Component, inputs: Sequence[MapInput], solution: SurfaceSolution
) -> ComponentEntry:
    members = distinct_maps(component, inputs)
    patches = [sum(len(s.view.patches) for s in inputs[k].saved.views) for k in members]
    offsets = {inputs[k].checksum: start for k, start in zip(members, starts(patches))}
    mapped = solution.mapped
    found = footprints_of(mapped.surfaces, mapped.floor_z)
    owners = owners_of_patches(solution.surfaces)
    maps = [
        MergedMapEntry(
            inputs[k].name,
            T,
            id_table(inputs[k].surfaces, offsets[inputs[k].checksum], T, owners, found),
        )
        for k, T in component.p_root_map.items()
    ]
    return ComponentEntry(folder, tuple(maps))


def _pair_entry(
    pair: Pair, match: PairMatch, inputs: Sequence[MapInput], is_contradicting: bool
) -> PairEntry:
    reason = PairReason.CONTRADICTED if is_contradicting else match.reason
    is_accepted = match.is_accepted and not is_contradicting
    one, other = inputs[pair[0]].name, inputs[pair[1]].name
    return PairEntry(one, other, is_accepted, str(reason), len(match.loops))
