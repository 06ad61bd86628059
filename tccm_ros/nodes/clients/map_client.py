"""`SurfaceMapClient`: client of the surface map for Python nodes, with plain objects as results.

It needs `tccm_interfaces`, and its owner must spin the node passed to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Vector3
from numpy.typing import ArrayLike, NDArray
from rclpy.node import Node
from rclpy.task import Future
from tccm_interfaces.action import ApproachSurface, Retreat
from tccm_interfaces.msg import Localisation, SurfaceEvent, SurfaceFilter, SurfaceMap
from tccm_interfaces.srv import (
    CheckBox,
    FindObjects,
    FindPlacements,
    FindSurfaces,
    ListMaps,
    LoadMap,
    ResolveName,
    SaveMap,
    SetLabel,
    SetName,
    SetPose,
)

from tccm_ros.nodes.clients.approach_client import ApproachClient
from tccm_ros.nodes.clients.requests import ask, filled, stamped_point
from tccm_ros.nodes.qos import EVENTS_DEPTH, latched_qos
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records.building import stamp_ns_from_message
from tccm_ros.ros.map_records import (
    BoxState,
    Found,
    MapApproach,
    MapCompartment,
    MapEvent,
    MapFoundObject,
    MapLocalisation,
    MapObject,
    MapPlacement,
    MapSign,
    MapSpot,
    MapSurface,
    MapWall,
    SavedMapInfo,
)
from tccm_ros.ros.types import pose_message

MAP_SERVICES = {
    FindSurfaces: "find_surfaces",
    FindPlacements: "find_placements",
    FindObjects: "find_objects",
    SetLabel: "set_label",
    SetPose: "set_pose",
    SaveMap: "save_named_map",
    LoadMap: "load_named_map",
    ListMaps: "list_maps",
}
"""Services of the node that owns the map."""


class SurfaceMapClient:
    """Client of slam_node's and tccm_node's services, topics and events.

    Each request returns a future at once. It resolves to the answer, or to `RequestError` if the
    request was invalid, its processing failed or the service is not available. If a node ends
    before it has answered, the future stays pending.

    Parameters
    ----------
    node
        Node that is spun by the caller; its executor runs the callbacks.
    name
        Name of the node that owns the surface map.
    tilt_name
        Name of the node that owns the integration map and answers `check_box`.
    approach_name
        Name of the node that drives the base.

    Attributes
    ----------
    surfaces, objects, compartments, walls, signs
        Contents of the newest map received; empty before the first.
    stamp_ns
        Of the newest map, ns; None before the first.
    localisation
        Whether the robot is localised; None before the first message.
    """

    def __init__(
        self,
        node: Node,
        name: str = "surface_slam",
        tilt_name: str = "tccm",
        approach_name: str = "approach",
    ):
        self._approach_name = approach_name
        self._approach_client: ApproachClient | None = None
        self._node, self._types = node, RosidlMessages()
        self._on_event: list[Callable[[MapEvent], object]] = []
        self._on_map: list[Callable[[], object]] = []
        self.surfaces: tuple[MapSurface, ...] = ()
        self.objects: tuple[MapObject, ...] = ()
        self.compartments: tuple[MapCompartment, ...] = ()
        self.walls: tuple[MapWall, ...] = ()
        self.signs: tuple[MapSign, ...] = ()
        self.stamp_ns: int | None = None
        self.localisation: MapLocalisation | None = None
        self._clients = {
            kind: node.create_client(kind, f"{name}/{service}")
            for kind, service in MAP_SERVICES.items()
        }
        self._check_box = node.create_client(CheckBox, f"{tilt_name}/check_box")
        for kind, topic, take, qos in (
            (SurfaceMap, "surface_map", self._take_map, latched_qos()),
            (Localisation, "localisation", self._take_localisation, latched_qos()),
            (SurfaceEvent, "events", self._take_event, EVENTS_DEPTH),
        ):
            node.create_subscription(kind, f"{name}/{topic}", take, qos)

    @property
    def is_ready(self) -> bool:
        """Whether a map, maybe an empty one, was received and the services are available."""
        return self.stamp_ns is not None and self.has_services

    @property
    def has_services(self) -> bool:
        """Whether all services of the node that owns the map are available.

        No message announces a service; to wait for one, spin with a timeout.
        """
        return all(client.service_is_ready() for client in self._clients.values())

    @property
    def can_check_boxes(self) -> bool:
        """Whether the service behind `check_box` is available."""
        return self._check_box.service_is_ready()

    def on_event(self, callback: Callable[[MapEvent], object]) -> None:
        """Call back with each change of the map from now on."""
        self._on_event.append(callback)

    def on_map(self, callback: Callable[[], object]) -> None:
        """Call back after each new map, with `surfaces`, `objects`, `walls` and `signs` set."""
        self._on_map.append(callback)

    def objects_on(self, surface: MapSurface) -> list[MapObject]:
        """Return the objects on a surface of the newest map."""
        return [item for item in self.objects if item.surface_id == surface.id]

    def objects_of_class(self, label: str) -> list[MapObject]:
        """Return the objects of a class in the newest map, the most confident first."""
        found = [item for item in self.objects if item.label == label]
        return sorted(found, key=lambda item: -item.confidence)

    # --- queries ---

    def find_surfaces(self, filter: SurfaceFilter | None = None, max_count: int = 0) -> Future:
        """Find surfaces; the future resolves to `Found` of `MapSurface`.

        Parameters
        ----------
        filter
            Conditions; by default all surfaces except the floor.
        max_count
            Maximum number of surfaces; 0 for all.

        Raises
        ------
        TypeError
            If the filter is not a SurfaceFilter.
        """
        request = FindSurfaces.Request(filter=_checked(filter), max_count=max_count)
        return self._ask_map(FindSurfaces, request, _found(MapSurface, "surfaces.surfaces"))

    def find_placements(
        self, size: Sequence[float], filter: SurfaceFilter | None = None, **conditions: Any
    ) -> Future:
        """Find placements of an object; the future resolves to `Found` of `MapPlacement`.

        Parameters
        ----------
        size
            (3,), length, width and height of the object, m.
        filter
            Conditions for surfaces; by default all except the floor, including seats and steps.
        conditions
            Other fields of the request tccm_interfaces/FindPlacements: `clearance`, `approach`,
            `hand_width`, `hand_height`, `base`, `reach`, `min_reach_height`, `max_reach_height`,
            `robot_radius`, `max_count`, `max_base_poses`.

        Raises
        ------
        TypeError, ValueError
            If the filter, the size or the name of a condition is invalid.
        """
        x, y, z = _lengths(size)
        lengths = {"size_x": x, "size_y": y, "height": z}
        request = filled(FindPlacements.Request(filter=_checked(filter)), **lengths, **conditions)
        return self._ask_map(FindPlacements, request, _found(MapPlacement, "placements"))

    def find_objects(self, labels: Sequence[str] = (), **conditions: Any) -> Future:
        """Find objects; the future resolves to `Found` of `MapFoundObject`.

        Parameters
        ----------
        labels
            Classes assigned by detectors; any by default.
        conditions
            Other fields of the request tccm_interfaces/FindObjects: `surface_ids`, `min_size`,
            `max_size`, `near`, `max_distance`, `hand_width`, `hand_height`, `clearance`,
            `max_count`.

        Raises
        ------
        TypeError
            If `labels` is a string, or the name of a condition is invalid.
        """
        request = filled(FindObjects.Request(), labels=labels, **conditions)
        return self._ask_map(FindObjects, request, _found(MapFoundObject, "objects"))

    def check_box(self, T_frame_box: ArrayLike, size: Sequence[float], frame: str) -> Future:
        """Check whether a box is free; the future resolves to a `BoxState`.

        Parameters
        ----------
        T_frame_box
            float64 (4, 4), centre and orientation of the box.
        size
            (3,), edge lengths along the box's axes, m.
        frame
            Frame of the pose: a link of the robot or the odometry frame.
        """
        x, y, z = _lengths(size)
        stamped = PoseStamped(pose=self._pose(T_frame_box))
        stamped.header.frame_id = frame
        request = CheckBox.Request(pose=stamped, size=Vector3(x=x, y=y, z=z))
        return ask(self._check_box, request, BoxState.of)

    # --- driving ---

    @property
    def can_approach(self) -> bool:
        """Whether approach_node has been discovered; poll it, as discovery takes a moment."""
        return self._driver.is_ready

    def approach(
        self,
        filter: SurfaceFilter | None = None,
        *,
        spot: Sequence[float] | None = None,
        frame: str = "map",
        side: float | None = None,
        gap: float = 0.0,
        reach: float = 0.0,
        name: str = "",
    ) -> Future:
        """Drive the base to a surface; the future resolves to a `MapApproach` on arrival.

        Parameters
        ----------
        filter
            Conditions on the surface; the nearest that meets them is taken.
        name
            Of a spot: its surface, spot and side are taken in place of a filter.
        spot, frame
            x and y of the point that the arm needs to get to, m, and their frame: that of the map
            or of the base.
        side, gap, reach
            As in the goal of tccm_interfaces/ApproachSurface; None and 0 for the node's defaults.
        """
        goal = filled(
            ApproachSurface.Goal(filter=_checked(filter)),
            name=name,
            gap=gap,
            reach=reach,
            **_spot(spot, frame, side),
        )
        return self._driver.drive(ApproachSurface, goal, MapApproach.of)

    def retreat(self, distance: float = 0.0) -> Future:
        """Drive the base straight back, m; the future resolves to the distance driven."""
        goal = filled(Retreat.Goal(), distance=distance)
        return self._driver.drive(Retreat, goal, lambda result: float(result.distance))

    def resolve_name(self, name: str) -> Future:
        """Find a named spot in the present map; the future resolves to a `MapSpot`."""
        return self._driver.ask(ResolveName, ResolveName.Request(name=name), MapSpot.of)

    def set_name(
        self,
        name: str,
        filter: SurfaceFilter | None = None,
        *,
        spot: Sequence[float] | None = None,
        frame: str = "map",
        side: float | None = None,
    ) -> Future:
        """Give a spot a name; the future resolves to a sentence with its previous meaning.

        Parameters
        ----------
        name
            As ``kitchen/counter``.
        filter
            With ids, the name follows that surface when it is moved; otherwise it stands for the
            surface that meets the conditions when it is used.
        spot, frame, side
            As in `approach`; both move with the surface.
        """
        request = SetName.Request(name=name, filter=_checked(filter))
        filled(request, **_spot(spot, frame, side))
        return self._driver.ask(SetName, request, lambda answer: str(answer.message))

    def forget_name(self, name: str) -> Future:
        """Remove a name; the future resolves to a sentence with its meaning."""
        request = SetName.Request(name=name, forget=True)
        return self._driver.ask(SetName, request, lambda answer: str(answer.message))

    def cancel(self) -> None:
        """Stop the base: the active goal ends, and its future raises `RequestError`."""
        self._driver.cancel()

    def close(self) -> None:
        """Release the action clients, if any were made."""
        if self._approach_client is not None:
            self._approach_client.close()
            self._approach_client = None

    @property
    def _driver(self) -> ApproachClient:
        """The client of approach_node, made on first use: few programs drive."""
        if self._approach_client is None:
            self._approach_client = ApproachClient(self._node, self._approach_name)
        return self._approach_client

    # --- corrections by a user ---

    def set_label(self, surface_id: int, label: str) -> Future:
        """Set the label of a surface; the future resolves to a sentence with the previous label.

        The label applies from the next solution on, and in saved maps.

        Parameters
        ----------
        surface_id
            Id of the surface, or one that was merged into it.
        label
            One of the labels except ``floor``; empty to let the rules decide again.
        """
        request = SetLabel.Request(surface_id=surface_id, label=label)
        return self._ask_map(SetLabel, request, lambda answer: answer.message)

    def set_pose(self, T_map_base: ArrayLike, covariance: ArrayLike | None = None) -> Future:
        """Set the robot's pose; the future resolves to None, and `localisation` shows the outcome.

        Parameters
        ----------
        T_map_base
            float64 (4, 4), pose of the base.
        covariance
            float64 (6, 6) of (x, y, z, rotations about x, y, z), m and rad; a coarse default if
            None.
        """
        stamped = PoseWithCovarianceStamped()
        stamped.pose.pose = self._pose(T_map_base)
        if covariance is not None:
            stamped.pose.covariance = np.asarray(covariance, np.float64).ravel()
        return self._ask_map(SetPose, SetPose.Request(pose=stamped), lambda _: None)

    # --- saved maps ---

    def save_named_map(self, name: str, *, overwrite: bool = False) -> Future:
        """Save the map under a name; the future resolves to a `SavedMapInfo`.

        Parameters
        ----------
        name
            Letters, digits, ``.``, ``-`` and ``_``; the first character is not a dot.
        overwrite
            Whether an existing map of this name may be replaced.
        """
        request = SaveMap.Request(name=name, overwrite=overwrite)
        return self._ask_map(SaveMap, request, lambda answer: SavedMapInfo.of(answer.map))

    def load_named_map(self, name: str) -> Future:
        """Load a saved map and continue it; the future resolves to a `SavedMapInfo`."""
        request = LoadMap.Request(name=name)
        return self._ask_map(LoadMap, request, lambda answer: SavedMapInfo.of(answer.map))

    def list_maps(self) -> Future:
        """List the saved maps; the future resolves to a list of `SavedMapInfo`, sorted by name."""
        return self._ask_map(
            ListMaps, ListMaps.Request(), lambda answer: [*map(SavedMapInfo.of, answer.maps)]
        )

    def _ask_map(self, kind: type, request: Any, read: Callable[[Any], object]) -> Future:
        return ask(self._clients[kind], request, read)

    def _pose(self, T: ArrayLike) -> Any:
        return pose_message(self._types, _rigid(T))

    # --- subscriptions ---

    def _take_map(self, message: Any) -> None:
        self.surfaces = tuple(map(MapSurface.of, message.surfaces))
        self.objects = tuple(map(MapObject.of, message.objects))
        self.compartments = tuple(map(MapCompartment.of, message.compartments))
        self.walls = tuple(map(MapWall.of, message.walls))
        self.signs = tuple(map(MapSign.of, message.signs))
        self.stamp_ns = stamp_ns_from_message(message.header.stamp)
        for callback in self._on_map:
            callback()

    def _take_localisation(self, message: Any) -> None:
        self.localisation = MapLocalisation.of(message)

    def _take_event(self, message: Any) -> None:
        event = MapEvent.of(message)
        for callback in self._on_event:
            callback(event)


def _found(kind: Any, field: str) -> Callable[[Any], Found[Any]]:
    """Return the conversion of responses whose field is a list of messages of a kind of record."""
    return lambda answer: Found(map(kind.of, attrgetter(field)(answer)), answer.message)


def _checked(filter: SurfaceFilter | None) -> SurfaceFilter:
    """Return a filter that is valid in a request; None becomes the default filter.

    An invalid field would end the process or be ignored silently.

    Raises
    ------
    TypeError
        If it is not a SurfaceFilter, or if its labels are a string.
    """
    if filter is None:
        return SurfaceFilter()
    if not isinstance(filter, SurfaceFilter):
        raise TypeError(f"filter is {filter!r}; expected a tccm_interfaces.msg.SurfaceFilter")
    if isinstance(filter.labels, str):
        raise TypeError(f"filter.labels is {filter.labels!r}; expected a list of labels")
    return filter


def _spot(spot: Sequence[float] | None, frame: str, side: float | None) -> dict[str, Any]:
    """Return the fields `spot`, `has_side` and `side` of a goal or a request."""
    point = None if spot is None else stamped_point(spot, frame)
    return {"spot": point, "has_side": side is not None, "side": side}


def _rigid(T: ArrayLike) -> NDArray[np.float64]:
    """Return a pose as float64 (4, 4) after checking it.

    Raises
    ------
    ValueError
        If it is not a rigid transform; a matrix of zeros would also give a quaternion.
    """
    matrix = np.asarray(T, np.float64)
    if matrix.shape != (4, 4):
        raise ValueError(f"a pose of shape {matrix.shape}; expected (4, 4)")
    R = matrix[:3, :3]
    is_rotation = np.allclose(R @ R.T, np.eye(3), atol=1e-3) and np.linalg.det(R) > 0.0
    if not (np.isfinite(matrix).all() and is_rotation):
        raise ValueError(f"a pose whose upper left 3 x 3 is no rotation: {R.tolist()}")
    return matrix


def _lengths(size: Sequence[float]) -> tuple[float, float, float]:
    """Return the three edge lengths of a box.

    Raises
    ------
    ValueError
        If there are not exactly three.
    """
    lengths = np.asarray(size, np.float64)
    if lengths.shape != (3,):
        raise ValueError(f"size is {size!r}; expected (length, width, height), m")
    x, y, z = lengths.tolist()
    return x, y, z
