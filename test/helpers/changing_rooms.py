"""The simulator's changing rooms: their true events, and those of their map."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import ObjectBoxes
from tccm_ros.scene.changes import Change, ChangeKind, MapChanges
from tccm_ros.scene.planning_shapes import SURFACE_PREFIX, Box, Mesh
from tccm_ros.scene.scene import Scene
from tccm_ros.scene.session_changes import scene_of
from tccm_sim.changing import CYCLE, WALL
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.options import Options
from tccm_sim.truth import map_from_world
from tccm_sim.worlds import build_world

WORLD = "changing"
NEAR = np.array([0.12, 0.12, 0.03])
"""Maximum error of the middle of an outline measured with scan lines at 5 cm, m."""


class TrueItem(NamedTuple):
    """A surface or an object, its first and last position (3,), and its true events."""

    name: str
    first: np.ndarray
    last: np.ndarray
    kinds: tuple[ChangeKind, ...]


def true_items() -> list[TrueItem]:
    """Return the surfaces and objects of the rooms, from the scene alone."""
    simulation = Simulation(build_world(WORLD, Options()))
    T = map_from_world(simulation)
    return [
        item
        for solid in simulation.scene.solids
        if solid.surface or solid.role == "object"
        for item in [_item(solid, T)]
    ]


def _item(solid, T_map_world) -> TrueItem:
    middle, moves, end = solid.T_world_solid[:3, 3].copy(), solid.motion, solid.span[1]
    if solid.role != "object":
        middle[2] += solid.half[2]
    offset = np.zeros(3) if moves is None else moves.offsets[-1, :3]
    first, last = (T_map_world[:3, :3] @ p + T_map_world[:3, 3] for p in (middle, middle + offset))
    if solid.role == "object":
        kinds = [ChangeKind.OBJECT_APPEARED] + [ChangeKind.OBJECT_LEFT] * bool(np.isfinite(end))
        return TrueItem(solid.name, first, last, tuple(kinds))
    kinds = [ChangeKind.APPEARED]
    if np.isfinite(end) or (middle[0] > WALL) != ((middle + offset)[0] > WALL):
        kinds.append(ChangeKind.GONE)
    if moves is not None:
        kinds.append(ChangeKind.MOVED)
    return TrueItem(solid.name, first, last, tuple(kinds))


def solved(inputs: Iterable[object], slam: SurfaceSlam) -> Iterator[Scene]:
    """Yield the scenes of the inputs; the map is solved after each tilt cycle."""
    for event in inputs:
        slam.add(event)
        if isinstance(event, ObjectBoxes):
            yield scene_of(slam.solve(), "map")


def reported(scenes: Iterable[Scene], events: MapChanges) -> list[Change]:
    """Return the reported changes of consecutive scenes."""
    views = Config().objects.agreeing_views
    return [change for scene in scenes for change in events.note(scene, views)]


def index_at(inputs: list[object], seconds: float) -> int:
    """Return the index of the first input later than a time of the recording."""
    limit = EPOCH_NS + round(seconds * 1e9)
    return next(k for k, e in enumerate(inputs) if getattr(e, "stamp_ns", 0) > limit)


def true_counts() -> Counter[tuple[str, ChangeKind]]:
    """Return the true number of events of each item by kind: one each."""
    return Counter((item.name, kind) for item in true_items() for kind in item.kinds)


def counted(found: list[Change]) -> Counter[tuple[str, ChangeKind]]:
    """Return the number of reported events of each item by kind."""
    items = true_items()
    return Counter((_item_of(event, items).name, event.kind) for event in found)


def assert_one_id_an_item(found: list[Change]) -> None:
    """Assert that all events of an item have one id, and that ids of items differ."""
    items = true_items()
    ids: dict[str, set[tuple[bool, int]]] = {item.name: set() for item in items}
    for event in found:
        is_object = event.object_id >= 0
        own = (event.object_id,) if is_object else (*event.ids_before, *event.ids_after)
        ids[_item_of(event, items).name] |= {(is_object, k) for k in own}
    assert all(len(known) == 1 for known in ids.values()), ids
    assert len(set().union(*ids.values())) == len(items), "no two items have one id"


def _item_of(event: Change, items: list[TrueItem]) -> TrueItem:
    """Return the item of an event, by its poses."""
    is_object = event.object_id >= 0
    for item in items:
        if is_object != (item.kinds[0] == ChangeKind.OBJECT_APPEARED):
            continue
        is_moved = event.kind == ChangeKind.MOVED
        before = event.T_before is None or _is_near(event.T_before, item.first)
        after = event.T_after is None or _is_near(
            event.T_after, item.last if is_moved else item.first
        )
        if before and after:
            return item
    raise AssertionError(f"nothing true: {event}, {event.T_before}, {event.T_after}")


def _is_near(T, place) -> bool:
    return bool((np.abs(T[:3, 3] - place) <= NEAR).all())


class TruePresence(NamedTuple):
    """Whether a solid is at a place, (3,) in map, at the stamp of a tilt cycle."""

    name: str
    place: np.ndarray
    is_present: bool
    stamp_ns: int


def true_presence(stamps_ns: list[int]) -> Iterator[TruePresence]:
    """Yield what the second tilt cycle that looks at each change in the world has seen.

    Parameters
    ----------
    stamps_ns
        Stamps of the tilt cycles.
    """
    simulation = Simulation(build_world(WORLD, Options()))
    ends = np.array(stamps_ns) * 1e-9 - EPOCH_NS * 1e-9
    stops = np.asarray(simulation.world.drive.stops)
    stop = np.searchsorted(stops[:, 0], ends) - 1
    T_world_map = np.linalg.inv(map_from_world(simulation))
    places = {item.name: item for item in true_items()}
    for solid in simulation.scene.solids:
        if solid.is_still or not (solid.surface or solid.role == "object"):
            continue
        item, (begin, end) = places[solid.name], solid.span
        changes = [(begin, item.first, True), (end, item.first, False)]
        if solid.motion is not None:
            jump = float(solid.motion.times[-1])
            changes += [(jump, item.first, False), (jump, item.last, True)]
        for time, place, is_present in changes:
            in_first = (T_world_map[:3, :3] @ place + T_world_map[:3, 3])[0] > WALL
            looks = np.flatnonzero((ends - CYCLE > time) & ((stop % 2 == 0) == in_first))
            if np.isfinite(time):
                yield TruePresence(solid.name, place, is_present, stamps_ns[looks[1]])


def is_at(place: np.ndarray, shapes: Mapping[str, Box | Mesh]) -> bool:
    """Return whether a surface has its top, or an object its middle, at a place."""
    boxes = {name: shape for name, shape in shapes.items() if isinstance(shape, Box)}
    middles = [
        shape.T_map_box[:3, 3] + [0.0, 0.0, 0.5 * shape.size[2] * name.startswith(SURFACE_PREFIX)]
        for name, shape in boxes.items()
    ]
    return bool((np.abs(np.array(middles) - place) <= NEAR).all(axis=1).any())
