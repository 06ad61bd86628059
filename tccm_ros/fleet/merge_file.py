"""Model of merge.json: components of a merged map, pairs of maps, and the table of ids."""

from __future__ import annotations

from dataclasses import dataclass

from tccm_ros.arrays import Vector

RECORD = "merge.json"
"""File in the folder of a merged map with its maps, pairs and table of ids."""


@dataclass(frozen=True, slots=True)
class IdEntry:
    """Id of a surface before and after the merge.

    Attributes
    ----------
    old
        Id in its own map.
    new
        Id in the merged map; None if the surface is gone.
    """

    old: int
    new: int | None


@dataclass(frozen=True, slots=True, eq=False)
class MergedMapEntry:
    """An input map of a merged map.

    Attributes
    ----------
    map
        Path of the map.
    T_map_old
        float64 (3,), planar pose of its frame in the merged map's, from a single match.
    surfaces
        Table of its ids.
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
        Whether it is used in the graph.
    reason
        Reason for that.
    loops
        Number of keyframes of one map that were matched in the other.
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
        Folder of its files, relative to the output folder; ``.`` for that folder itself.
    maps
        Its maps.
    """

    folder: str
    maps: tuple[MergedMapEntry, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MergeFile:
    """merge.json: description of a merge.

    Attributes
    ----------
    components
        Components, the largest first.
    pairs
        All matched pairs.
    identical
        Maps that are identical to an earlier one and were not merged with it.
    """

    components: tuple[ComponentEntry, ...]
    pairs: tuple[PairEntry, ...]
    identical: tuple[str, ...] = ()
