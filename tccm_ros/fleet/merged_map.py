"""Combine the maps of a component in one frame, with new ids for their surfaces."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.fleet.map_inputs import MapInput, SurfaceFootprint
from tccm_ros.fleet.merge_file import IdEntry
from tccm_ros.fleet.pair_matching import PairMatch
from tccm_ros.fleet.pair_selection import Component, Pair
from tccm_ros.geometry import compose2, spatial
from tccm_ros.mapping.saved_map import SavedMap, SavedView
from tccm_ros.records import Surface
from tccm_ros.slam.chain import AnchoredPose
from tccm_ros.slam.landmarks import AnchoredObservation
from tccm_ros.slam.loops.matching import Proposal
from tccm_ros.slam.saved_walls import SavedWalls, pack_walls

MIN_COVERED = 0.5
"""Minimum fraction of a surface covered by its successor in the merged map. Chosen: the major
part."""


def merged_map(
    component: Component, inputs: Sequence[MapInput], matches: Mapping[Pair, PairMatch]
) -> SavedMap:
    """Return the maps of a component as one map, each at its pose in the component.

    The loop closures are those of each map and of the matched pairs. Identical maps are included
    once.

    Parameters
    ----------
    component
        Maps with their poses.
    inputs
        All maps.
    matches
        Matches of the pairs.
    """
    members = distinct_maps(component, inputs)
    first = dict(zip(members, starts([len(inputs[k].walls.keyframes) for k in members])))
    sessions = dict(zip(members, starts([_sessions(inputs[k]) for k in members])))
    views: list[SavedView] = []
    parts = []
    for k in members:
        moved = _moved(inputs[k].walls, component.p_root_map[k], first[k], sessions[k])
        parts.append(moved)
        T = spatial(component.p_root_map[k])
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
        {session: root for part in parts for session, root in part.unjoined.items()},
    )
    return SavedMap(pack_walls(walls), tuple(views))


def distinct_maps(component: Component, inputs: Sequence[MapInput]) -> list[int]:
    """Return the indices of a component's maps, without those identical to an earlier one."""
    first: dict[str, int] = {}
    for k in sorted(component.p_root_map):
        first.setdefault(inputs[k].checksum, k)
    return sorted(first.values())


def starts(counts: Sequence[int]) -> list[int]:
    """Return the cumulative sum of the counts before each entry."""
    return [0, *itertools.accumulate(counts)][: len(counts)]


def _sessions(item: MapInput) -> int:
    keyframes = max((keyframe.session for keyframe in item.walls.keyframes), default=-1)
    return 1 + max([keyframes, *(saved.view.session for saved in item.saved.views)])


def _moved(walls: SavedWalls, p_root_map: Float64, first: int, session: int) -> SavedWalls:
    """Return a map's walls in another frame, with keyframe ids and sessions offset."""
    keyframes = [
        replace(keyframe, id=keyframe.id + first, session=keyframe.session + session)
        for keyframe in walls.keyframes
    ]
    loops = [replace(loop, a=loop.a + first, b=loop.b + first) for loop in walls.loops]

    def on(anchored: AnchoredPose) -> AnchoredPose:
        return replace(anchored, keyframe=anchored.keyframe + first)

    seen = [AnchoredObservation(s.observation, on(s.anchored)) for s in walls.observations]
    # Sign ids are local to a map; the merged map assigns new ones.
    signs = [replace(v, anchored=on(v.anchored), sign=-1) for v in walls.sign_views]
    poses = compose2(p_root_map, walls.poses)
    unjoined = {s + session: root + session for s, root in walls.unjoined.items()}
    return SavedWalls(keyframes, walls.lines, poses, loops, seen, signs, unjoined)


def owners_of_patches(surfaces: Sequence[Surface]) -> dict[int, int]:
    """Return the surface id by patch number."""
    return {number: s.id for s in surfaces for number in (s.id, *s.merged_ids)}


def id_table(
    surfaces: Sequence[SurfaceFootprint],
    first_patch: int,
    p_map_old: Float64,
    owners: Mapping[int, int],
    merged: Sequence[SurfaceFootprint],
) -> tuple[IdEntry, ...]:
    """Return the table of ids of a map.

    A surface id is the number of one of its patches. If that patch is not in the merged map, the
    surface is identified by overlap.

    Parameters
    ----------
    surfaces
        Surfaces of the map.
    first_patch
        Offset of its patch numbers in the merged map.
    p_map_old
        float64 (3,), planar pose of its frame in the merged map's.
    owners
        Surface id in the merged map by patch number.
    merged
        Surfaces of the merged map.
    """
    table = []
    for surface in surfaces:
        new = owners.get(surface.id + first_patch)
        if new is None:
            new = _at_its_place(surface.moved(p_map_old), merged)
        table.append(IdEntry(surface.id, new))
    return tuple(table)


def _at_its_place(surface: SurfaceFootprint, merged: Sequence[SurfaceFootprint]) -> int | None:
    covered = [
        (surface.polygon.intersection(other.polygon).area, other.id)
        for other in merged
        if other.is_floor == surface.is_floor and other.is_as_high_as(surface)
    ]
    area, id_ = max(covered, default=(0.0, -1))
    return id_ if area >= MIN_COVERED * surface.polygon.area > 0.0 else None
