"""Client interfaces of slam_node: services, events, the view action and MoveIt objects."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from rclpy.task import Future

from tccm_ros.nodes.interfaces import has_interfaces, missing_interfaces
from tccm_ros.nodes.publishing.live_pose import LivePosePublisher
from tccm_ros.nodes.qos import EVENTS_DEPTH
from tccm_ros.nodes.ros_types import is_installed, message_class
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.services.collision import CollisionObjects
from tccm_ros.nodes.services.keepout import VectorShapes
from tccm_ros.nodes.services.known_frames import KnownFrames
from tccm_ros.nodes.services.map_services import MapServices
from tccm_ros.nodes.services.scan_here import ViewAction, offer_scan_here
from tccm_ros.nodes.services.surface_services import SceneQueries, SurfaceServices
from tccm_ros.nodes.solver.channel import Solved
from tccm_ros.nodes.solver.scene_channel import unpack_scene
from tccm_ros.records import LabelCorrection
from tccm_ros.ros.surface_messages import SURFACE_EVENT, change_message
from tccm_ros.scene.changes import Change, MapChanges
from tccm_ros.scene.scene import Scene


def offered(topics: Mapping[str, str]) -> dict[str, str]:
    """Return the topics whose message types are installed."""
    return {name: kind for name, kind in topics.items() if is_installed(kind)}


class ClientApi:
    """Interfaces for clients of the newest solution.

    Parameters
    ----------
    node, live
        The node, which owns the services and publishers, and the pose of the robot.
    begin_save
        Starts saving the map into a folder; returns a future of a sentence.
    load
        Continues the map of a folder under a name (in the worker).
    correct_label
        Queues the correction of a surface's label.
    """

    def __init__(
        self,
        node: SensorNode,
        live: LivePosePublisher,
        begin_save: Callable[[Path], Future],
        load: Callable[[Path, str], str],
        correct_label: Callable[[LabelCorrection], Future],
    ):
        self._node, self._live = node, live
        self._received: dict[int, tuple[Scene, SceneQueries | None]] = {}
        self._changes = MapChanges()
        self._boxes = CollisionObjects(node, node.types)
        self._shapes = VectorShapes(node, node.types)
        self._surfaces: SurfaceServices | None = None
        self._view_action: ViewAction | None = None
        if has_interfaces():
            kind = message_class(SURFACE_EVENT)
            self._events = node.create_publisher(kind, "~/events", EVENTS_DEPTH)
            frames = KnownFrames(node.robot, node.config)
            self._surfaces = SurfaceServices(node, node.types, live, frames, correct_label)
            self._view_action = offer_scan_here(node, frames, self._surfaces)
            MapServices(node, begin_save, load)

    def receive(self, solved: Solved) -> None:
        """Prepare a solution for queries (in the thread that receives solutions)."""
        scene = unpack_scene(solved.scene)
        queries = SceneQueries(scene, self._node.types) if self._surfaces is not None else None
        self._received[solved.number] = scene, queries

    def show(self, number: int, after_newest_view: Callable[[Scene], Scene]) -> None:
        """Answer queries from a received solution and publish its changes (in the worker).

        Parameters
        ----------
        number
            Number of the solution; older ones are freed.
        after_newest_view
            Returns the scene of the solution with the objects of newer views, for planners.
        """
        scene, queries = self._received[number]
        for old in [n for n in self._received if n <= number]:
            del self._received[old]
        if self._surfaces is not None:
            self._surfaces.answer_from(number, queries)
        for change in self._changes.note(scene, self._node.config.objects.agreeing_views):
            self._node.get_logger().info(str(change))
            self._publish(change, scene.frame_id)
        self._boxes.publish(after_newest_view(scene))
        self._shapes.send(scene)
        self._live.show_surfaces(scene)

    def _publish(self, change: Change, frame_id: str) -> None:
        if has_interfaces() and self._node.context.ok():
            self._events.publish(change_message(self._node.types, frame_id, change))

    @property
    def has_scene_listeners(self) -> bool:
        """Whether any listener receives objects between solutions."""
        return self._boxes.has_listeners

    def show_objects(self, scene: Scene) -> None:
        """Publish the objects of a scene between solutions (in the worker)."""
        self._boxes.publish(scene)

    def forget(self, *, is_map_loaded: bool) -> None:
        """Answer no queries until the next solution; the first of a loaded map is no change."""
        self._changes = MapChanges(is_map_loaded=is_map_loaded)
        if self._surfaces is not None:
            self._surfaces.answer_from(-1, None)

    def note_view_message(self, stamp_ns: int, number: int) -> None:
        """Note a message of a view, and the number of the first solution that contains it."""
        if self._view_action is not None:
            self._view_action.note_view_message(stamp_ns, number)

    def close(self) -> None:
        """End the action server."""
        if self._view_action is not None:
            self._view_action.close()

    def problems(self) -> Iterator[str]:
        """Yield the reason if tccm_interfaces is missing."""
        if missing_interfaces():
            yield missing_interfaces()
