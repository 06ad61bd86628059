"""Run a world: yield the messages of its robot in order of arrival."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from tccm_ros.arrays import Float32, Float64, Int64
from tccm_ros.records import (
    CameraImage,
    CameraInfo,
    DepthImage,
    Imu,
    JointSample,
    Odometry,
    PointCloud,
    RobotDescription,
    Scan,
    TransformSample,
)
from tccm_sim.cameras import DepthCamera, Pinhole, measure_depths
from tccm_sim.colour_camera import ColourCamera, ColourRenderer, exposed, jpeg
from tccm_sim.imu import ImuModel, angular_velocities, specific_forces
from tccm_sim.joints import Profile
from tccm_sim.lasers import Laser, measure, rim_directions
from tccm_sim.lidars import SpinningLidar, measure_points
from tccm_sim.motion import tilted_at_stops, wheel_odometry
from tccm_sim.options import Options
from tccm_sim.panels import panel_arrays
from tccm_sim.rigid import invert, rigid
from tccm_sim.rigs import Joint, Rig
from tccm_sim.scene import FrozenScene, Scene
from tccm_sim.world import World, with_options

Record = (
    RobotDescription
    | TransformSample
    | JointSample
    | Odometry
    | Imu
    | Scan
    | CameraImage
    | CameraInfo
    | DepthImage
    | PointCloud
)

EPOCH_NS = 1_600_000_000_000_000_000
"""Stamp of the world's time 0."""

JOINT_PERIOD_NS, ODOMETRY_PERIOD_NS = 10_000_000, 20_000_000
"""Periods of the messages. Chosen: 100 and 50 Hz."""

JOINT_DELAY_NS, ODOMETRY_DELAY_NS, SCAN_DELAY_NS = 1_000_000, 3_000_000, 2_000_000
"""Delays of messages after their measurements. Chosen; an IMU has the delay of joints."""

INFO_DELAY_NS, IMAGE_DELAY_NS = 4_000_000, 30_000_000
"""Delays of a camera's calibration and of its images. Chosen: images are computed."""

BLOCK = 500
"""Number of joint or odometry samples computed at once."""

MARGIN_NS = 40_000_000
"""Duration of joints and odometry before the first scan and after the last."""


class Message(NamedTuple):
    """A message of the robot.

    Attributes
    ----------
    log_ns
        Time of publication, ns.
    topic
        Name of the topic.
    records
        Its records; ``/tf`` may have several.
    """

    log_ns: int
    topic: str
    records: tuple[Record, ...]


@dataclass(frozen=True)
class _Mount:
    """A laser with its frame, its topic, and the times at which it publishes."""

    laser: Laser
    frame: str
    topic: str
    windows: Float64


class Simulation:
    """A world with a seed and options.

    Parameters
    ----------
    world
        The world.
    seed
        Seed of all noise; the same seed gives the same records.
    options
        Variations of the world.
    """

    def __init__(self, world: World, seed: int = 0, options: Options | None = None) -> None:
        self.options = options or Options()
        self._seeds = np.random.SeedSequence(seed).spawn(9)
        tilt, tilting = self.options.stop_tilt, np.random.default_rng(self._seeds[7])
        self.world = replace(world, drive=tilted_at_stops(world.drive, tilt, tilting))
        self.rig = with_options(world.rig, self.options)
        self.scene = world.scene.freeze()
        self._bodies = _frozen_bodies(self.rig) if self.options.self_hits else {}
        self._true_rig = self.rig.mounted(
            self.rig.pan_joint or self.rig.tilt_joint,
            (0.0, 0.0, self.options.laser_height),
            (self.options.laser_roll, 0.0, 0.0),
        )
        level_joint = self.rig.chain(self.rig.level_frame)[-1].name
        error = self.options.level_error
        self._true_rig = self._true_rig.mounted(level_joint, error[:3], error[3:])
        slipping = np.random.default_rng(self._seeds[0])
        wheels = wheel_odometry(world.drive, self.rig.errors, self.rig.odom_start, slipping)
        self._wheels = np.ascontiguousarray(wheels.T)
        steps = np.hypot(*np.diff(world.drive.states[:, :2], axis=0).T)
        self._path = np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def start_ns(self) -> int:
        """Stamp of the world's time 0."""
        return EPOCH_NS

    @property
    def duration_ns(self) -> int:
        """Length of the recording, ns."""
        return round(self.world.duration * 1e9)

    def run(self) -> Iterator[Message]:
        """Yield the messages in order of publication."""
        rig, topics = self.rig, self.rig.topics
        always = np.array([[-np.inf, np.inf]])
        level = _Mount(rig.level, rig.level_frame, topics.scan, always)
        windows = always if self.options.always else self.world.tilt_windows
        random = [np.random.default_rng(seed) for seed in self._seeds]
        streams = [self._description(), self._joints(), self._odometry()]
        if self.options.level:
            streams.append(self._scans(level, random[1]))
        if rig.tilt is not None:
            tilt = _Mount(rig.tilt, rig.tilt_frame, topics.tilt_scan, windows)
            streams.append(self._scans(tilt, random[2]))
        if rig.camera is not None:
            streams.append(self._images(rig.camera, random[3]))
        if rig.colour_camera is not None:
            streams.append(self._pictures(rig.colour_camera, random[5]))
        if rig.lidar is not None:
            streams.append(self._clouds(rig.lidar, random[4]))
        if rig.imu is not None:
            streams.append(self._imu(rig.imu, random[6], random[8]))
        yield from heapq.merge(*streams, key=lambda message: message.log_ns)

    def true_poses(self, times: Float64) -> Float64:
        """Return T_world_base, float64 (B, 4, 4), at times (B,) in s."""
        return self.world.drive.poses(times, self.rig.base_height)

    def sensor_poses(self, frame: str, times: Float64) -> Float64:
        """Return the true T_world_sensor, float64 (B, 4, 4), at times (B,) in s."""
        return self.true_poses(times) @ self._link_poses(frame, times)

    def _link_poses(self, frame: str, times: Float64) -> Float64:
        """Return the true T_base_frame, float64 (B, 4, 4), at times (B,) in s."""
        if frame == self.rig.base:
            return np.broadcast_to(np.eye(4), (len(times), 4, 4))
        moving = {joint.name for joint in self._true_rig.chain(frame)}
        positions = {n: p.at(times) for n, p in self.world.joints.items() if n in moving}
        return self._true_rig.laser_poses(frame, positions, len(times))

    def _description(self) -> Iterator[Message]:
        """Yield the robot description and the fixed joints."""
        if self.options.description:
            yield Message(EPOCH_NS, "/robot_description", (RobotDescription(self.rig.urdf()),))
        fixed = tuple(
            TransformSample(EPOCH_NS, j.parent, j.child, rigid(j.xyz, j.rpy), True)
            for j in self.rig.joints
            if not j.moves
        )
        yield Message(EPOCH_NS, "/tf_static", fixed)

    def _joints(self) -> Iterator[Message]:
        """Yield the joint states, quantised by the encoders."""
        options, rig = self.options, self.rig
        names = (*rig.moving, *rig.wheels)
        late_ns = round(options.joint_time_offset * 1e9)
        moving = [joint for joint in rig.joints if joint.moves]
        tilt = rig.moving.index(rig.tilt_joint)
        for times_ns in _blocks(self.duration_ns, JOINT_PERIOD_NS):
            true = self._joint_positions(np.asarray(times_ns * 1e-9, np.float64))
            true[:, tilt] = (true[:, tilt] - options.tilt_offset) / options.tilt_scale
            if rig.pan_joint:
                true[:, rig.moving.index(rig.pan_joint)] -= options.pan_offset
            for now_ns, row in zip(times_ns.tolist(), np.round(true / rig.encoder) * rig.encoder):
                sample = JointSample(EPOCH_NS + now_ns - late_ns, names, row.copy())
                log_ns = EPOCH_NS + now_ns + JOINT_DELAY_NS
                yield Message(log_ns, rig.topics.joint_states, (sample,))
                if options.publish_tf:
                    positions = dict(zip(names, row))
                    transforms = tuple(
                        _joint_transform(j, sample, positions[j.name]) for j in moving
                    )
                    yield Message(log_ns, "/tf", transforms)

    def _joint_positions(self, times: Float64) -> Float64:
        """Return the true positions (B, J) of the moving joints, then of the wheels."""
        rest = Profile.rest(0.0)
        turning = [self.world.joints.get(name, rest).at(times) for name in self.rig.moving]
        drive = self.world.drive
        path = np.interp(times, drive.times, self._path)
        yaw_path = np.interp(times, drive.times, drive.columns[2]) * self.rig.wheel_distance / 2.0
        wheels = [
            (path - yaw_path) / self.rig.wheel_radius,
            (path + yaw_path) / self.rig.wheel_radius,
        ]
        return np.column_stack([*turning, *wheels])

    def _odometry(self) -> Iterator[Message]:
        """Yield the wheel odometry."""
        rig, drive = self.rig, self.world.drive
        for times_ns in _blocks(self.duration_ns, ODOMETRY_PERIOD_NS):
            poses = [np.interp(times_ns * 1e-9, drive.times, column) for column in self._wheels]
            for now_ns, x, y, yaw in zip(times_ns.tolist(), *poses):
                T_odom_base = rigid((x, y, 0.0), (0.0, 0.0, yaw))
                stamp_ns = EPOCH_NS + now_ns
                record = Odometry(stamp_ns, rig.odom_frame, rig.base, T_odom_base)
                log_ns = stamp_ns + ODOMETRY_DELAY_NS
                yield Message(log_ns, rig.topics.odom, (record,))
                if self.options.publish_tf:
                    sample = TransformSample(stamp_ns, rig.odom_frame, rig.base, T_odom_base, False)
                    yield Message(log_ns, "/tf", (sample,))

    def _imu(self, imu: ImuModel, *random: Generator) -> Iterator[Message]:
        """Yield the samples of the IMU: mean rates over its period, and specific forces."""
        rig, period_ns = self.rig, round(imu.period * 1e9)
        for times_ns in _blocks(self.duration_ns, period_ns):
            edges = np.append(times_ns - period_ns // 2, times_ns[-1] + period_ns // 2)
            exact = angular_velocities(self.true_poses(edges * 1e-9), imu.period)
            around = np.concatenate([times_ns[:1] - period_ns, times_ns, times_ns[-1:] + period_ns])
            forces = specific_forces(self.true_poses(around * 1e-9), imu.period)
            measured = zip(
                times_ns.tolist(),
                imu.measure_rates(exact, random[0]),
                imu.measure_forces(forces, random[1]),
            )
            for now_ns, rates, force in measured:
                stamp_ns = EPOCH_NS + now_ns
                record = Imu(stamp_ns, rig.base, rates.copy(), force.copy())
                yield Message(stamp_ns + JOINT_DELAY_NS, rig.topics.imu, (record,))

    def _scans(self, mount: _Mount, random: Generator) -> Iterator[Message]:
        """Yield the scans of one laser that begin and end within its windows."""
        laser = mount.laser
        scan_duration = float(laser.offsets[-1])
        for start_ns in self._starts(laser.period):
            start, end = start_ns * 1e-9, start_ns * 1e-9 + scan_duration
            if not np.any((mount.windows[:, 0] <= start) & (end <= mount.windows[:, 1])):
                continue
            stamp_ns = EPOCH_NS + start_ns
            ranges = self._ranges(mount, start + laser.offsets, random)
            scan = Scan(stamp_ns, mount.frame, *_limits(laser), ranges)
            yield Message(
                stamp_ns + round(scan_duration * 1e9) + SCAN_DELAY_NS, mount.topic, (scan,)
            )

    def _ranges(self, mount: _Mount, times: Float64, random: Generator) -> Float32:
        """Return the ranges of a laser at the times of its beams, float32 (B,), m."""
        laser = mount.laser
        bearings = laser.bearings
        center = np.stack([np.cos(bearings), np.sin(bearings), np.zeros_like(bearings)], axis=-1)
        max_range = laser.range_max + 1.0
        scenes = self._scenes(mount.frame, times)
        exact = _nearest(_cast(*scene, center, times, max_range) for scene in scenes)
        if laser.mixed == 0.0:
            return measure(laser, exact, None, random)
        around = random.uniform(0.0, 2.0 * np.pi, len(bearings))

        def rim(beams: Int64) -> Float64:
            rays = rim_directions(bearings[beams], laser.divergence, around[beams])
            return _nearest(_cast(*scene, rays, times, max_range, beams) for scene in scenes)

        return measure(laser, exact, rim, random)

    def _images(self, camera: DepthCamera, random: Generator) -> Iterator[Message]:
        """Yield the depth images of the camera, and its calibration before each."""
        rig, topics = self.rig, self.rig.topics
        for start_ns in self._starts(camera.period):
            stamp_ns = EPOCH_NS + start_ns
            info = _camera_info(camera, stamp_ns, rig.camera_frame)
            yield Message(stamp_ns + INFO_DELAY_NS, topics.camera_info, (info,))
            exact, cosines = self.exact_depths(camera, start_ns * 1e-9)
            depths = measure_depths(camera, exact, cosines, random)
            image = DepthImage(stamp_ns, rig.camera_frame, depths, info)
            yield Message(stamp_ns + IMAGE_DELAY_NS, topics.depth, (image,))

    def exact_depths(self, camera: DepthCamera, time: float) -> tuple[Float64, Float64]:
        """Return depths and cosines of incidence of an image at a time in s.

        Returns
        -------
        float64 (height, width), twice
            Depth along the optical axis, m, +inf without a hit, and cosine.
        """
        casts = [*self._casts(self.rig.camera_frame, camera.rays, np.array([time]), 100.0)]
        ranges = np.array([cast.ranges for cast in casts])
        nearest, cosines = np.argmin(ranges, axis=0), np.empty(len(camera.rays))
        for k, cast in enumerate(casts):
            rows = np.flatnonzero(nearest == k)
            cosines[rows] = cast.cosines(rows)
        shape = camera.height, camera.width
        depths = ranges.min(axis=0) * camera.rays[:, 2]
        return depths.reshape(shape), cosines.reshape(shape)

    def _pictures(self, camera: ColourCamera, random: Generator) -> Iterator[Message]:
        """Yield the JPEG pictures of the colour camera, and its calibration before each."""
        rig, topics = self.rig, self.rig.topics
        renderer = ColourRenderer(self.scene, panel_arrays(self.world.panels))
        for start_ns in self._starts(camera.period):
            stamp_ns = EPOCH_NS + start_ns
            info = _camera_info(camera, stamp_ns, rig.colour_frame)
            yield Message(stamp_ns + INFO_DELAY_NS, topics.colour_info, (info,))
            time = start_ns * 1e-9
            poses = self.sensor_poses(rig.colour_frame, camera.exposure_times(time))
            pixels = exposed(camera, renderer.render(camera, poses, time), random)
            size, data = (camera.width, camera.height), jpeg(pixels, camera.quality)
            image = CameraImage(stamp_ns, rig.colour_frame, "compressed", size, data, info)
            yield Message(stamp_ns + IMAGE_DELAY_NS, topics.colour, (image,))

    def _clouds(self, lidar: SpinningLidar, random: Generator) -> Iterator[Message]:
        """Yield the clouds of the lidar, one per revolution."""
        offsets = lidar.laser.offsets
        for start_ns in self._starts(lidar.laser.period):
            times = start_ns * 1e-9 + offsets
            exact = self._distances(self.rig.lidar_frame, lidar.rays, times, 100.0)
            points, since_ns = measure_points(lidar, exact, random)
            cloud = PointCloud(EPOCH_NS + start_ns, self.rig.lidar_frame, points, since_ns)
            log_ns = EPOCH_NS + start_ns + round(lidar.laser.period * 1e9) + SCAN_DELAY_NS
            yield Message(log_ns, self.rig.topics.points, (cloud,))

    def _starts(self, period: float) -> range:
        """Return the times of a periodic measurement, ns, with joints and odometry around each."""
        period_ns = round(period * 1e9)
        return range(MARGIN_NS, self.duration_ns - MARGIN_NS - period_ns, period_ns)

    def _distances(self, frame: str, rays: Float64, times: Float64, max_range: float) -> Float64:
        """Return exact distances to the world or the robot along rays, float64 (B,), m.

        Parameters
        ----------
        frame
            Frame of the sensor.
        rays
            float64 (B, 3), unit vectors in the frame.
        times
            float64 (T,), s, ascending; each is the time of B / T successive rays.
        max_range
            Maximum range, m.
        """
        return _nearest(self._casts(frame, rays, times, max_range))

    def _casts(
        self, frame: str, rays: Float64, times: Float64, max_range: float
    ) -> Iterator[_Cast]:
        """Yield the rays cast into the world, and into each link of the robot that has a body."""
        for scene in self._scenes(frame, times):
            yield _cast(*scene, rays, times, max_range)

    def _scenes(self, frame: str, times: Float64) -> list[tuple[FrozenScene, Float64]]:
        """Return the world and each link of the robot that has a body, with T_scene_sensor."""
        T_base_sensor = self._link_poses(frame, times)
        scenes = [(self.scene, self.true_poses(times) @ T_base_sensor)]
        for link, body in self._bodies.items():
            T_link_sensor = T_base_sensor
            if link != self.rig.base:
                T_link_sensor = invert(self._link_poses(link, times)) @ T_base_sensor
            scenes.append((body, T_link_sensor))
        return scenes


class _Cast(NamedTuple):
    """Rays in a scene, float64 (B, 3), with their ranges and codes as in `raycast.cast`."""

    scene: FrozenScene
    origins: Float64
    directions: Float64
    ranges: Float64
    codes: Int64

    def cosines(self, rows: Int64) -> Float64:
        """Return the cosines of the angles of incidence of the rays `rows` (R,), float64 (R,)."""
        rays = self.origins[rows], self.directions[rows], self.ranges[rows], self.codes[rows]
        return self.scene.cosines(*rays)


def _nearest(casts: Iterable[_Cast]) -> Float64:
    """Return the distances to the nearest scene along the same rays, float64 (B,), m."""
    nearest: Float64 = np.minimum.reduce([cast.ranges for cast in casts])
    return nearest


def _cast(
    scene: FrozenScene,
    T_scene_sensor: Float64,
    rays: Float64,
    times: Float64,
    max_range: float,
    chosen: Int64 | slice = slice(None),
) -> _Cast:
    """Cast rays (B, 3) of a sensor's frame, as in `_distances`; at the chosen times."""
    interval = float(times[0]), float(times[-1])
    T_scene_sensor, times = T_scene_sensor[chosen], times[chosen]
    repeats = len(rays) // max(len(times), 1)
    by_pose = rays.reshape(len(times), repeats, 3)
    directions = np.einsum("tij,tbj->tbi", T_scene_sensor[:, :3, :3], by_pose).reshape(-1, 3)
    origins = np.repeat(T_scene_sensor[:, :3, 3], repeats, axis=0)
    hits = scene.cast(origins, directions, np.repeat(times, repeats), max_range, interval)
    return _Cast(scene, origins, directions, *hits)


def _camera_info(camera: Pinhole, stamp_ns: int, frame: str) -> CameraInfo:
    """Return the calibration of a camera without distortion."""
    (cx, cy), f = camera.center, camera.focal
    K = np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])
    P = np.column_stack([K, np.zeros(3)])
    return CameraInfo(stamp_ns, frame, camera.width, camera.height, "plumb_bob", np.zeros(5), K, P)


def _limits(laser: Laser) -> tuple[float, float, float, float, float]:
    """Return angle_min, angle_increment, time_increment, range_min, range_max as in a message."""
    exact = (
        laser.angle_min, laser.angle_increment, laser.time_increment, laser.range_min,
        laser.range_max,
    )  # fmt: skip
    first, step, time, low, high = np.array(exact, np.float32).tolist()
    return first, step, time, low, high


def _frozen_bodies(rig: Rig) -> dict[str, FrozenScene]:
    """Return the robot's own boxes for ray casting, by link, in the link's frame."""
    scenes: dict[str, Scene] = {}
    for body in rig.bodies:
        scenes.setdefault(body.link, Scene()).box(body.link, body.size, body.center)
    return {link: scene.freeze() for link, scene in scenes.items()}


def _blocks(duration_ns: int, period_ns: int) -> Iterator[Int64]:
    """Yield the times of periodic samples, ns, in blocks."""
    span_ns = BLOCK * period_ns
    for start_ns in range(0, duration_ns + 1, span_ns):
        yield np.arange(start_ns, min(start_ns + span_ns, duration_ns + 1), period_ns)


def _joint_transform(joint: Joint, sample: JointSample, position: float) -> TransformSample:
    """Return the transform of a joint at a position."""
    motion, still = tuple(position * a for a in joint.axis), (0.0, 0.0, 0.0)
    T_motion = rigid(motion) if joint.slides else rigid(still, motion)
    T = rigid(joint.xyz, joint.rpy) @ T_motion
    return TransformSample(sample.stamp_ns, joint.parent, joint.child, T, False)
