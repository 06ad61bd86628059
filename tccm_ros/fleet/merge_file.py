"""merge.json: the components of a merged map, the pairs of maps, and the table of ids."""

from __future__ import annotations

from dataclasses import dataclass

from tccm_ros.results.models import Vector

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
