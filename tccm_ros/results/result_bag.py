"""result.mcap: what the live nodes would have published, for Foxglove and RViz.

The messages of a tilt cycle are made when the cycle is, from the map as it is then, and kept in a
temporary file until the poses are known: memory stays bounded in a bag of hours.

Log time, publish time and order follow the records that caused the messages. What belongs to a
tilt cycle is that cycle's; poses, walls and surfaces are those of the final solution, each from
the time at which it was first seen, so that the map grows while it plays. Markers of cuboids
and center cores and the obstacles are large and written once, for the last cycle; ``map_cloud``
has every cycle's exact values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
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
from tccm_ros.geometry import inverse, spatial
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.records import TransformSample
from tccm_ros.ros import transform_message, transforms_message
from tccm_ros.ros.output_messages import pose_covariance_message
from tccm_ros.ros.topic_messages import (
    CYCLE_TOPICS,
    SOLUTION_TOPICS,
    SURFACE_MESSAGE_TOPICS,
    CycleMessageBuilder,
    SolutionMessageBuilder,
    TopicMessage,
)
from tccm_ros.surfaces.surface_slam import SurfaceSolution

__all__ = ["CycleMessageStore", "write_result_bag"]

TCCM = "/tccm/"
SLAM = "/surface_slam/"
POSE_TOPIC = "/pose"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TF_TOPIC = "/tf"
TF = "tf2_msgs/msg/TFMessage"
MAP_ODOM_TOPIC = SLAM + "map_to_odom"
MAP_ODOM = "geometry_msgs/msg/TransformStamped"

LAST_ONLY = ("cuboids", "center_cores", "obstacles")
"""Topics of a cycle that are written for the last cycle alone."""

GROWING = ("surfaces",)
"""Topics of the solution that are written whenever a surface is new, the others once: the whole
cloud each time would make the file grow with the square of the recording."""


class _Kept(NamedTuple):
    """A message in the temporary file."""

    msgtype: str
    offset: int
    size: int


class CycleMessageStore:
    """The messages of tilt cycles, serialised.

    Parameters
    ----------
    config
        Groups `map` and `markers`.
    folder
        Where the temporary file is; None for the system's place. It is gone with the process.
    """

    def __init__(self, config: Config, folder: Path | None = None):
        self.types = TypestoreMessages()
        self._publications = CycleMessageBuilder(self.types, config)
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115  (it lives as long as this does)
        self._kept: dict[int, dict[str, _Kept]] = {}
        self._newest: dict[str, TopicMessage] = {}

    def add(self, cycle: CycleResult, cuboids: Cuboids) -> None:
        """Make the messages of a cycle.

        Parameters
        ----------
        cycle
            Newer than those before.
        cuboids
            The integration map after it.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        due = {p.topic: p for p in self._publications.of(cycle, lambda: cuboids)}
        self._newest = {topic: due.pop(topic) for topic in LAST_ONLY}
        self._kept[cycle.cycle] = {topic: self._keep(p) for topic, p in due.items()}

    def _keep(self, publication: TopicMessage) -> _Kept:
        message = self.types.serialize(publication.msgtype, publication.build())
        try:
            return _Kept(publication.msgtype, self._file.tell(), self._file.write(message))
        except OSError as error:
            raise OutputError(f"result.mcap: cannot be written ({one_line(error)})") from None

    def of(self, cycle: int, *, is_last: bool) -> Iterator[tuple[str, str, Any]]:
        """Yield topic, type and message of what is due for a cycle (its number)."""
        kept = self._kept[cycle]
        for topic in CYCLE_TOPICS:
            if topic in kept:
                msgtype, offset, size = kept[topic]
                self._file.seek(offset)
                yield topic, msgtype, self._file.read(size)
            elif is_last:
                publication = self._newest[topic]
                yield topic, publication.msgtype, publication.build()


class _Due(NamedTuple):
    """Something to write at a time; what is due at the same time keeps its rank."""

    stamp_ns: int
    rank: int
    write: Callable[[], None]


class ResultBag:
    """Writes a result bag.

    Parameters
    ----------
    bag
        An open bag; its file is complete when that is closed.
    messages
        Those of the cycles.
    config
        Group `frames`.
    """

    def __init__(self, bag: BagWriter, messages: CycleMessageStore, config: Config):
        self._bag, self._messages = bag, messages
        self._map_frame = config.frames.map_name
        self._solutions = SolutionMessageBuilder(bag.types, self._map_frame)
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

    def write(self, cycles: Sequence[CycleResult], solution: SurfaceSolution) -> None:
        """Write everything, in the order of time.

        Parameters
        ----------
        cycles
            All cycles in order.
        solution
            The final one.
        """
        due = [*self._of_cycles(cycles, solution), *self._of_solution(cycles, solution)]
        for item in sorted(due, key=lambda item: item[:2]):
            item.write()

    # --- cycles ---

    def _of_cycles(
        self, cycles: Sequence[CycleResult], solution: SurfaceSolution
    ) -> Iterator[_Due]:
        for cycle in cycles:
            T_map_base = spatial(solution.slam.pose_at(cycle.stamp_ns))[0]
            is_last = cycle is cycles[-1]
            if cycle.scans:  # a sweep without scans knows no pose of the base
                yield _Due(cycle.end_ns, 0, partial(self._write_frames, cycle, T_map_base))
            yield _Due(cycle.end_ns, 1, partial(self._write_cycle, cycle, is_last))

    def _write_frames(self, cycle: CycleResult, T_map_base: Float64) -> None:
        """Write where the odometry frame and the base were at the cycle's stamp."""
        stamp_ns, types = cycle.stamp_ns, self._bag.types
        T_map_odom = T_map_base @ inverse(cycle.T_odom_base)
        odom = TransformSample(stamp_ns, self._map_frame, cycle.frame_id, T_map_odom, False)
        samples = [odom]
        if cycle.base_frame_id and cycle.base_frame_id != cycle.frame_id:
            base = cycle.base_frame_id, cycle.T_odom_base, False
            samples.append(TransformSample(stamp_ns, cycle.frame_id, *base))
        self._bag.write(TF_TOPIC, TF, cycle.end_ns, transforms_message(types, samples))
        self._bag.write(MAP_ODOM_TOPIC, MAP_ODOM, cycle.end_ns, transform_message(types, odom))

    def _write_cycle(self, cycle: CycleResult, is_last: bool) -> None:
        for topic, msgtype, message in self._messages.of(cycle.cycle, is_last=is_last):
            self._bag.write(TCCM + topic, msgtype, cycle.end_ns, message)

    def _publish(self, stamp_ns: int, publications: Iterable[TopicMessage]) -> None:
        for publication in publications:
            topic = SLAM + publication.topic
            self._bag.write(topic, publication.msgtype, stamp_ns, publication.build())

    # --- the solution ---

    def _of_solution(
        self, cycles: Sequence[CycleResult], solution: SurfaceSolution
    ) -> Iterator[_Due]:
        stamps = solution.trajectory_ns
        keyframes = np.array([k.stamp_ns for k in solution.slam.keyframes], np.int64)
        nearest = np.maximum(np.searchsorted(keyframes, stamps, side="right") - 1, 0)
        covs = solution.slam.cov_keyframes if len(keyframes) else np.zeros((1, 3, 3))
        for index, stamp_ns in enumerate(stamps.tolist()):
            pose = solution.trajectory[index]
            due = partial(self._write_pose, stamp_ns, pose, covs[nearest[index]])
            yield _Due(stamp_ns, 2, due)
        ends = {cycle.stamp_ns: cycle.end_ns for cycle in cycles}
        for seen_ns in sorted({surface.first_seen_ns for surface in solution.surfaces}):
            at_ns = ends.get(seen_ns, seen_ns)
            yield _Due(at_ns, 3, partial(self._write_surfaces, solution, seen_ns, at_ns))
        newest = [*stamps[-1:].tolist(), *(cycle.end_ns for cycle in cycles[-1:])]
        if newest:
            yield _Due(max(newest), 4, partial(self._write_rest, solution, max(newest)))

    def _write_pose(self, stamp_ns: int, pose: Float64, cov: Float64) -> None:
        message = pose_covariance_message(
            self._bag.types, stamp_ns, self._map_frame, spatial(pose), cov
        )
        self._bag.write(POSE_TOPIC, POSE, stamp_ns, message)

    def _write_surfaces(self, solution: SurfaceSolution, seen_ns: int, stamp_ns: int) -> None:
        """Write the surfaces that had been seen at a time."""
        known = _known(solution, seen_ns)
        due = self._solutions.of(known, seen_ns)
        self._publish(stamp_ns, (p for p in due if p.topic in GROWING))

    def _write_rest(self, solution: SurfaceSolution, stamp_ns: int) -> None:
        due = self._solutions.of(solution, stamp_ns)
        self._publish(stamp_ns, due)


def _known(solution: SurfaceSolution, seen_ns: int) -> SurfaceSolution:
    """Return the solution with the surfaces alone that were first seen by then."""
    mapped = solution.mapped
    kept = [surface.first_seen_ns <= seen_ns for surface in mapped.surfaces]
    surfaces = tuple(s for s, keep in zip(mapped.surfaces, kept, strict=True) if keep)
    shown = np.isin(mapped.surface_id, [surface.id for surface in surfaces])
    part = replace(
        mapped,
        surfaces=surfaces,
        points=mapped.points[shown],
        surface_id=mapped.surface_id[shown],
        members=tuple(m for m, keep in zip(mapped.members, kept, strict=True) if keep),
    )
    return replace(solution, mapped=part)


def write_result_bag(
    path: Path | str,
    cycles: Sequence[CycleResult],
    messages: CycleMessageStore,
    solution: SurfaceSolution,
    config: Config,
) -> None:
    """Write result.mcap.

    Parameters
    ----------
    path
        Where; what is there is replaced.
    cycles, solution
        What the processors gave.
    messages
        Those of the same cycles.
    config
        As they were run.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    with BagWriter(path, overwrite=True, typestore=messages.types) as bag:
        ResultBag(bag, messages, config).write(cycles, solution)
