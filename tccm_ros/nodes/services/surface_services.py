"""Services of slam_node that query the map and correct its labels.

They answer in the node's own process from the newest solution. An invalid request is answered with
a sentence.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from tccm_ros.arrays import Float64
from tccm_ros.errors import FrameError, MessageError
from tccm_ros.geometry import spatial
from tccm_ros.nodes.interfaces import offer_service
from tccm_ros.nodes.publishing.live_pose import LivePosePublisher
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.nodes.services.known_frames import KnownFrames
from tccm_ros.records import LabelCorrection, Surface
from tccm_ros.ros.surface_messages import (
    PACKAGE,
    SURFACE,
    found_object_message,
    object_message,
)
from tccm_ros.ros.types import MessageTypes, header_message, pose_message
from tccm_ros.scene.base_poses import BasePose
from tccm_ros.scene.queries import (
    MAX_PLACEMENTS,
    ObjectFilter,
    SurfaceFilter,
    SurfaceQueries,
)
from tccm_ros.scene.scene import Scene, placement_pose
from tccm_ros.surfaces.labels.corrected_labels import label_to_give
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.tabletop.placements import ApproachDirection, Placement, PlacementRequest

BASE_ANYWHERE, BASE_HERE, BASE_FIND = range(3)
"""Values of `base` in FindPlacements."""

APPROACHES = (ApproachDirection.ANY, ApproachDirection.ABOVE, ApproachDirection.FRONT)
"""By the number that FindPlacements has for each."""

MAX_SIZE_M = 10.0
"""Maximum edge length of an object, arm range and robot radius, m. Chosen."""

MIN_SIZE_M = 1e-3
"""Minimum edge length of an object, m. Chosen."""

MAX_BASE_POSES = 100
"""Maximum number of base poses of a placement. Chosen."""


class SceneQueries:
    """Queries of one scene, with the response messages built in advance.

    Parameters
    ----------
    scene
        Scene of one solution.
    types
        Message classes.
    """

    def __init__(self, scene: Scene, types: MessageTypes):
        self.scene = scene
        self.queries = SurfaceQueries(
            [known.surface for known in scene.surfaces],
            scene.objects,
            scene.floor_z,
            scene.compartments,
        )
        kind = message_class(SURFACE)
        self._surfaces = {
            k.surface.id: deserialize_message(k.message, kind) for k in scene.surfaces
        }
        self._objects = {
            item.id: object_message(types, scene.stamp_ns, scene.frame_id, item)
            for item in scene.objects
        }

    def messages(self, surfaces: Sequence[Surface]) -> list[Any]:
        """Return the tccm_interfaces/Surface of surfaces."""
        return [self._surfaces[surface.id] for surface in surfaces]

    def object_messages(self, objects: Iterable[SceneObject]) -> list[Any]:
        """Return the tccm_interfaces/SurfaceObject of objects."""
        return [self._objects[item.id] for item in objects]


class SurfaceServices:
    """Answers queries from the newest solution.

    Parameters
    ----------
    node, types
        Node of the services, and its message classes.
    live
        Pose of the robot.
    frames
        Poses of the robot's frames.
    correct_label
        Queues the correction of a label.

    Attributes
    ----------
    number
        Number of the solution in use; -1 if there is none.
    """

    def __init__(
        self,
        node: Node,
        types: MessageTypes,
        live: LivePosePublisher,
        frames: KnownFrames,
        correct_label: Callable[[LabelCorrection], Awaitable[object]],
    ):
        self._node, self._types, self._live, self._frames = node, types, live, frames
        self._correct_label = correct_label
        self._newest: SceneQueries | None = None
        self.number = -1
        offer_service(node, "FindSurfaces", "~/find_surfaces", self._find_surfaces)
        offer_service(node, "FindPlacements", "~/find_placements", self._find_placements)
        offer_service(node, "FindObjects", "~/find_objects", self._find_objects)
        offer_service(node, "SetLabel", "~/set_label", self._set_label)

    def answer_from(self, number: int, queries: SceneQueries | None) -> None:
        """Answer from the queries of a solution; without any, not at all until the next."""
        self._newest, self.number = queries, number

    def _current(self) -> SceneQueries:
        if self._newest is None:
            topic = self._node.resolve_topic_name("~/surface_map")
            raise FrameError(f"there is no map yet: wait for {topic}")
        return self._newest

    def surface(self, identity: int) -> Surface:
        """Return a surface above the floor by its id, or by the id of a surface merged into it.

        Raises
        ------
        FrameError, MessageError
            If there is no map yet, or no such surface.
        """
        found = self._current().queries.find_surfaces(SurfaceFilter(ids=frozenset({identity})))
        if not found:
            raise MessageError(f"there is no surface {identity}; ~/find_surfaces has them")
        if found[0].label == "floor":
            raise MessageError(f"surface {identity} is the floor, and stays it")
        return found[0]

    # --- frames ---

    def T_map_frame(self, frame: str) -> Float64:
        """Return the current pose (4, 4) of a frame in map.

        Raises
        ------
        FrameError
            If the frame is unknown.
        """
        if frame.lstrip("/") == self._live.map_frame:
            return np.eye(4)
        T_odom_frame = self._frames.T_odom_frame(frame)
        transform = self._live.transform()
        if transform is None:
            raise FrameError(
                f"'{frame}' has no place in the map yet: the robot has not been found in it"
            )
        t, q = transform.transform.translation, transform.transform.rotation
        yaw = 2.0 * math.atan2(q.z, q.w)
        T: Float64 = spatial(np.array([t.x, t.y, yaw])) @ T_odom_frame
        return T

    def _base_xy(self) -> tuple[float, float]:
        """Return the position of the base in map, m."""
        x, y, _ = self.T_map_frame(self._frames.base)[:3, 3].tolist()
        return x, y

    # --- find_surfaces ---

    def _find_surfaces(self, request: Any, response: Any) -> str:
        current = self._current()
        found = current.queries.find_surfaces(self._filter(request.filter))
        if request.max_count:
            found = found[: request.max_count]
        self._fill(response, current, found)
        return f"{len(found)} of {len(current.scene.surfaces)} surfaces"

    def _fill(self, response: Any, current: SceneQueries, found: Sequence[Surface]) -> None:
        """Put surfaces and the objects on them into a response."""
        response.surfaces.header = self._header(current)
        response.surfaces.surfaces = current.messages(found)
        response.objects = current.object_messages(current.queries.objects_on(found))

    def fill_view(self, response: Any, views_ns: Collection[int]) -> str:
        """Put the surfaces measured by some views into a response and return a sentence.

        Parameters
        ----------
        response
            Message with fields ``surfaces`` and ``objects``.
        views_ns
            Stamps of the views.
        """
        current = self._current()
        surfaces = [known.surface for known in current.scene.surfaces]
        messages = zip(surfaces, current.messages(surfaces))
        found = [surface for surface, m in messages if {*m.view_stamps} & {*views_ns}]
        self._fill(response, current, found)
        return f"{len(found)} of {len(current.scene.surfaces)} surfaces were measured"

    def _header(self, current: SceneQueries) -> Any:
        return header_message(self._types, current.scene.stamp_ns, current.scene.frame_id)

    def _filter(self, wanted: Any) -> SurfaceFilter:
        """Return the conditions of a tccm_interfaces/SurfaceFilter.

        Raises
        ------
        MessageError, FrameError
            If a number is invalid, or a frame is unknown.
        """
        for name in ("min_confidence", "min_area", "max_distance"):
            _check(f"filter.{name}", getattr(wanted, name), 0.0, math.inf)
        for name in ("min_height", "max_height"):
            _check(f"filter.{name}", getattr(wanted, name), -math.inf, math.inf)
        near = self._near(wanted.near, wanted.max_distance, "filter.")
        return SurfaceFilter(
            ids=frozenset(wanted.ids),
            labels=frozenset(wanted.labels),
            min_confidence=wanted.min_confidence,
            min_height=wanted.min_height,
            max_height=wanted.max_height,
            min_area=wanted.min_area,
            near=near,
            max_distance=wanted.max_distance,
            near_sign=wanted.near_sign,
            words=tuple(wanted.text.split()),
        )

    def _near(
        self, stamped: Any, max_distance: float, prefix: str = ""
    ) -> tuple[float, float] | None:
        """Return a geometry_msgs/PointStamped in map, x and y, m; None if it has no frame.

        Raises
        ------
        MessageError, FrameError
            Where it is not finite, where it is missing for a distance, and for an unknown frame.
        """
        if not stamped.header.frame_id:
            if max_distance > 0.0:
                raise MessageError(
                    f"{prefix}max_distance needs a point: {prefix}near has no frame_id"
                )
            return None
        xyz = np.array([stamped.point.x, stamped.point.y, stamped.point.z])
        if not np.isfinite(xyz).all():
            raise MessageError(f"{prefix}near is not finite")
        T = self.T_map_frame(stamped.header.frame_id)
        x, y, _ = (T[:3, :3] @ xyz + T[:3, 3]).tolist()
        return x, y

    # --- set_label ---

    async def _set_label(self, request: Any, _: Any) -> str:
        surface = self.surface(request.surface_id)
        if request.label:
            label_to_give(request.label)
        ids = (surface.id, *surface.merged_ids)
        await self._correct_label(LabelCorrection(ids, request.label))
        return f"surface {surface.id} was '{surface.label}'"

    # --- find_objects ---

    def _find_objects(self, request: Any, response: Any) -> str:
        for name in ("min_size", "max_size", "max_distance"):
            _check(name, getattr(request, name), 0.0, math.inf)
        for name in ("hand_width", "hand_height", "clearance"):
            _check(name, getattr(request, name), 0.0, MAX_SIZE_M, " m")
        current = self._current()
        wanted = ObjectFilter(
            frozenset(request.labels),
            frozenset(request.surface_ids),
            request.min_size,
            request.max_size,
            self._near(request.near, request.max_distance),
            request.max_distance,
            request.hand_width,
            request.hand_height,
            request.clearance,
        )
        found = current.queries.find_objects(wanted)
        if request.max_count:
            found = found[: request.max_count]
        messages = current.object_messages(f.item for f in found)
        response.objects = [
            found_object_message(self._types, m, f.above, f.front) for m, f in zip(messages, found)
        ]
        return f"{len(found)} of {len(current.scene.objects)} objects"

    # --- find_placements ---

    def _find_placements(self, request: Any, response: Any) -> str:
        _check_placements(request)
        current = self._current()
        wanted = self._filter(request.filter)
        low = max(wanted.min_height, request.min_reach_height)
        high = min(wanted.max_height, request.max_reach_height)
        wanted = replace(wanted, min_height=low, max_height=high)
        count = min(request.max_count or MAX_PLACEMENTS, MAX_PLACEMENTS)
        search = PlacementRequest(
            request.size_x,
            request.size_y,
            request.height,
            request.clearance,
            count,
            self._base_xy() if request.base == BASE_HERE else None,
            request.reach,
            APPROACHES[request.approach],
            request.hand_width,
            request.hand_height,
        )
        if request.base == BASE_FIND:
            bases = min(request.max_base_poses or 1, MAX_BASE_POSES)
            found = current.queries.find_reachable(
                wanted, search, current.scene.free_floor, request.reach, request.robot_radius, bases
            )
        else:
            found = [(p, []) for p in current.queries.find_placements(wanted, search)]
        response.placements = [self._placement(current, p, bases) for p, bases in found]
        if not found:
            return self._why_none(current, wanted, request)
        return "1 placement" if len(found) == 1 else f"{len(found)} placements"

    def _placement(
        self, current: SceneQueries, placement: Placement, bases: Sequence[BasePose]
    ) -> Any:
        return self._types.make(
            PACKAGE + "Placement",
            header=self._header(current),
            pose=pose_message(self._types, placement_pose(placement)),
            surface_id=placement.surface,
            clearance=float(placement.clearance),
            free_height=float(placement.free_height),
            base_poses=[self._base_pose(current, base) for base in bases],
        )

    def _base_pose(self, current: SceneQueries, base: BasePose) -> Any:
        T = spatial(np.array([base.x, base.y, base.yaw]), current.scene.floor_z or 0.0)
        return self._types.make(
            PACKAGE + "BasePose",
            pose=pose_message(self._types, T),
            distance=float(base.distance),
            clearance=float(base.clearance),
        )

    def _why_none(self, current: SceneQueries, wanted: SurfaceFilter, request: Any) -> str:
        surfaces = current.queries.find_surfaces(wanted)
        if not surfaces:
            known = {surface.label for surface in current.queries.find_surfaces(SurfaceFilter())}
            if wanted.labels and not wanted.labels & known:
                missing, there = (", ".join(sorted(names)) for names in (wanted.labels, known))
                return f"no surface is labelled {missing}; there are: {there}"
            return "no surface meets the conditions"
        size = f"{request.size_x:g} x {request.size_y:g} x {request.height:g} m"
        within = " within reach" if request.base != BASE_ANYWHERE and request.reach else ""
        if APPROACHES[request.approach] == ApproachDirection.FRONT:
            within += " behind a front"
        return (
            f"none of {len(surfaces)} surfaces has room{within} for {size} with a clearance of "
            f"{request.clearance:g} m"
        )


def _check(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise MessageError if a number is nan or outside its range."""
    if not low <= value <= high:
        raise MessageError(f"{name} is {value:g}{unit}; expected {low:g} to {high:g}{unit}")


def _check_placements(request: Any) -> None:
    """Raise MessageError if a FindPlacements request is invalid."""
    for name in ("size_x", "size_y", "height"):
        _check(name, getattr(request, name), MIN_SIZE_M, MAX_SIZE_M, " m")
    for name in ("clearance", "reach", "robot_radius", "hand_width", "hand_height"):
        _check(name, getattr(request, name), 0.0, MAX_SIZE_M, " m")
    for name in ("min_reach_height", "max_reach_height"):
        _check(name, getattr(request, name), -math.inf, math.inf)
    if request.approach >= len(APPROACHES):
        raise MessageError(
            f"approach is {request.approach}; expected APPROACH_ANY, APPROACH_ABOVE, APPROACH_FRONT"
        )
    if request.base not in (BASE_ANYWHERE, BASE_HERE, BASE_FIND):
        raise MessageError(f"base is {request.base}; expected BASE_ANYWHERE, BASE_HERE, BASE_FIND")
    if request.base == BASE_FIND and request.reach == 0.0:
        raise MessageError("reach is 0; with BASE_FIND, say how far the arm reaches")
