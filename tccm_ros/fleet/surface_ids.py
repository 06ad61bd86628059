"""Map surface ids of a map to those of a merged map, by patches or by overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tccm_ros.arrays import Float64
from tccm_ros.fleet.map_inputs import SurfaceFootprint
from tccm_ros.fleet.merge_file import IdEntry
from tccm_ros.records import Surface

MIN_COVERED = 0.5
"""Minimum fraction of a surface covered by its successor in the merged map. Chosen: the major
part."""


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
