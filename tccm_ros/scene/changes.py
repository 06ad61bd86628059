"""Changes of surfaces and objects between two successive scenes."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.records import PreviousPose, Surface
from tccm_ros.scene.scene import KnownSurface, Scene, object_pose, surface_pose
from tccm_ros.surfaces.displacement import HorizontalOutline, is_displaced
from tccm_ros.surfaces.objects.scene_objects import FLUSH, SceneObject

SCENES = 4
"""Number of past scenes that are kept of each surface. Chosen: three views of a stop show that it
was moved."""


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
    """One change between two scenes; attributes as in tccm_interfaces/SurfaceEvent.

    Attributes
    ----------
    kind
        Kind of change.
    stamp_ns
        Stamp of the view that shows it.
    ids_before, ids_after
        Ids of the surfaces concerned.
    label
        Label of the surface, or class of the object.
    object_id
        Id of the object; -1 for surfaces.
    T_before, T_after
        float64 (4, 4), poses in map; None if there is none.
    last_seen_ns
        Stamp of the last view that showed the state before the change.
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


class MapChanges:
    """Reports the changes from scene to scene, each change once.

    A change of a surface is reported once a second view confirms it: an object that is carried
    through the room is measured at places where it does not stay.

    Parameters
    ----------
    is_map_loaded
        Whether the first scene is that of a loaded map, which reports no changes.
    """

    def __init__(self, *, is_map_loaded: bool = False):
        self._reported: Scene | None = None
        self._is_first_awaited = is_map_loaded
        self._absent: dict[int, int] = {}
        self._earlier: dict[int, tuple[tuple[int, KnownSurface], ...]] = {}

    def note(self, scene: Scene, agreeing_views: int) -> list[Change]:
        """Return the changes since the previous scene.

        Parameters
        ----------
        scene
            The newest scene.
        agreeing_views
            As for `changes`.
        """
        if self._is_first_awaited:
            self._reported, self._is_first_awaited = scene, False
            return []
        reported = self._reported or scene._replace(surfaces=(), objects=(), stamp_ns=-1)
        self._reported = now = self._agreed(reported, scene)
        found = changes(self._as_placed_before(reported, now), now, agreeing_views)
        self._remember(now)
        return found

    def _as_placed_before(self, reported: Scene, now: Scene) -> Scene:
        """Return the previous scene with each moved surface as it was before it moved.

        A small motion is detected only after several views. The scenes in between merge the rest
        of the surface at the old place with the surface at the new one.
        """
        placed = {k.surface.id: k.surface.placed_ns for k in now.surfaces}
        surfaces = []
        for known in reported.surfaces:
            since = placed.get(known.surface.id, known.surface.placed_ns)
            earlier = self._earlier.get(known.surface.id, ())
            before = [k for newest_view_ns, k in earlier if newest_view_ns < since]
            is_elsewhere = since != known.surface.placed_ns and len(before) > 0
            surfaces.append(before[-1] if is_elsewhere else known)
        return reported._replace(surfaces=tuple(surfaces))

    def _remember(self, now: Scene) -> None:
        """Store the surfaces of the last scenes."""
        there = {k.surface.id: k for k in now.surfaces}
        self._earlier = {
            identity: (*self._earlier.get(identity, ()), (now.newest_view_ns, known))[-SCENES:]
            for identity, known in there.items()
        }

    def _agreed(self, reported: Scene, scene: Scene) -> Scene:
        """Return a scene without the surface changes that only its newest view shows."""
        known = {k.surface.id: k for k in reported.surfaces}
        merged = {m for k in scene.surfaces for m in k.surface.merged_ids}
        surfaces = []
        for now in scene.surfaces:
            identity = now.surface.id
            if not _is_new(now, scene):
                surfaces.append(now)
            elif identity in known:
                surfaces.append(known[identity])
        there = {k.surface.id for k in scene.surfaces} | merged
        absent = {k: v for k, v in self._absent.items() if k not in there}
        is_agreed = scene.previous_view_ns > reported.newest_view_ns  # by two views since
        for identity in known.keys() - there if not is_agreed else ():
            if absent.setdefault(identity, scene.newest_view_ns) == scene.newest_view_ns:
                surfaces.append(known[identity])
        self._absent = absent
        return scene._replace(surfaces=tuple(sorted(surfaces, key=lambda k: k.surface.id)))


def _is_new(known: KnownSurface, scene: Scene) -> bool:
    """Return whether only the newest view shows a surface at its place."""
    return known.surface.placed_ns == scene.newest_view_ns


def changes(before: Scene, after: Scene, agreeing_views: int) -> list[Change]:
    """Return the changes between two scenes, without those of the floor.

    Parameters
    ----------
    before, after
        Two scenes of one map.
    agreeing_views
        Minimum number of views that must have measured an object.
    """
    return [
        *_surface_changes(
            _of_interest(before), _of_interest(after), (before.stamp_ns, after.stamp_ns)
        ),
        *_object_changes(before, after, agreeing_views),
    ]


def _of_interest(scene: Scene) -> dict[int, KnownSurface]:
    """Return the surfaces that are neither floor nor tops of objects, by id.

    The event of an object covers its top.
    """
    return {
        k.surface.id: k
        for k in scene.surfaces
        if k.surface.label != "floor" and not _is_top(k.surface, scene.objects)
    }


def _is_top(surface: Surface, objects: tuple[SceneObject, ...]) -> bool:
    """Return whether most of a surface is in the footprint of an object, near its upper side."""
    outline = Polygon(surface.boundary[:, :2]).buffer(0.0)
    return any(
        abs(item.center[2] + 0.5 * item.size[2] - surface.height) < FLUSH
        and item.surface != surface.id
        and item.footprint.intersection(outline).area > 0.5 * outline.area
        for item in objects
    )


def _surface_changes(
    before: dict[int, KnownSurface], after: dict[int, KnownSurface], stamps: tuple[int, int]
) -> Iterator[Change]:
    """Yield the changes of surfaces; `stamps` are those of the two scenes, ns."""
    owners = {m: k for k, known in before.items() for m in known.surface.merged_ids}
    merged_into = {m: k for k, known in after.items() for m in known.surface.merged_ids}
    for identity, known in before.items():
        if identity not in after and identity not in merged_into:
            T = surface_pose(known.surface)[0]
            yield Change(
                ChangeKind.GONE, stamps[1], ids_before=(identity,), label=known.surface.label,
                T_before=T, last_seen_ns=known.last_view_ns,
            )  # fmt: skip
    for identity, known in after.items():
        merged = [m for m in known.surface.merged_ids if m in before]
        ids = tuple(sorted({*merged, *({identity} & before.keys())}))
        if identity in before and _has_moved(before[identity], known):
            yield _of_surfaces(ChangeKind.MOVED, ids, (identity,), before, after)
        elif merged:
            yield _of_surfaces(ChangeKind.MERGED, ids, (identity,), before, after)
        elif identity in before:
            continue
        elif identity in owners:
            origin = owners[identity]
            ids = tuple(sorted({identity, *({origin} & after.keys())}))
            yield _of_surfaces(ChangeKind.SPLIT, (origin,), ids, before, after)
        else:
            yield _appeared(known, stamps[0])


def _appeared(known: KnownSurface, stamp_before_ns: int) -> Change:
    """Return the change of a new surface: MOVED if it was recognised, else APPEARED."""
    surface, previous = known.surface, known.surface.previous_pose
    T = surface_pose(surface)[0]
    if (
        previous is not None
        and previous.last_seen_ns <= stamp_before_ns
        and is_displaced(_footprint(previous), _footprint(surface))
    ):
        return Change(
            ChangeKind.MOVED, known.last_view_ns, (surface.id,), (surface.id,), surface.label,
            T_before=surface_pose(previous)[0], T_after=T, last_seen_ns=previous.last_seen_ns,
        )  # fmt: skip
    return Change(
        ChangeKind.APPEARED, surface.placed_ns, (), (surface.id,), surface.label, T_after=T
    )


def _of_surfaces(
    kind: ChangeKind,
    ids_before: tuple[int, ...],
    ids_after: tuple[int, ...],
    before: dict[int, KnownSurface],
    after: dict[int, KnownSurface],
) -> Change:
    """Return a change of surfaces in two scenes, with the poses of the first ones."""
    old, new = before[ids_before[0]], after[ids_after[0]]
    return Change(
        kind, new.last_view_ns, ids_before, ids_after, new.surface.label,
        T_before=surface_pose(old.surface)[0], T_after=surface_pose(new.surface)[0],
        last_seen_ns=old.last_view_ns,
    )  # fmt: skip


def _has_moved(before: KnownSurface, after: KnownSurface) -> bool:
    """Return whether newer views show a surface at another place.

    Corrections of the map move surfaces with their views, and new views extend surfaces: neither is
    a motion of the surface.
    """
    if after.surface.placed_ns == before.surface.placed_ns:
        return False
    return is_displaced(_footprint(before.surface), _footprint(after.surface))


def _footprint(surface: Surface | PreviousPose) -> HorizontalOutline:
    z = float(surface_pose(surface)[0][2, 3])
    return HorizontalOutline(Polygon(surface.boundary[:, :2]).buffer(0.0), z)


def _object_changes(before: Scene, after: Scene, agreeing_views: int) -> Iterator[Change]:
    """Yield the changes of objects on surfaces; objects on the floor are legs of furniture."""
    floors = {
        k.surface.id for k in (*before.surfaces, *after.surfaces) if k.surface.label == "floor"
    }
    old = {
        item.id: item
        for item in before.objects
        if item.views >= agreeing_views and item.surface not in floors
    }
    there = {item.id for item in after.objects}
    for item in old.values():
        if item.id not in there:
            yield Change(
                ChangeKind.OBJECT_LEFT, after.stamp_ns, ids_before=(item.surface,),
                label=item.class_id, object_id=item.id, T_before=object_pose(item),
                last_seen_ns=item.last_seen_ns,
            )  # fmt: skip
    for item in after.objects:
        if item.views >= agreeing_views and item.id not in old and item.surface not in floors:
            yield _object_appeared(item)


def _object_appeared(item: SceneObject) -> Change:
    return Change(
        ChangeKind.OBJECT_APPEARED, item.last_seen_ns, ids_after=(item.surface,),
        label=item.class_id, object_id=item.id, T_after=object_pose(item),
    )  # fmt: skip
