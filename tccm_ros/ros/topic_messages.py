"""Build the messages of a tilt cycle and of a solution, by topic, for live nodes and result.mcap.

Each message is built only when needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.baselines.center_cores import center_cores
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, Cuboids
from tccm_ros.geometry import transform
from tccm_ros.mapping.tccm import CyclePlanes, CycleResult
from tccm_ros.ros.marker_parts import MarkerSet, MessageContext, identity_color, moved_markers
from tccm_ros.ros.markers import (
    compartment_markers,
    core_markers,
    cuboid_markers,
    label_markers,
    object_markers,
    plane_markers,
    sign_markers,
    surface_markers,
    wall_markers,
)
from tccm_ros.ros.output_messages import (
    map_cloud_message,
    obstacle_cloud_message,
    path_message,
    surface_map_message,
)
from tccm_ros.ros.surface_messages import (
    SURFACE_MAP,
    SURFACE_OBJECTS,
    objects_message,
    typed_map_message,
)
from tccm_ros.ros.table_messages import TABLES, tables_message
from tccm_ros.ros.types import MessageTypes
from tccm_ros.ros.writing import object_boxes_message, surface_cloud_message, view_message

if TYPE_CHECKING:  # tccm_node does not import the graph; gtsam would add 40 MB
    from tccm_ros.mapping.surface_slam import SurfaceSolution

MARKERS = "visualization_msgs/msg/MarkerArray"
CLOUD = "sensor_msgs/msg/PointCloud2"

CYCLE_TOPICS = {
    "planes": MARKERS,
    "objects": MARKERS,
    "cuboids": MARKERS,
    "center_cores": MARKERS,
    "map_cloud": CLOUD,
    "obstacles": CLOUD,
    "surfaces": CLOUD,
    "view": CLOUD,
    "object_boxes": CLOUD,
}
"""Private topics of the TCCM node and their types (docs/reference/nodes.md)."""

SURFACE_MESSAGE_TOPICS = ("surfaces", "view", "object_boxes")
"""The `CYCLE_TOPICS` that the SLAM node subscribes to: one message per tilt cycle, never
skipped."""

SOLUTION_TOPICS = {
    "path": "nav_msgs/msg/Path",
    "walls": MARKERS,
    "signs": MARKERS,
    "surfaces": MARKERS,
    "surface_cloud": CLOUD,
    "surface_map": SURFACE_MAP,
    "objects": SURFACE_OBJECTS,
    "tables": TABLES,
}
"""Private topics of the SLAM node with a solution, and their types."""


class TopicMessage(NamedTuple):
    """A message for a private topic of a node, built when needed.

    Attributes
    ----------
    topic
        Name of the topic within the node's namespace.
    msgtype
        Message type, such as ``sensor_msgs/msg/PointCloud2``.
    build
        Returns the message.
    """

    topic: str
    msgtype: str
    build: Callable[[], Any]


class CycleMessageBuilder:
    """Builds the messages of tilt cycles; its marker arrays delete previous markers.

    Parameters
    ----------
    types
        Message classes.
    config
        Groups `map`, `markers` and `center_core`.
    T_odom_near
        Returns the pose float64 (4, 4) of the tilt cycles' frame in the published odometry frame.
        The two differ if odometry starts far from its origin.
    """

    def __init__(
        self,
        types: MessageTypes,
        config: Config,
        T_odom_near: Callable[[], Float64] = lambda: np.eye(4),
    ):
        self._types, self._config, self._T_odom_near = types, config, T_odom_near
        self._marker_sets = {
            topic: MarkerSet(types) for topic, kind in CYCLE_TOPICS.items() if kind == MARKERS
        }

    def of(self, result: CycleResult, cuboids: Callable[[], Cuboids]) -> Iterator[TopicMessage]:
        """Yield the messages of a tilt cycle.

        Parameters
        ----------
        result
            The tilt cycle.
        cuboids
            Returns the integration map after that tilt cycle.
        """
        yield self.planes(result.found)
        yield from self.after_planes(result, cuboids)

    def planes(self, found: CyclePlanes) -> TopicMessage:
        """Return the markers of the planes of a tilt cycle."""
        context = MessageContext(self._types, found.stamp_ns, found.frame_id)
        build = self._markers(
            "planes", lambda: plane_markers(context, found.planes), found.stamp_ns
        )
        return TopicMessage("planes", MARKERS, build)

    def after_planes(
        self, result: CycleResult, cuboids: Callable[[], Cuboids]
    ) -> Iterator[TopicMessage]:
        """Yield all messages of a tilt cycle except the planes; arguments as `of`."""
        context = MessageContext(self._types, result.stamp_ns, result.frame_id)
        # A costmap looks up tf at the stamp and drops old points: use the newest stamp with tf.
        ended = MessageContext(self._types, result.end_ns, result.frame_id)
        markers: dict[str, Callable[[], list[Any]]] = {
            "objects": lambda: object_markers(context, result.objects),
            "cuboids": lambda: self._cuboids(context, cuboids()),
            "center_cores": lambda: _cores(context, cuboids(), self._config.center_core.min_length),
        }
        clouds: dict[str, Callable[[], Any]] = {
            "map_cloud": lambda: _map_cloud(context, cuboids(), self._T_odom_near()),
            "obstacles": lambda: _obstacles(ended, cuboids(), self._T_odom_near()),
            "surfaces": lambda: surface_cloud_message(self._types, result.surfaces),
            "view": lambda: view_message(self._types, result.view),
            "object_boxes": lambda: object_boxes_message(self._types, result.boxes),
        }
        for topic, build in markers.items():
            yield TopicMessage(topic, MARKERS, self._markers(topic, build, result.stamp_ns))
        for topic, message in clouds.items():
            yield TopicMessage(topic, CLOUD, message)

    def _markers(
        self, topic: str, build: Callable[[], list[Any]], stamp_ns: int
    ) -> Callable[[], Any]:
        def message() -> Any:
            markers = moved_markers(self._types, build(), self._T_odom_near())
            return self._marker_sets[topic].message(markers, stamp_ns)

        return message

    def _cuboids(self, context: MessageContext, cuboids: Cuboids) -> list[Any]:
        if not len(cuboids):
            return []
        value = _newest(cuboids) if self._config.markers.cuboid_color == "age" else cuboids.top
        low, high = float(value.min()), float(value.max())
        fraction = (value - low) / max(high - low, 1e-9)
        depth = self._config.map.cuboid_depth
        return cuboid_markers(
            context, _tops(cuboids), _depths(cuboids), cuboids.cell_size, depth, fraction
        )


def _cores(context: MessageContext, cuboids: Cuboids, min_length: float) -> list[Any]:
    ends = center_cores(cuboids, min_length).ends()
    return core_markers(context, ends[:, 0], ends[:, 1])


def _tops(cuboids: Cuboids) -> Float64:
    xy = (np.stack([cuboids.ix, cuboids.iy], axis=1) + 0.5) * cuboids.cell_size
    return np.column_stack([xy, cuboids.top * TICK])


def _depths(cuboids: Cuboids) -> Float64:
    return np.asarray((cuboids.top - cuboids.bottom) * TICK, np.float64)


def _newest(cuboids: Cuboids) -> Int32:
    return cuboids.cycles[cuboids.cycle_offsets[1:] - 1]


def _map_cloud(context: MessageContext, cuboids: Cuboids, T: Float64) -> Any:
    tops = transform(T, _tops(cuboids))
    return map_cloud_message(*context, tops, _depths(cuboids), cuboids.count, _newest(cuboids))


def _obstacles(context: MessageContext, cuboids: Cuboids, T: Float64) -> Any:
    return obstacle_cloud_message(*context, transform(T, _tops(cuboids)), _depths(cuboids))


class SolutionMessageBuilder:
    """Builds the messages of a solution of the SLAM node.

    Parameters
    ----------
    types
        Message classes.
    map_frame
        Frame of all messages.
    """

    def __init__(self, types: MessageTypes, map_frame: str):
        self._types, self._frame = types, map_frame
        self._walls, self._signs = MarkerSet(types), MarkerSet(types)
        self._surfaces = MarkerSet(types)

    def of(
        self, solution: SurfaceSolution, stamp_ns: int, map_name: str = ""
    ) -> Iterator[TopicMessage]:
        """Yield the messages of a solution, stamped with its newest record.

        `map_name` is the name under which the map was saved or loaded, empty if it has none.
        """
        context = MessageContext(self._types, stamp_ns, self._frame)
        builders: dict[str, Callable[[], Any]] = {
            "path": lambda: path_message(
                *context, solution.trajectory_ns.tolist(), solution.T_map_base
            ),
            "walls": lambda: self._walls.message(
                wall_markers(context, solution.graph.walls), stamp_ns
            ),
            "signs": lambda: self._signs.message(
                sign_markers(context, solution.graph.signs), stamp_ns
            ),
            "surfaces": lambda: self._surfaces.message(
                [
                    *surface_markers(context, solution.surfaces),
                    *label_markers(context, solution.objects),
                    *compartment_markers(context, solution.compartments),
                ],
                stamp_ns,
            ),
            "surface_cloud": lambda: _surface_cloud(context, solution),
            "surface_map": lambda: typed_map_message(*context, solution, map_name),
            "objects": lambda: objects_message(*context, solution.objects),
            "tables": lambda: tables_message(*context, solution.surfaces),
        }
        for topic, build in builders.items():
            yield TopicMessage(topic, SOLUTION_TOPICS[topic], build)


def _surface_cloud(context: MessageContext, solution: SurfaceSolution) -> Any:
    ids = solution.mapped.surface_id
    known, index = np.unique(ids, return_inverse=True)
    palette = np.array([identity_color(int(i)) for i in known]).reshape(-1, 3)
    colors = np.rint(255 * palette).astype(np.uint8)[index]
    return surface_map_message(*context, solution.mapped.points, ids, colors)
