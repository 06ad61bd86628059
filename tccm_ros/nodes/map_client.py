"""`SurfaceMapClient`: the surface map for Python nodes, as plain objects.

It needs `tccm_interfaces`, and the node that it is given spun by its owner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from tccm_interfaces.msg import SurfaceEvent, SurfaceFilter, SurfaceMap
from tccm_interfaces.srv import FindPlacements, FindSurfaces

from tccm_ros.arrays import Float64
from tccm_ros.errors import QuestionError
from tccm_ros.geometry import pose_from_quaternion

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True, slots=True, eq=False)
class MapSurface:
    """A surface of the map.

    Attributes
    ----------
    id, label, room
        What it is.
    T_map_surface
        float64 (4, 4), middle of the smallest rectangle around it, x along the longer side.
    size
        float64 (2,), edges of that rectangle, m.
    height
        Over the floor, m.
    area
        m2.
    boundary
        float64 (N, 3), in map, counter-clockwise seen from above.
    near_signs
        Texts of the signs near it.
    message
        All that is known: tccm_interfaces/Surface.
    """

    id: int
    label: str
    room: str
    T_map_surface: Float64
    size: Float64
    height: float
    area: float
    boundary: Float64
    near_signs: tuple[str, ...]
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapObject:
    """Something that stands on a surface.

    Attributes
    ----------
    id, surface_id
        Of the object, and of the surface that it stands on.
    label, confidence
        Class and its score, 0 to 1, where a detector gave it one; else empty and nan.
    T_map_object
        float64 (4, 4), middle of its box.
    size
        float64 (3,), edges of the box, m.
    """

    id: int
    surface_id: int
    label: str
    confidence: float
    T_map_object: Float64
    size: Float64


@dataclass(frozen=True, slots=True, eq=False)
class MapPlacement:
    """Where an object can be put down.

    Attributes
    ----------
    surface_id
        Of the surface.
    T_map_object
        float64 (4, 4), middle of the object's lower side.
    clearance
        Distance to the nearest edge or object, m.
    T_map_bases
        Where the base can stand, float64 (N, 4, 4), the best first.
    """

    surface_id: int
    T_map_object: Float64
    clearance: float
    T_map_bases: Float64


@dataclass(frozen=True, slots=True, eq=False)
class MapEvent:
    """A change of the map.

    Attributes
    ----------
    kind
        ``appeared``, ``moved``, ``merged``, ``split``, ``gone``, ``object_appeared`` or
        ``object_left``.
    ids_before, ids_after
        Ids of the surfaces that it concerns.
    object_id
        -1 where it is about surfaces alone.
    label
        Of the surface or the object.
    T_before, T_after
        float64 (4, 4) in map; None where there was none.
    """

    kind: str
    ids_before: tuple[int, ...]
    ids_after: tuple[int, ...]
    object_id: int
    label: str
    T_before: Float64 | None
    T_after: Float64 | None


EVENT_KINDS = {
    getattr(SurfaceEvent, name): name.lower()
    for name in (
        "APPEARED", "MOVED", "MERGED", "SPLIT", "GONE", "OBJECT_APPEARED", "OBJECT_LEFT"
    )
}  # fmt: skip


class SurfaceMapClient:
    """Asks slam_node, and hears of changes. Answers come by callbacks, or by `Future`.

    Parameters
    ----------
    node
        Whose executor calls back.
    name
        Of the node that has the map.

    Attributes
    ----------
    surfaces, objects
        Of the newest map that came; empty before.
    """

    def __init__(self, node: Node, name: str = "surface_slam"):
        self._node = node
        self._on_event: list[Callable[[MapEvent], object]] = []
        self._on_map: list[Callable[[], object]] = []
        self.surfaces: tuple[MapSurface, ...] = ()
        self.objects: tuple[MapObject, ...] = ()
        self._find_surfaces = node.create_client(FindSurfaces, f"{name}/find_surfaces")
        self._find_placements = node.create_client(FindPlacements, f"{name}/find_placements")
        node.create_subscription(SurfaceMap, f"{name}/surface_map", self._take_map, LATCHED)
        node.create_subscription(SurfaceEvent, f"{name}/events", self._take_event, 100)

    @property
    def is_ready(self) -> bool:
        """Whether the services are there and a map has come.

        No message tells that a service is there: who waits for it spins with a timeout.
        """
        clients = self._find_surfaces, self._find_placements
        return bool(self.surfaces) and all(client.service_is_ready() for client in clients)

    def on_event(self, callback: Callable[[MapEvent], object]) -> None:
        """Call back with each change of the map from now on."""
        self._on_event.append(callback)

    def on_map(self, callback: Callable[[], object]) -> None:
        """Call back after each new map, with `surfaces` and `objects` set."""
        self._on_map.append(callback)

    def objects_on(self, surface: MapSurface) -> list[MapObject]:
        """Return what stands on a surface of the newest map."""
        return [item for item in self.objects if item.surface_id == surface.id]

    def objects_of_class(self, label: str) -> list[MapObject]:
        """Return the objects of the newest map that are of a class, the surest first."""
        found = [item for item in self.objects if item.label == label]
        return sorted(found, key=lambda item: -item.confidence)

    def find_surfaces(self, filter: SurfaceFilter | None = None, max_count: int = 0) -> Future:
        """Ask for surfaces; the future has a list of `MapSurface`.

        Parameters
        ----------
        filter
            Conditions; all but the floor by default.
        max_count
            How many are wanted at most; 0 for all.
        """
        request = FindSurfaces.Request(filter=filter or SurfaceFilter(), max_count=max_count)
        return self._ask(
            self._find_surfaces, request, lambda answer: surfaces_of(answer.surfaces.surfaces)
        )

    def find_placements(
        self, size: Sequence[float], filter: SurfaceFilter | None = None, **fields: Any
    ) -> Future:
        """Ask where an object can be put down; the future has a list of `MapPlacement`.

        Parameters
        ----------
        size
            (3,), length, width and height of the object, m.
        filter
            Of the surfaces; all but the floor by default.
        fields
            Further fields of the request tccm_interfaces/FindPlacements.
        """
        x, y, z = map(float, size)
        request = FindPlacements.Request(
            size_x=x, size_y=y, height=z, filter=filter or SurfaceFilter(), **fields
        )
        return self._ask(
            self._find_placements,
            request,
            lambda answer: [_placement(p) for p in answer.placements],
        )

    def _ask(self, client: Any, request: Any, read: Callable[[Any], Any]) -> Future:
        """Return a future with the plain answer, or QuestionError with the node's sentence."""
        future = Future(executor=self._node.executor)

        def done(answered: Future) -> None:
            answer = answered.result()
            if answer.success:
                future.set_result(read(answer))
            else:
                future.set_exception(QuestionError(answer.message))

        client.call_async(request).add_done_callback(done)
        return future

    def _take_map(self, message: Any) -> None:
        self.surfaces = tuple(surfaces_of(message.surfaces))
        self.objects = tuple(
            MapObject(o.id, o.surface_id, o.label, o.confidence, _pose(o.pose), _vector(o.size))
            for o in message.objects
        )
        for callback in self._on_map:
            callback()

    def _take_event(self, message: Any) -> None:
        event = MapEvent(
            EVENT_KINDS.get(message.kind, "unknown"),
            tuple(message.surface_ids_before),
            tuple(message.surface_ids_after),
            message.object_id,
            message.label,
            *(
                None if math.isnan(pose.position.x) else _pose(pose)
                for pose in (message.pose_before, message.pose_after)
            ),
        )
        for callback in self._on_event:
            callback(event)


def surfaces_of(messages: Iterable[Any]) -> list[MapSurface]:
    """Return tccm_interfaces/Surface messages as plain objects."""
    return [
        MapSurface(
            m.id,
            m.label,
            m.room,
            _pose(m.pose),
            np.array([m.size_x, m.size_y]),
            m.height,
            m.area,
            np.array([_vector(p) for p in m.boundary.points]).reshape(-1, 3),
            tuple(m.near_signs),
            m,
        )
        for m in messages
    ]


def _placement(message: Any) -> MapPlacement:
    bases = np.array([_pose(base.pose) for base in message.base_poses]).reshape(-1, 4, 4)
    return MapPlacement(message.surface_id, _pose(message.pose), message.clearance, bases)


def _vector(message: Any) -> Float64:
    return np.array([message.x, message.y, message.z])


def _pose(message: Any) -> Float64:
    p, q = message.position, message.orientation
    return pose_from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
