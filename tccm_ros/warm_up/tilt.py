"""Compile the kernels of tilt cycles, or load them from disk, before the first record.

A temporary processor receives the measurements of a synthetic robot in a synthetic room: a floor,
two walls, a table with objects on it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.calibrate.rig_check import RigCheck
from tccm_ros.config import Config
from tccm_ros.cuboids.cycle_records import CyclePoints
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor
from tccm_ros.planes.horizontal_clusters import label_horizontal
from tccm_ros.records import (
    CameraInfo,
    DepthImage,
    JointSample,
    Odometry,
    PointCloud,
    RobotDescription,
    Scan,
    SelfShapes,
)
from tccm_ros.sensors.compressed_depth import decode_rvl
from tccm_ros.sensors.depth_image import PosedImage, measure_image
from tccm_ros.sensors.level_projection import nearest_ranges
from tccm_ros.sensors.point_cloud import PosedCloud, measure_cloud
from tccm_ros.warm_up.made_robot import (
    BEAMS,
    HEIGHT,
    PERIOD_NS,
    ROBOT,
    START_NS,
    events_of,
    made_scan,
    with_own_robot,
)

SCANS = 110
"""Number of scans: two and a half tilt cycles."""

BOXES = (
    (0.70, (0.4, 1.4), 0.5),
    (0.73, (0.75, 1.0), 0.15),
    (0.79, (0.77, 0.98), 0.13),
    (0.85, (0.8, 0.95), 0.1),
)
"""A table with steps on it: height of the top, extent in x, and half width, m."""


def warm_up(config: Config) -> None:
    """Process tilt cycles in a temporary TCCM processor."""
    config = with_own_robot(config)
    _measure(config)
    processor = TccmProcessor(config)
    results: list[CycleResult] = []
    for event in events_of(_tilt(), config):
        results += processor.add(event)
    results += processor.finish()
    label_horizontal(processor.map.cuboids())
    results[-1].part.cuboids()  # with its caps
    check = RigCheck()
    for result in results:
        check.add(result)


def _measure(config: Config) -> None:
    """Measure small images and clouds with all types of depths and times."""
    K = np.array([[40.0, 0.0, 20.0], [0.0, 40.0, 15.0], [0.0, 0.0, 1.0]])
    camera = CameraInfo(START_NS, "", 40, 30, "", np.zeros(0), K, np.zeros((3, 4)))
    stamps_ns = np.array([START_NS, START_NS + PERIOD_NS])
    poses = np.broadcast_to(np.eye(4), (2, 4, 4)).copy()
    shapes = SelfShapes(np.zeros(1, np.int64), np.full((1, 3), 0.5), np.eye(4)[None])
    for depth in (np.full((30, 40), 1000, np.uint16), np.ones((30, 40), np.float32)):
        image = DepthImage(START_NS, "", depth, camera)
        posed = PosedImage(image, stamps_ns[:1], poses[:1], poses[:1], own_shapes=shapes)
        CyclePoints(posed, measure_image(posed, config)).bin(PartMapBuilder(config))
    for since_ns in (None, np.arange(60) * 1000):
        points = np.linspace(0.2, 2.0, 180, dtype=np.float32).reshape(60, 3)
        cloud = PosedCloud(PointCloud(START_NS, "", points, since_ns), stamps_ns, poses, poses)
        CyclePoints(cloud, measure_cloud(cloud, config)).bin(PartMapBuilder(config))
        nearest_ranges(points.astype(np.float64), 0.0, 1.0)
    decode_rvl(np.zeros(1, np.uint32), np.zeros(4, np.uint16))


def _tilt() -> Iterator[tuple[str, RobotDescription | Odometry | JointSample | Scan]]:
    """Yield tilt cycles of a laser in the room, each scan between two joint samples."""
    yield "robot_description", ROBOT
    bearings = np.linspace(-1.2, 1.2, BEAMS)
    for k in range(SCANS):
        stamp_ns = START_NS + k * PERIOD_NS
        tilt = float(0.7 + 0.5 * np.sin(2.0 * np.pi * k / (SCANS / 1.3)))
        yield "odom", Odometry(stamp_ns, "odom", "base", np.eye(4))
        yield "joint_states", JointSample(stamp_ns, ("tilt",), np.array([tilt]))
        yield "tilt_scan", made_scan(stamp_ns, "laser", bearings, _room_ranges(bearings, tilt))


def _room_ranges(bearings: Float64, tilt: float) -> Float64:
    """Return the ranges (B,) of beams tilted downwards from (0, 0, HEIGHT)."""
    x, y = np.cos(bearings) * np.cos(tilt), np.sin(bearings)
    z = -np.cos(bearings) * np.sin(tilt)
    with np.errstate(divide="ignore"):
        ranges = np.minimum(3.0 / np.abs(x), 3.0 / np.abs(y))
        ranges = np.minimum(ranges, np.where(z < 0.0, HEIGHT / -z, np.inf))
        for top, (x0, x1), half_width in BOXES:
            far = np.where(z < 0.0, (HEIGHT - top) / -z, np.inf)
            hit = (far * x > x0) & (far * x < x1) & (np.abs(far * y) < half_width)
            ranges = np.where(hit, np.minimum(ranges, far), ranges)
    return ranges
