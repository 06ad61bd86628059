"""Which surface of a merged map each surface of a map is: by its patches, else by its place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tccm_ros.arrays import Float64
from tccm_ros.fleet.map_inputs import Footprint
from tccm_ros.fleet.merge_file import IdEntry
from tccm_ros.records import Surface

MIN_COVERED = 0.5
"""Min fraction of a surface that one of the merged map covers, to be it (chosen: the most part)."""


def owners_of_patches(surfaces: Sequence[Surface]) -> dict[int, int]:
    """Return the surface that each number of a patch belongs to."""
    return {number: s.id for s in surfaces for number in (s.id, *s.merged_ids)}


def id_table(
    surfaces: Sequence[Footprint],
    first_patch: int,
    T_map_old: Float64,
    owners: Mapping[int, int],
    merged: Sequence[Footprint],
) -> tuple[IdEntry, ...]:
    """Return the table of ids of a map.

    A surface is named by one of its patches. Where that patch is in no surface any more, the
    surface is the one that is at its place.

    Parameters
    ----------
    surfaces
        Of the map.
    first_patch
        What its numbers of patches are increased by in the merged map.
    T_map_old
        float64 (3,), planar pose of its frame in that of the merged map.
    owners
        Surface of the merged map by number of patch.
    merged
        Surfaces of the merged map.
    """
    table = []
    for surface in surfaces:
        new = owners.get(surface.id + first_patch)
        if new is None:
            new = _at_its_place(surface.moved(T_map_old), merged)
        table.append(IdEntry(surface.id, new))
    return tuple(table)


def _at_its_place(surface: Footprint, merged: Sequence[Footprint]) -> int | None:
    covered = [
        (surface.polygon.intersection(other.polygon).area, other.id)
        for other in merged
        if other.is_floor == surface.is_floor and other.is_as_high_as(surface)
    ]
    area, id_ = max(covered, default=(0.0, -1))
    return id_ if area >= MIN_COVERED * surface.polygon.area > 0.0 else None
