"""`SurfaceMapClient`: the surface map for Python nodes, as plain objects.

It needs `tccm_interfaces`, and the node that it is given spun by its owner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Vector3
from numpy.typing import ArrayLike, NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from tccm_interfaces.msg import Localisation, SurfaceEvent, SurfaceFilter, SurfaceMap
from tccm_interfaces.srv import (
    CheckBox,
    FindPlacements,
    FindSurfaces,
    ListMaps,
    LoadMap,
    SaveMap,
    SetLabel,
    SetPose,
)

from tccm_ros.errors import QuestionError
from tccm_ros.nodes.map_records import (
    Found,
    MapEvent,
    MapLocalisation,
    MapObject,
    MapSign,
    MapSurface,
    MapWall,
    box_state_of,
    event_of,
    localisation_of,
    nanoseconds,
    objects_of,
    placements_of,
    saved_map_of,
    signs_of,
    surfaces_of,
    walls_of,
)
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.ros.types import pose_message

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

EVENTS_DEPTH = 100
"""That of ~/events."""

MAP_SERVICES = {
    FindSurfaces: "find_surfaces",
    FindPlacements: "find_placements",
    SetLabel: "set_label",
    SetPose: "set_pose",
    SaveMap: "save_named_map",
    LoadMap: "load_named_map",
    ListMaps: "list_maps",
}
"""What is asked of the node that has the map."""


ANYWHERE = FindPlacements.Request()
"""Its fields are what is asked for by default."""


class SurfaceMapClient:
    """Asks both nodes, and hears of changes.

    Each question returns a future at once; it has the answer, or `QuestionError` with a sentence
    where the question was wrong, its work failed, or nobody is there to answer it. A node that ends
    before it has answered leaves the future undone.

    Parameters
    ----------
    node
        Whose executor calls back.
    name
        Of the node that has the map.
    tilt_name
        Of the node that has the integration map, which answers `check_box`.

    Attributes
    ----------
    surfaces, objects, walls, signs
        Of the newest map that came; empty before.
    stamp_ns
        Of the newest map, ns; None before.
    localisation
        Whether the robot knows where it is; None before the first message of it.
    """

    def __init__(self, node: Node, name: str = "surface_slam", tilt_name: str = "tccm"):
        self._node, self._types = node, RosidlMessages()
        self._on_event: list[Callable[[MapEvent], object]] = []
        self._on_map: list[Callable[[], object]] = []
        self.surfaces: tuple[MapSurface, ...] = ()
        self.objects: tuple[MapObject, ...] = ()
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
            (SurfaceMap, "surface_map", self._take_map, LATCHED),
            (Localisation, "localisation", self._take_localisation, LATCHED),
            (SurfaceEvent, "events", self._take_event, EVENTS_DEPTH),
        ):
            node.create_subscription(kind, f"{name}/{topic}", take, qos)

    @property
    def is_ready(self) -> bool:
        """Whether a map has come, and the services of its node are there."""
        return bool(self.surfaces) and self.has_services

    @property
    def has_services(self) -> bool:
        """Whether the services of the node that has the map are there.

        No message tells that a service is there: who waits for it spins with a timeout.
        """
        return all(client.service_is_ready() for client in self._clients.values())

    @property
    def can_check_boxes(self) -> bool:
        """Whether the service is there that answers `check_box`."""
        return self._check_box.service_is_ready()

    def on_event(self, callback: Callable[[MapEvent], object]) -> None:
        """Call back with each change of the map from now on."""
        self._on_event.append(callback)

    def on_map(self, callback: Callable[[], object]) -> None:
        """Call back after each new map, with `surfaces`, `objects`, `walls` and `signs` set."""
        self._on_map.append(callback)

    def objects_on(self, surface: MapSurface) -> list[MapObject]:
        """Return what stands on a surface of the newest map."""
        return [item for item in self.objects if item.surface_id == surface.id]

    def objects_of_class(self, label: str) -> list[MapObject]:
        """Return the objects of the newest map that are of a class, the surest first."""
        found = [item for item in self.objects if item.label == label]
        return sorted(found, key=lambda item: -item.confidence)

    # --- questions ---

    def find_surfaces(self, filter: SurfaceFilter | None = None, max_count: int = 0) -> Future:
        """Ask for surfaces; the future has `MapSurface` as `Found`.

        Parameters
        ----------
        filter
            Conditions; all but the floor by default.
        max_count
            How many are wanted at most; 0 for all.

        Raises
        ------
        TypeError
            For a filter that is none.
        """
        request = FindSurfaces.Request(filter=_checked(filter), max_count=max_count)
        return self._ask_map(
            FindSurfaces,
            request,
            lambda answer: Found(surfaces_of(answer.surfaces.surfaces), answer.message),
        )

    def find_placements(
        self,
        size: Sequence[float],
        filter: SurfaceFilter | None = None,
        *,
        clearance: float = ANYWHERE.clearance,
        base: int = ANYWHERE.base,
        reach: float = ANYWHERE.reach,
        min_reach_height: float = ANYWHERE.min_reach_height,
        max_reach_height: float = ANYWHERE.max_reach_height,
        robot_radius: float = ANYWHERE.robot_radius,
        max_count: int = ANYWHERE.max_count,
        max_base_poses: int = ANYWHERE.max_base_poses,
    ) -> Future:
        """Ask where an object can be put down; the future has `MapPlacement` as `Found`.

        Parameters
        ----------
        size
            (3,), length, width and height of the object, m.
        filter
            Of the surfaces; all but the floor by default, seats and steps among them.
        clearance, base, reach, min_reach_height, max_reach_height, robot_radius
            As in the request tccm_interfaces/FindPlacements; `base` is one of its constants.
        max_count, max_base_poses
            How many are wanted at most.

        Raises
        ------
        TypeError, ValueError
            For a filter or a size that is none.
        """
        x, y, z = _lengths(size)
        request = FindPlacements.Request(
            filter=_checked(filter),
            size_x=x,
            size_y=y,
            height=z,
            clearance=float(clearance),
            base=base,
            reach=float(reach),
            min_reach_height=float(min_reach_height),
            max_reach_height=float(max_reach_height),
            robot_radius=float(robot_radius),
            max_count=max_count,
            max_base_poses=max_base_poses,
        )
        return self._ask_map(
            FindPlacements,
            request,
            lambda answer: Found(placements_of(answer.placements), answer.message),
        )

    def check_box(self, T_frame_box: ArrayLike, size: Sequence[float], frame: str) -> Future:
        """Ask whether anything is in a box; the future has a `BoxState`.

        Parameters
        ----------
        T_frame_box
            float64 (4, 4), middle and orientation of the box.
        size
            (3,), edges along its own axes, m.
        frame
            Of the pose: a link of the robot or the odometry frame.
        """
        x, y, z = _lengths(size)
        stamped = PoseStamped(pose=self._pose(T_frame_box))
        stamped.header.frame_id = frame
        request = CheckBox.Request(pose=stamped, size=Vector3(x=x, y=y, z=z))
        return self._ask(self._check_box, request, box_state_of)

    # --- what a person knows ---

    def set_label(self, surface_id: int, label: str) -> Future:
        """Correct the label of a surface; the future has a sentence with what it was called.

        The label holds from the next solution on, and in saved maps.

        Parameters
        ----------
        surface_id
            Its id, or one that was merged into it.
        label
            One of the labels but ``floor``; empty: the rules decide again.
        """
        request = SetLabel.Request(surface_id=surface_id, label=label)
        return self._ask_map(SetLabel, request, lambda answer: answer.message)

    def set_pose(self, T_map_base: ArrayLike, covariance: ArrayLike | None = None) -> Future:
        """Tell where the robot is; the future has nothing. `localisation` tells what comes of it.

        Parameters
        ----------
        T_map_base
            float64 (4, 4), of the base.
        covariance
            float64 (6, 6) of (x, y, z, rotations about x, y, z), m and rad; a rough guess by
            default.
        """
        stamped = PoseWithCovarianceStamped()
        stamped.pose.pose = self._pose(T_map_base)
        if covariance is not None:
            stamped.pose.covariance = np.asarray(covariance, np.float64).ravel()
        return self._ask_map(SetPose, SetPose.Request(pose=stamped), lambda _: None)

    # --- saved maps ---

    def save_named_map(self, name: str, *, overwrite: bool = False) -> Future:
        """Save the map; the future has a `SavedMap`.

        Parameters
        ----------
        name
            Letters, digits, ``.``, ``-`` and ``_``, not beginning with a dot.
        overwrite
            Whether a map of this name may be replaced.
        """
        request = SaveMap.Request(name=name, overwrite=overwrite)
        return self._ask_map(SaveMap, request, lambda answer: saved_map_of(answer.map))

    def load_named_map(self, name: str) -> Future:
        """Go on with a saved map; the future has a `SavedMap`."""
        request = LoadMap.Request(name=name)
        return self._ask_map(LoadMap, request, lambda answer: saved_map_of(answer.map))

    def list_maps(self) -> Future:
        """Ask which maps are saved; the future has a list of `SavedMap`, ordered by name."""
        return self._ask_map(
            ListMaps, ListMaps.Request(), lambda answer: [saved_map_of(m) for m in answer.maps]
        )

    def _ask_map(self, kind: type, request: Any, read: Callable[[Any], object]) -> Future:
        return self._ask(self._clients[kind], request, read)

    def _ask(self, client: Any, request: Any, read: Callable[[Any], object]) -> Future:
        """Return a future with the plain answer, or QuestionError with the node's sentence.

        It has no executor, so that what waits for it is told at once. As tasks of an executor, the
        callbacks that each `rclpy.spin_until_future_complete` adds in every step would be left to
        the next question, which would take longer each time (rclpy 7.1; ros2/rclpy#1702).
        """
        future = Future()
        if not client.service_is_ready():
            why = f"nobody answers {client.service_name}: is its node running, under this name?"
            future.set_exception(QuestionError(why))
            return future

        def done(answered: Future) -> None:
            answer = answered.result()
            if answer.success:
                future.set_result(read(answer))
            else:
                future.set_exception(QuestionError(answer.message))

        client.call_async(request).add_done_callback(done)
        return future

    def _pose(self, T: ArrayLike) -> Any:
        return pose_message(self._types, _rigid(T))

    # --- what comes by itself ---

    def _take_map(self, message: Any) -> None:
        self.surfaces = tuple(surfaces_of(message.surfaces))
        self.objects = tuple(objects_of(message.objects))
        self.walls = tuple(walls_of(message.walls))
        self.signs = tuple(signs_of(message.signs))
        self.stamp_ns = nanoseconds(message.header.stamp)
        for callback in self._on_map:
            callback()

    def _take_localisation(self, message: Any) -> None:
        self.localisation = localisation_of(message)

    def _take_event(self, message: Any) -> None:
        event = event_of(message)
        for callback in self._on_event:
            callback(event)


def _checked(filter: SurfaceFilter | None) -> SurfaceFilter:
    """Return a filter that messages take: what they do not take ends the process, or says nothing.

    Raises
    ------
    TypeError
        Where it is none.
    """
    if filter is None:
        return SurfaceFilter()
    if not isinstance(filter, SurfaceFilter):
        raise TypeError(f"filter is {filter!r}; expected a tccm_interfaces.msg.SurfaceFilter")
    if isinstance(filter.labels, str):
        raise TypeError(f"filter.labels is {filter.labels!r}; expected a list of labels")
    return filter


def _rigid(T: ArrayLike) -> NDArray[np.float64]:
    """Return a pose as float64 (4, 4).

    Raises
    ------
    ValueError
        Where it is none: a matrix of zeros has a quaternion all the same.
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
    """Return the three lengths of a box.

    Raises
    ------
    ValueError
        Where there are others than three.
    """
    lengths = np.asarray(size, np.float64)
    if lengths.shape != (3,):
        raise ValueError(f"size is {size!r}; expected (length, width, height), m")
    x, y, z = lengths.tolist()
    return x, y, z
