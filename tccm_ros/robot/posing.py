"""Poses of base and sensor for a record, or the samples that are still missing for them."""

from __future__ import annotations

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.geometry import pose_from_roll_pitch
from tccm_ros.records import Posed
from tccm_ros.robot.base_motion import BaseMotion, MotionSource
from tccm_ros.robot.chain import JointReading, TransformChain
from tccm_ros.robot.chain_finder import MountKind
from tccm_ros.robot.frames import FrameTree
from tccm_ros.robot.gyro_heading import GyroHeading
from tccm_ros.robot.mount import Mount
from tccm_ros.robot.roll_pitch import BaseRollPitch
from tccm_ros.robot.sensor import TOO_LONG, Sensor
from tccm_ros.robot.tracks import PoseTrack, Track


class Posing:
    """Computes poses of records once odometry and all joints of the chain have samples around them.

    Parameters
    ----------
    config
        Uses `sync_timeout`: two samples with a gap of more than half of it do not bracket a stamp.
    frames, motion
        Frames of the robot, and motion of its base.
    gyro, roll_pitch
        Gyroscope heading, and roll and pitch by the IMU: once available, level scans wait for the
        first and all records for the second, with the same timeout as for joints.

    Attributes
    ----------
    wait_ns
        Timeout of a record after its own end, in message time.
    """

    def __init__(
        self,
        config: Config,
        frames: FrameTree,
        motion: BaseMotion,
        gyro: GyroHeading,
        roll_pitch: BaseRollPitch,
    ):
        self._frames, self._motion = frames, motion
        self._gyro, self._roll_pitch = gyro, roll_pitch
        self._timeout_ns = round(config.sync_timeout * 1e9)
        self._max_gap_ns = self._timeout_ns // 2
        self.wait_ns = self._timeout_ns + max(0, round(-config.rig.joint_time_offset * 1e9))
        self._scan = config.scan
        self._map_frame, self._base = config.frames.map_name, config.frames.base
        self._silence: dict[Track, tuple[int, int]] = {}

    def clear_samples(self) -> None:
        """Clear the state of silent tracks, after a jump of the clock."""
        self._silence.clear()

    def pose_next(
        self, sensor: Sensor, now_ns: int | None, *, ended: bool, expects_odometry: bool
    ) -> Posed | str | None:
        """Return the next waiting record with its poses, or why it is dropped, or None.

        Parameters
        ----------
        sensor
            Its oldest waiting record is checked; None is returned while that must wait.
        now_ns
            Message time; None before the first record.
        ended
            Whether the input has ended.
        expects_odometry
            Whether records without odometry are dropped.
        """
        if not sensor.check_times():
            return TOO_LONG
        record, mount, motion = sensor.waiting[0], sensor.mount, self._motion
        start_ns, end_ns = sensor.stream.time_span(record)
        late = ended or now_ns is None or now_ns > end_ns + self.wait_ns
        if not late and (sensor.is_next_overtaken or sensor.awaits_nothing_new):
            return None
        sensor.awaited = None
        missing = sensor.join(is_last=late)
        if missing is not None:
            return missing or None
        if motion.source is None and (not late or expects_odometry):
            return "no odometry" if late else None
        try:
            chain = mount.find(self._frame_of(sensor), final=late)
            if chain is None:
                return None
            if motion.source is None:
                motion.decide(mount.base or "")
            needs = self._needs(mount, chain)
        except FrameError:
            return "no way from base to sensor"
        span = start_ns, end_ns
        lacking = self._lacking(needs, span, now_ns or 0, late=late, ended=ended)
        if lacking is not None and lacking[2]:
            reason, track, _ = lacking
            mount.explain_missing(reason, track, chain, start_ns)
            return reason
        awaited = lacking[1] if lacking is not None else None
        if lacking is None and not late:
            awaited = self._track_behind(sensor, end_ns, now_ns or 0)
        if awaited is not None:
            sensor.awaited = awaited, awaited.heard
            return None
        posed = self._pose(sensor, chain, start_ns, end_ns)
        mount.note_posed()
        return sensor.stream.fault_of_pose(posed) or posed

    def _lacking(
        self,
        needs: list[tuple[str, Track]],
        span: tuple[int, int],
        now_ns: int,
        *,
        late: bool,
        ended: bool,
    ) -> tuple[str, Track, bool] | None:
        """Return the first need without samples around a span, ns, and whether none will come.

        A tf transform that never moved needs none.
        """
        for reason, track in needs:
            if track.brackets(*span, self._max_gap_ns):
                continue
            hopeless = self._has_no_more(track, span[1], now_ns)
            is_given_up = ended or (late and hopeless)
            if not (is_given_up and self._never_moved(track, needs, span)):
                return reason, track, is_given_up
        return None

    def _track_behind(self, sensor: Sensor, end_ns: int, now_ns: int) -> Track | None:
        """Return a track of the IMU that a record still waits for; None without one."""
        is_level = sensor.stream.mount is MountKind.LEVEL
        if is_level and self._awaits_gyro(sensor.waiting[0].stamp_ns, now_ns):
            return self._gyro.track
        needed_ns, tracks = self._roll_pitch.awaited(end_ns)
        for track in tracks:
            if not self._has_no_more(track, needed_ns, now_ns):
                return track
        return None

    def _awaits_gyro(self, stamp_ns: int, now_ns: int) -> bool:
        """Return whether the gyroscope's heading at a stamp may still arrive."""
        track = self._gyro.track
        if track.latest_ns is None or self._gyro.brackets(stamp_ns):
            return False
        if stamp_ns - track.latest_ns > self._timeout_ns:  # it has another clock, or is silent
            return False
        return not self._has_no_more(track, stamp_ns, now_ns)

    def _frame_of(self, sensor: Sensor) -> str:
        """Return the frame to which a record needs a chain: for one in map or odom, the base."""
        frame: str = sensor.waiting[0].frame_id
        is_outside = frame in (self._map_frame, self._motion.odom_frame)
        if sensor.stream.is_occasional and is_outside:
            return self._base or self._frames.odometry_child or frame
        return frame

    def _needs(self, mount: Mount, chain: TransformChain) -> list[tuple[str, Track]]:
        """Return the tracks that must bracket a record, each with the reason of a drop."""
        needs: list[tuple[str, Track]] = [
            ("no odometry", track) for track in self._motion.tracks(mount.base or "")
        ]
        between = mount.odometry_chain
        for part, _ in (*chain.parts, *(between.parts if between is not None else ())):
            by_joint = isinstance(part, JointReading)
            needs.append(("no joint samples" if by_joint else "no transform", part.track))
        return needs

    def _never_moved(
        self, track: Track, needs: list[tuple[str, Track]], span: tuple[int, int]
    ) -> bool:
        """Return whether a tf transform is valid beyond its samples, as it has never moved.

        A constant base motion also needs a live sample of another transform of the motion.
        """
        if not isinstance(track, PoseTrack) or track.T_constant is None:
            return False
        others = [t for reason, t in needs if reason == "no odometry" and t is not track]
        is_motion = len(others) < sum(reason == "no odometry" for reason, _ in needs)
        return not is_motion or any(t.brackets(*span, self._max_gap_ns) for t in others)

    def _has_no_more(self, track: Track, end_ns: int, now_ns: int) -> bool:
        """Return whether no further sample can arrive that would bracket a record.

        Either the track has passed the record's end, or it has had no sample while message time
        advanced by `sync_timeout`. A stream that is late but alive is waited for.
        """
        if len(track) and track.stamps_ns[-1] >= end_ns:
            return True
        heard, since_ns = self._silence.get(track, (-1, 0))
        if heard != track.heard:
            self._silence[track] = (track.heard, now_ns)
            return False
        return now_ns - since_ns > self._timeout_ns

    def _pose(self, sensor: Sensor, chain: TransformChain, start_ns: int, end_ns: int) -> Posed:
        record, stream, mount = sensor.waiting[0], sensor.stream, sensor.mount
        base = mount.base or ""
        within = [track.stamps_within(start_ns, end_ns) for track in self._motion.tracks(base)]
        pose_stamps_ns = mount.pose_stamps(chain, start_ns, end_ns, *within)
        is_filtered = stream.sees_robot and self._scan.self_filter
        return stream.event(
            record,
            pose_stamps_ns,
            self._base_poses(mount, pose_stamps_ns),
            chain.at(pose_stamps_ns),
            stream.role,
            self._motion.odom_frame,
            base,
            mount.self_shapes(record.stamp_ns) if is_filtered else None,
            self._motion.source is not MotionSource.STILL,
            self._gyro.at(record.stamp_ns) if stream.mount is MountKind.LEVEL else None,
        )

    def _base_poses(self, mount: Mount, stamps_ns: Int64) -> Float64:
        """Return T_odom_base (K, 4, 4); odometry may have another child frame than the base."""
        T = self._motion.at(stamps_ns, mount.base or "")
        if self._motion.source is not MotionSource.ODOMETRY:
            return T
        roll_pitch, between = self._roll_pitch.at(stamps_ns), mount.odometry_chain
        if roll_pitch is not None:
            T = T @ pose_from_roll_pitch(roll_pitch)
        return T if between is None else T @ between.at(stamps_ns)
