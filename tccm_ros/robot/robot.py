"""The intake: takes records, checks each once, and returns ordered events.

A record is first checked by its stamp (`StampGuard`). Robot data go to the frames, the joints and
the base's motion, which all sensors have in common. A sensor's record waits until all joints of its
chain and the base's motion have samples around it (`Posing`). The wait is measured in message time,
the newest stamp on any input; after a timeout the record is dropped and counted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.errors import TopicError, suggest
from tccm_ros.geometry import inverse
from tccm_ros.records import (
    START_OF_TIME,
    Event,
    Imu,
    JointSample,
    MapOdom,
    MapReset,
    Odometry,
    PoseCovariance,
    RobotDescription,
    StreamComplete,
    TiltAngle,
    TransformSample,
)
from tccm_ros.robot.base_motion import BaseMotion, MotionSource
from tccm_ros.robot.chain_finder import MountKind
from tccm_ros.robot.frames import FrameTree
from tccm_ros.robot.gyro_heading import GyroHeading
from tccm_ros.robot.imu_mount import ImuMount
from tccm_ros.robot.joint_tracks import LATE, JointTracks
from tccm_ros.robot.posing import Posing
from tccm_ros.robot.roll_pitch import BaseRollPitch
from tccm_ros.robot.sensor import Sensor
from tccm_ros.robot.stamp_guard import Admission, StampGuard
from tccm_ros.robot.streams import Stream, unchanged

COMPLETE_STEP_NS = 20_000_000
"""Step of message time between two `StreamComplete` events (chosen): small compared with the waits
of processors, and saves a check per record."""


@dataclass(frozen=True, slots=True)
class _Input:
    """Handling of the records of one role.

    Attributes
    ----------
    record
        Record type.
    take
        Callback for an admitted record.
    pose
        Attribute with the record's pose, which must be finite.
    source
        Attribute with the publisher of a record, for roles with several publishers: stamps are
        compared per publisher.
    keeps_time
        Whether the stamps advance message time.
    is_fixed
        Whether the records are valid for all time, whatever their stamp.
    correct
        Function that corrects configured errors of a record's driver.
    """

    record: type
    take: Callable[[Any], None]
    pose: str = ""
    source: str = ""
    keeps_time: bool = True
    is_fixed: bool = False
    correct: Callable[[Any, Config], Any] = unchanged


class Robot:
    """Poses the records of all sensors.

    Parameters
    ----------
    config
        Uses groups `frames`, `rig` and `scan`, and `sync_timeout`, `reorder_window` and
        `clock_jump`.
    streams
        Streams of the sensors: `sensors.registry.default_streams`, and any others.
    expects_odometry
        Whether there is an odometry topic: records without odometry are then dropped. Otherwise, if
        no odometry arrives within `sync_timeout` of the first record, the base moves by tf, or is
        constant without tf.

    Attributes
    ----------
    frames, joints, motion, gyro, roll_pitch
        State of the robot.
    sensors
        Sensors by role, each with its mount, queue of waiting records, and counts.
    refused
        Number of unused samples of joints, tf and odometry, by reason.
    """

    def __init__(
        self, config: Config, streams: Iterable[Stream], *, expects_odometry: bool = False
    ):
        self._config = config
        self.frames = FrameTree()
        self.joints = JointTracks(round(config.rig.joint_time_offset * 1e9))
        self.motion = BaseMotion(config, self.frames)
        self.expects_odometry = expects_odometry
        self.refused: Counter[str] = Counter()
        self.sensors = {s.role: Sensor(s, config, self.frames, self.joints) for s in streams}
        self._mapped = {
            role: sensor
            for role, sensor in self.sensors.items()
            if sensor.stream.mount is not MountKind.LEVEL and not sensor.stream.is_occasional
        }
        self._tilting = {
            role: sensor
            for role, sensor in self.sensors.items()
            if sensor.stream.mount is MountKind.TILTING
        }
        imu_mount = ImuMount(self.frames)
        self.gyro = GyroHeading(config, self.motion, imu_mount)
        self.roll_pitch = BaseRollPitch(
            config, self.motion, imu_mount, partial(self._refuse, "imu")
        )
        self._posing = Posing(config, self.frames, self.motion, self.gyro, self.roll_pitch)
        self._clock_jump_ns = round(config.clock_jump * 1e9)
        self._guard: StampGuard[tuple[str, Any]] = StampGuard(self._clock_jump_ns)
        self._inputs = self._inputs_by_role()
        self._events: list[Event] = []
        self._complete_after_ns = START_OF_TIME
        self._time_has_passed = False

    @property
    def dropped(self) -> Counter[str]:
        """Number of records of all sensors that were not posed, by reason."""
        return sum((sensor.dropped for sensor in self.sensors.values()), Counter())

    @property
    def remarks(self) -> list[str]:
        """Remarks on unusual records that were used, one line each."""
        return [
            f"{role}: {remark} ({count} of {sensor.received})"
            for role, sensor in self.sensors.items()
            for remark, count in sorted(sensor.remarks.items())
        ]

    @property
    def message_time_ns(self) -> int | None:
        """The newest stamp on any input that keeps time; None before the first record."""
        return self._guard.now(None)

    def add(self, role: str, record: Any) -> list[Event]:
        """Add a record; return the resulting events.

        Returns
        -------
        list[Event]
            A `MapReset` first, then base motion, roll and pitch, tilt angles, posed records, and
            `StreamComplete`; each kind in stamp order within its stream.

        Raises
        ------
        TopicError
            For an unknown role, and for a record of another type than its stream has.
        UrdfError
            For an unreadable robot description; the previous one remains.
        """
        taken = self._inputs.get(role)
        if taken is None or not isinstance(record, taken.record):
            raise TopicError(
                f"no stream takes a {type(record).__name__} on '{role}'"
                + suggest(role, self._inputs)
            )
        record = taken.correct(record, self._config)
        if taken.pose and not _is_finite(getattr(record, taken.pose)):
            self._refuse_record(role, "malformed")
        elif taken.is_fixed:
            taken.take(record)
        else:
            if isinstance(record, TransformSample):
                self.frames.note_transform(record)
            self._admit(role, taken, record)
        return self._release()

    def flush(self) -> list[Event]:
        """Pose the waiting records at the end of the input, and drop those that cannot be posed."""
        self._use(self._guard.flush())
        return self._release(ended=True)

    def begin_anew(self) -> None:
        """Clear all time-stamped data after the clock went back; static data remain."""
        self._guard = StampGuard(self._clock_jump_ns)
        self._forget_samples()

    def _forget_samples(self) -> None:
        self.joints.clear()
        self.frames.clear_samples()
        self.motion.clear_samples()
        self.gyro.clear_samples()
        self.roll_pitch.clear_samples()
        self._posing.clear_samples()
        for sensor in self.sensors.values():
            sensor.clear_samples()
        self._complete_after_ns = START_OF_TIME

    # -- inputs --------------------------------------------------------------------------------

    def _inputs_by_role(self) -> dict[str, _Input]:
        tf = _Input(
            TransformSample, self._add_transform, "T_parent_child", "child", keeps_time=False
        )
        inputs = {
            "robot_description": _Input(RobotDescription, self._add_description, is_fixed=True),
            "tf_static": replace(tf, is_fixed=True),
            "tf": tf,
            "joint_states": _Input(JointSample, self._add_joints, source="names"),
            "odom": _Input(Odometry, self._add_odometry, "T_odom_base"),
            "imu": _Input(Imu, self._add_imu, keeps_time=False),
            "external_pose": _Input(PoseCovariance, self._add_pose_covariance, keeps_time=False),
        }
        for role, sensor in self.sensors.items():
            inputs[role] = _Input(sensor.stream.record, sensor.add, correct=sensor.stream.correct)
        for sensor in self.sensors.values():
            companion = sensor.stream.companion
            if companion is not None:
                # Drivers publish a calibration once, or with stamp 0.
                add = partial(self._add_companion, companion.role)
                inputs[companion.role] = _Input(companion.record, add, is_fixed=True)
        return inputs

    def _admit(self, role: str, taken: _Input, record: Any) -> None:
        """Use a record with a plausible stamp; hold or refuse others."""
        key = (role, getattr(record, taken.source)) if taken.source else role
        self._time_has_passed |= record.stamp_ns >= self._complete_after_ns
        if self._guard.passes(key, record.stamp_ns):
            taken.take(record)
        else:
            held = role, record
            self._use(self._guard.admit(key, record.stamp_ns, held, keeps_time=taken.keeps_time))

    def _use(self, admission: Admission[tuple[str, Any]]) -> None:
        if admission.jumped_ns:
            back_s = admission.jumped_ns * 1e-9
            self._events.append(MapReset(f"the stamps of all inputs went back by {back_s:.1f} s"))
            self._forget_samples()
        for (role, _), reason in admission.refused:
            self._refuse_record(role, reason)
        for role, record in admission.admitted:
            self._inputs[role].take(record)

    def _add_companion(self, role: str, record: Any) -> None:
        for sensor in self.sensors.values():
            if sensor.stream.companion is not None and sensor.stream.companion.role == role:
                sensor.add_companion(record)

    def _add_description(self, record: RobotDescription) -> None:
        before = self.frames.model
        self.frames.describe(record.urdf)
        if self.frames.model is not None and self.frames.model is not before:
            joints = self.frames.model.joints.values()
            self.joints.set_limits({j.name: j.limits for j in joints if j.limits is not None})

    def _add_transform(self, sample: TransformSample) -> None:
        if not self.frames.add_transform(sample):
            self._refuse("tf", LATE)
        elif self._config.localisation.is_external:
            edge = sample.parent, sample.child
            if edge == (self._config.frames.map_name, self.motion.odom_frame):
                # Far odometry was moved near its origin; map -> odom must follow.
                T_odom_near = inverse(self.motion.odometry.T_near_odom)
                self._events.append(MapOdom(sample.stamp_ns, sample.T_parent_child @ T_odom_near))

    def _add_joints(self, sample: JointSample) -> None:
        for reason, count in self.joints.add(sample).items():
            self._refuse("joint_states", reason, count)

    def _add_imu(self, record: Imu) -> None:
        self.roll_pitch.add(record)
        if not self.gyro.add(record):
            self._refuse("imu", LATE)

    def _add_pose_covariance(self, record: PoseCovariance) -> None:
        if not self._config.localisation.is_external:
            return
        if record.frame_id == self._config.frames.map_name:
            self._events.append(record)
        else:
            self._refuse("external_pose", "not in the map frame")

    def _add_odometry(self, record: Odometry) -> None:
        if self.motion.source in (MotionSource.TF, MotionSource.STILL):
            self._events.append(MapReset("odometry came after all"))
            self.frames.find_anew()
        self.frames.follow_odometry(record.child_frame_id)
        odometry = self.motion.odometry
        refused, jumps = odometry.refused, odometry.jumps
        for used in odometry.add(record):
            if not self.motion.add(used):
                self._refuse("odom", LATE)
            self._events.append(used)
        self._refuse("odom", "outliers", odometry.refused - refused)
        self._refuse(
            "odom", "began elsewhere (the base is taken not to have moved)", odometry.jumps - jumps
        )

    def _refuse(self, role: str, reason: str, count: int = 1) -> None:
        if count:
            self.refused[f"{role}: {reason}"] += count

    def _refuse_record(self, role: str, reason: str) -> None:
        if role in self.sensors:
            self.sensors[role].refuse(reason)
        else:
            self._refuse(role, reason)

    # -- outputs -------------------------------------------------------------------------------

    def _release(self, *, ended: bool = False) -> list[Event]:
        """Return the pending events, and the records that can be posed now."""
        events, self._events = self._events, []
        events += self.roll_pitch.take()
        posed: list[Event] = []
        for sensor in self.sensors.values():
            if sensor.waiting:
                posed += self._pose_waiting(sensor, ended)
        for role, sensor in self._tilting.items():
            events += [TiltAngle(role, *sample) for sample in sensor.mount.tilt_samples()]
        events += posed
        if self._time_has_passed:
            self._time_has_passed = False
            events += self._complete_streams()
        return events

    def _pose_waiting(self, sensor: Sensor, ended: bool) -> list[Event]:
        """Return the events of a sensor's records that need not wait any longer."""
        posed: list[Event] = []
        while sensor.waiting:
            outcome = self._posing.pose_next(
                sensor,
                self._guard.now(sensor.stream.role),
                ended=ended,
                expects_odometry=self.expects_odometry,
            )
            if outcome is None:
                break
            if isinstance(outcome, str):
                sensor.drop(outcome)
            else:
                sensor.pop()
                posed.append(outcome)
        sensor.posed += len(posed)
        return posed

    def _complete_streams(self) -> list[Event]:
        """Return the times until which the mapped streams are complete, once they have begun."""
        complete: list[Event] = []
        for role, sensor in self._mapped.items():
            now_ns = self._guard.now(role) if sensor.received else None
            if now_ns is not None:
                until_ns = now_ns - self._posing.wait_ns - sensor.longest_ns
                complete.append(StreamComplete(role, until_ns))
                self._complete_after_ns = now_ns + COMPLETE_STEP_NS
        return complete


def _is_finite(T: Float64) -> bool:
    """Return whether a pose is finite, and its distances can be computed."""
    numbers = T.ravel()
    with np.errstate(over="ignore"):
        return math.isfinite(numbers.dot(numbers))
