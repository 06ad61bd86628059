"""Write result.mcap: the messages that the live nodes would have published.

The messages of a tilt cycle are built when the cycle is complete, from the integration map at that
time, and stored in a temporary file until the poses are known, so that memory stays bounded for a
bag of hours.

Log time, publish time and order follow the records that caused the messages. Poses, walls and
surfaces are those of the final solution. Surfaces are written from the time at which they were
first seen, so that the map grows while the bag plays. Events are those of the solutions after each
view, if the replay computes these. Markers of cuboids and center cores, and obstacles, are large
and are written once, for the last tilt cycle; ``map_cloud`` has the exact values of every tilt
cycle.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter, Qos
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.errors import OutputError, one_line
from tccm_ros.geometry import inverse
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.records import TransformSample
from tccm_ros.ros.collision_messages import (
    COLLISION_OBJECT,
    collision_messages,
)
from tccm_ros.ros.output_messages import grid_message, pose_covariance_message
from tccm_ros.ros.surface_messages import (
    LOCALISATION,
    SURFACE_EVENT,
    change_message,
    localisation_message,
)
from tccm_ros.ros.topic_messages import (
    CYCLE_TOPICS,
    SOLUTION_TOPICS,
    SURFACE_MESSAGE_TOPICS,
    CycleMessageBuilder,
    SolutionMessageBuilder,
    TopicMessage,
)
from tccm_ros.ros.writing import transform_message, transforms_message
from tccm_ros.scene.changes import Change
from tccm_ros.scene.planning_shapes import scene_shapes
from tccm_ros.scene.scene import frames_of_surfaces
from tccm_ros.slam.occupancy import OccupancyGrid
from tccm_ros.slam.se2 import rotate_covariance

TCCM = "/tccm/"
SLAM = "/surface_slam/"
POSE_TOPIC = "/pose"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TF_TOPIC = "/tf"
TF = "tf2_msgs/msg/TFMessage"
COLLISION_TOPIC = "/collision_object"
EVENTS_TOPIC = SLAM + "events"
LOCALISATION_TOPIC = SLAM + "localisation"
GRID_TOPIC = "/map"
GRID = "nav_msgs/msg/OccupancyGrid"
MAP_ODOM_TOPIC = SLAM + "map_to_odom"
MAP_ODOM = "geometry_msgs/msg/TransformStamped"

LAST_CYCLE_TOPICS = ("cuboids", "center_cores", "obstacles")
"""Topics of a tilt cycle that are written only for the last one."""

GROWING_TOPICS = ("surfaces",)
"""Topics of the solution that are written at each new surface. The others are written once, because
the file would otherwise grow with the square of the recording's length."""


TypedMessage = tuple[str, str, Any]
"""Topic, type and message."""


class _StoredMessage(NamedTuple):
    """A message in the temporary file."""

    msgtype: str
    offset: int
    size: int


class CycleMessageStore:
    """Serialised messages of tilt cycles in a temporary file.

    Parameters
    ----------
    config
        Groups `map` and `markers`.
    folder
        Folder of the temporary file, which is deleted with the process; None for the system's.
    """

    def __init__(self, config: Config, folder: Path | None = None):
        self.types = TypestoreMessages()
        self._builder = CycleMessageBuilder(self.types, config)
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115  (closed with this object)
        self._stored: dict[int, dict[str, _StoredMessage]] = {}
        self._newest: dict[str, TopicMessage] = {}

    def add(self, cycle: CycleResult, cuboids: Cuboids) -> None:
        """Store the messages of a tilt cycle.

        Parameters
        ----------
        cycle
            Result of the tilt cycle, newer than the previous ones.
        cuboids
            Integration map after it.

        Raises
        ------
        OutputError
            If the messages cannot be written.
        """
        messages = {m.topic: m for m in self._builder.of(cycle, lambda: cuboids)}
        self._newest = {topic: messages.pop(topic) for topic in LAST_CYCLE_TOPICS}
        self._stored[cycle.cycle] = {topic: self._store(m) for topic, m in messages.items()}

    def _store(self, message: TopicMessage) -> _StoredMessage:
        content = self.types.serialize(message.msgtype, message.build())
        try:
            return _StoredMessage(message.msgtype, self._file.tell(), self._file.write(content))
        except OSError as error:
            raise OutputError(f"result.mcap: cannot be written ({one_line(error)})") from None

    def of(self, cycle: int, *, is_last: bool) -> Iterator[TypedMessage]:
        """Yield the messages of a tilt cycle.

        Parameters
        ----------
        cycle
            Number of an added tilt cycle.
        is_last
            Whether it is the last one, which also has the `LAST_CYCLE_TOPICS`.
        """
        stored = self._stored[cycle]
        for topic in CYCLE_TOPICS:
            if topic in stored:
                msgtype, offset, size = stored[topic]
                self._file.seek(offset)
                yield topic, msgtype, self._file.read(size)
            elif is_last:
                message = self._newest[topic]
                yield topic, message.msgtype, message.build()


class _TimedMessages(NamedTuple):
    """Messages of a time, made when they are written; those of equal times are ordered by rank."""

    stamp_ns: int
    rank: int
    messages: Iterator[TypedMessage]


class ResultBag:
    """Writes the messages of tilt cycles and of the solution in order of time.

    Parameters
    ----------
    bag
        An open bag; its file is complete when it is closed.
    messages
        Messages of the tilt cycles.
    config
        Groups `frames` and `tf`.
    """

    def __init__(self, bag: BagWriter, messages: CycleMessageStore, config: Config):
        self._bag, self._messages, self._config = bag, messages, config
        self._map_frame = config.frames.map_name
        self._solution_builder = SolutionMessageBuilder(bag.types, self._map_frame)
        self._declare()

    def _declare(self) -> None:
        latched = Qos(latched=True, depth=1)
        for topic, kind in CYCLE_TOPICS.items():
            qos = Qos(depth=50) if topic in SURFACE_MESSAGE_TOPICS else latched
            self._bag.add_topic(TCCM + topic, kind, qos)
        for topic, kind in SOLUTION_TOPICS.items():
            self._bag.add_topic(SLAM + topic, kind, latched)
        for topic, kind in ((TF_TOPIC, TF), (MAP_ODOM_TOPIC, MAP_ODOM), (POSE_TOPIC, POSE)):
            self._bag.add_topic(topic, kind, Qos())
        self._bag.add_topic(LOCALISATION_TOPIC, LOCALISATION, latched)
        self._bag.add_topic(GRID_TOPIC, GRID, latched)
        self._bag.add_topic(EVENTS_TOPIC, SURFACE_EVENT, Qos(depth=100))
        self._bag.add_topic(COLLISION_TOPIC, COLLISION_OBJECT, Qos(latched=True, depth=500))

    def write(
        self,
        cycles: Sequence[CycleResult],
        solution: SurfaceSolution,
        events: Iterable[tuple[int, Change]] = (),
        grid: OccupancyGrid | None = None,
    ) -> None:
        """Write all messages in order of time.

        Parameters
        ----------
        cycles
            All tilt cycles, in order.
        solution
            The final solution.
        events
            Changes with the stamps of the views that revealed them, ns.
        grid
            Grid of the level scans, if any.
        """
        ends = {cycle.stamp_ns: cycle.end_ns for cycle in cycles}
        due = [*self._of_cycles(cycles, solution), *self._of_solution(solution, ends, grid)]
        for seen_ns, change in events:
            due.append(_TimedMessages(ends.get(seen_ns, seen_ns), 4, self._event(change)))
        for stamp_ns, _, messages in sorted(due, key=lambda item: item[:2]):
            for topic, msgtype, message in messages:
                self._bag.write(topic, msgtype, stamp_ns, message)

    # --- cycles ---

    def _of_cycles(
        self, cycles: Sequence[CycleResult], solution: SurfaceSolution
    ) -> Iterator[_TimedMessages]:
        for cycle in cycles:
            T_map_base = solution.graph.T_map_base_at(cycle.stamp_ns)[0]
            if cycle.scans:  # without scans, the base has no pose at the cycle
                frames = self._frames(cycle, T_map_base, solution)
                yield _TimedMessages(cycle.end_ns, 0, frames)
            yield _TimedMessages(cycle.end_ns, 1, self._cycle(cycle, cycle is cycles[-1]))

    def _frames(
        self, cycle: CycleResult, T_map_base: Float64, solution: SurfaceSolution
    ) -> Iterator[TypedMessage]:
        """Yield the poses of the odometry frame and the base at the stamp of the tilt cycle.

        With `tf.surfaces`, also the frames of the surfaces seen by then.
        """
        stamp_ns, types = cycle.stamp_ns, self._bag.types
        T_map_odom = T_map_base @ inverse(cycle.T_odom_base)
        odom = TransformSample(stamp_ns, self._map_frame, cycle.frame_id, T_map_odom, False)
        samples = [odom]
        if cycle.base_frame_id and cycle.base_frame_id != cycle.frame_id:
            base = cycle.base_frame_id, cycle.T_odom_base, False
            samples.append(TransformSample(stamp_ns, cycle.frame_id, *base))
        if self._config.tf.surfaces:
            seen = [s for s in solution.surfaces if s.first_seen_ns <= stamp_ns]
            prefix = self._config.frames.prefix
            samples += frames_of_surfaces(seen, stamp_ns, self._map_frame, prefix)
        yield TF_TOPIC, TF, transforms_message(types, samples)
        yield MAP_ODOM_TOPIC, MAP_ODOM, transform_message(types, odom)

    def _cycle(self, cycle: CycleResult, is_last: bool) -> Iterator[TypedMessage]:
        for topic, msgtype, message in self._messages.of(cycle.cycle, is_last=is_last):
            yield TCCM + topic, msgtype, message

    # --- the solution ---

    def _of_solution(
        self, solution: SurfaceSolution, ends: Mapping[int, int], grid: OccupancyGrid | None
    ) -> Iterator[_TimedMessages]:
        """Yield the messages of a solution; `ends` are those of tilt cycles by stamp, ns."""
        stamps = solution.trajectory_ns
        keyframes = solution.graph.keyframes
        key_stamps = np.array([k.stamp_ns for k in keyframes], np.int64)
        T_map_base = solution.T_map_base
        nearest = np.maximum(np.searchsorted(key_stamps, stamps, side="right") - 1, 0)
        known = zip(keyframes, solution.graph.cov_keyframes)
        covs = [rotate_covariance(cov, float(k.pose[2])) for k, cov in known]
        covs = covs or [np.zeros((3, 3))]
        for index, stamp_ns in enumerate(stamps.tolist()):
            pose = self._pose(stamp_ns, T_map_base[index], covs[nearest[index]])
            yield _TimedMessages(stamp_ns, 2, pose)
        for seen_ns in sorted({surface.first_seen_ns for surface in solution.surfaces}):
            growing = self._growing(solution, seen_ns)
            yield _TimedMessages(ends.get(seen_ns, seen_ns), 3, growing)
        newest = [*stamps[-1:].tolist(), *ends.values()]
        if newest:
            yield _TimedMessages(max(newest), 5, self._final(solution, grid, max(newest)))

    def _event(self, change: Change) -> Iterator[TypedMessage]:
        yield EVENTS_TOPIC, SURFACE_EVENT, change_message(self._bag.types, self._map_frame, change)

    def _pose(self, stamp_ns: int, T_map_base: Float64, cov: Float64) -> Iterator[TypedMessage]:
        header = self._bag.types, stamp_ns, self._map_frame
        yield POSE_TOPIC, POSE, pose_covariance_message(*header, T_map_base, cov)

    def _growing(self, solution: SurfaceSolution, seen_ns: int) -> Iterator[TypedMessage]:
        """Yield the `GROWING_TOPICS` with the surfaces first seen by a time."""
        seen = _seen_by(solution, seen_ns)
        for topic, msgtype, build in self._solution_builder.of(seen, seen_ns):
            if topic in GROWING_TOPICS:
                yield SLAM + topic, msgtype, build()

    def _final(
        self, solution: SurfaceSolution, grid: OccupancyGrid | None, stamp_ns: int
    ) -> Iterator[TypedMessage]:
        """Yield the messages of the complete solution."""
        header = self._bag.types, stamp_ns, self._map_frame
        for topic, msgtype, build in self._solution_builder.of(solution, stamp_ns):
            yield SLAM + topic, msgtype, build()
        yield LOCALISATION_TOPIC, LOCALISATION, localisation_message(*header, solution)
        if grid is not None:
            yield GRID_TOPIC, GRID, grid_message(*header, grid)
        shapes = scene_shapes(
            solution.surfaces, solution.objects, solution.compartments, solution.unseen
        )
        for message in collision_messages(*header, shapes):
            yield COLLISION_TOPIC, COLLISION_OBJECT, message


def _seen_by(solution: SurfaceSolution, seen_ns: int) -> SurfaceSolution:
    """Return the solution with only the surfaces first seen by a time."""
    mapped = solution.mapped
    kept = [surface.first_seen_ns <= seen_ns for surface in mapped.surfaces]
    surfaces = tuple(s for s, keep in zip(mapped.surfaces, kept, strict=True) if keep)
    shown = np.isin(mapped.surface_id, [surface.id for surface in surfaces])
    subset = replace(
        mapped,
        surfaces=surfaces,
        points=mapped.points[shown],
        surface_id=mapped.surface_id[shown],
        members=tuple(m for m, keep in zip(mapped.members, kept, strict=True) if keep),
    )
    return replace(solution, mapped=subset)


def write_result_bag(
    path: Path | str,
    cycles: Sequence[CycleResult],
    messages: CycleMessageStore,
    solution: SurfaceSolution,
    config: Config,
    events: Iterable[tuple[int, Change]],
    grid: OccupancyGrid | None,
) -> None:
    """Write result.mcap.

    Parameters
    ----------
    path
        Output file; an older one is replaced.
    cycles, solution
        Results of tilt cycles, and the final solution.
    messages
        Messages of the same tilt cycles.
    config
        Groups ``frames`` and ``tf``.
    events
        Changes with the stamps of the views that revealed them, ns.
    grid
        Grid of the level scans, if any.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with BagWriter(path, overwrite=True, typestore=messages.types) as bag:
        ResultBag(bag, messages, config).write(cycles, solution, events, grid)
