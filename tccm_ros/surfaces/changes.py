"""Changes of the map that a robot may have to act on, from two scenes that follow each other."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse
from tccm_ros.surfaces.scene import KnownSurface, Scene, object_pose, surface_pose
from tccm_ros.surfaces.scene_objects import SceneObject

MIN_MOTION = 0.05
"""A surface whose middle moved less stands where it stood, m. Chosen: outlines end within 1 or 2 cm
of the true edges."""

MIN_ROTATION = np.deg2rad(8.0)
"""The same for its yaw, rad. Chosen."""


class ChangeKind(IntEnum):
    """Kinds of changes, numbered as in tccm_interfaces/SurfaceEvent."""

    APPEARED = 1
    MOVED = 2
    MERGED = 3
    SPLIT = 4
    GONE = 5
    OBJECT_APPEARED = 6
    OBJECT_LEFT = 7


class Change(NamedTuple):
    """One change between two scenes; attributes as of tccm_interfaces/SurfaceEvent.

    Attributes
    ----------
    kind
        What happened.
    stamp_ns
        Stamp of the view that shows it.
    ids_before, ids_after
        Surfaces that it concerns.
    label
        Of the surface.
    object_id
        -1 for surfaces.
    T_before, T_after
        float64 (4, 4) in map; None where there was none.
    last_seen_ns
        Stamp of the last view that showed it as before.
    """

    kind: ChangeKind
    stamp_ns: int
    ids_before: tuple[int, ...] = ()
    ids_after: tuple[int, ...] = ()
    label: str = ""
    object_id: int = -1
    T_before: Float64 | None = None
    T_after: Float64 | None = None
    last_seen_ns: int = 0

    def __str__(self) -> str:
        kind = self.kind.name.lower().replace("_", " ")
        if self.object_id >= 0:
            return f"{kind}: {self.object_id} on surface {(*self.ids_before, *self.ids_after)[0]}"
        ids = " -> ".join(
            ", ".join(map(str, ids)) for ids in (self.ids_before, self.ids_after) if ids
        )
        return f"{kind}: surface {ids} ({self.label})"


def changes(before: Scene, after: Scene, agreeing_views: int) -> list[Change]:
    """Return what happened between two scenes; the floor does not count.

    Parameters
    ----------
    before, after
        Of one map.
    agreeing_views
        An object is there once so many views have measured it.
    """
    return [
        *_surface_changes(_of_interest(before), _of_interest(after), after.stamp_ns),
        *_object_changes(before, after, agreeing_views),
    ]


def _of_interest(scene: Scene) -> dict[int, KnownSurface]:
    return {k.surface.id: k for k in scene.surfaces if k.surface.label != "floor"}


def _surface_changes(
    before: dict[int, KnownSurface], after: dict[int, KnownSurface], stamp_ns: int
) -> Iterator[Change]:
    owners = {m: k for k, known in before.items() for m in known.surface.merged_ids}
    merged_into = {m: k for k, known in after.items() for m in known.surface.merged_ids}
    for identity, known in before.items():
        if identity not in after and identity not in merged_into:
            T = surface_pose(known.surface)[0]
            yield Change(
                ChangeKind.GONE, stamp_ns, ids_before=(identity,), label=known.surface.label,
                T_before=T, last_seen_ns=known.last_view_ns,
            )  # fmt: skip
    for identity, known in after.items():
        merged = [m for m in known.surface.merged_ids if m in before]
        if merged:
            ids = tuple(sorted({*merged, *({identity} & before.keys())}))
            yield _of_surfaces(ChangeKind.MERGED, ids, (identity,), before, after)
        elif identity in before:
            if _has_moved(before[identity], known):
                yield _of_surfaces(ChangeKind.MOVED, (identity,), (identity,), before, after)
        elif identity in owners:
            origin = owners[identity]
            ids = tuple(sorted({identity, *({origin} & after.keys())}))
            yield _of_surfaces(ChangeKind.SPLIT, (origin,), ids, before, after)
        else:
            yield _of_surfaces(ChangeKind.APPEARED, (), (identity,), before, after)


def _of_surfaces(
    kind: ChangeKind,
    ids_before: tuple[int, ...],
    ids_after: tuple[int, ...],
    before: dict[int, KnownSurface],
    after: dict[int, KnownSurface],
) -> Change:
    old = before[ids_before[0]] if ids_before else None
    new = after[ids_after[0]]
    return Change(
        kind,
        new.surface.first_seen_ns if old is None else new.last_view_ns,
        ids_before,
        ids_after,
        new.surface.label,
        T_before=None if old is None else surface_pose(old.surface)[0],
        T_after=surface_pose(new.surface)[0],
        last_seen_ns=0 if old is None else old.last_view_ns,
    )


def _has_moved(before: KnownSurface, after: KnownSurface) -> bool:
    """Return whether no view shows a surface where it was, and newer ones show it elsewhere.

    A map that is corrected moves its views with it, and a surface that is seen further grows.
    """
    if after.first_view_ns <= before.last_view_ns:
        return False
    T = inverse(surface_pose(before.surface)[0]) @ surface_pose(after.surface)[0]
    # A rectangle that is rotated by half a turn is the same.
    yaw = abs(np.arctan(T[1, 0] / T[0, 0])) if T[0, 0] else 0.5 * np.pi
    return bool(np.linalg.norm(T[:3, 3]) > MIN_MOTION or yaw > MIN_ROTATION)


def _object_changes(before: Scene, after: Scene, agreeing_views: int) -> Iterator[Change]:
    old = {item.id: item for item in before.objects if item.views >= agreeing_views}
    there = {item.id for item in after.objects}
    for item in old.values():
        if item.id not in there:
            yield Change(
                ChangeKind.OBJECT_LEFT, after.stamp_ns, ids_before=(item.surface,),
                label=item.class_id, object_id=item.id, T_before=object_pose(item),
                last_seen_ns=item.last_seen_ns,
            )  # fmt: skip
    for item in after.objects:
        if item.views >= agreeing_views and item.id not in old:
            yield _object_appeared(item)


def _object_appeared(item: SceneObject) -> Change:
    return Change(
        ChangeKind.OBJECT_APPEARED, item.last_seen_ns, ids_after=(item.surface,),
        label=item.class_id, object_id=item.id, T_after=object_pose(item),
    )  # fmt: skip
