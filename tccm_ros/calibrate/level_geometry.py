"""Test whether level scans from depth images or point clouds determine the robot's motion.

A camera sees a short arc of vertical surfaces. If that is a single front, or nothing, matching of
its scans is less informative than odometry.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import add_latched, choose_topics
from tccm_ros.config import Config
from tccm_ros.records import Posed, PosedScan
from tccm_ros.robot import Robot
from tccm_ros.sensors.level_projection import LevelProjector
from tccm_ros.slam.matching.alignment import align
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.matching.line_map import make_line_map

SAMPLES, SPACING_NS = 10, 1_000_000_000
"""Number of level scans to test, and minimum time between them (chosen)."""

MIN_FRACTION = 0.5
"""Minimum fraction of the tested level scans that determine x, y and yaw (chosen)."""

POINTS = 5
"""Minimum number of points of a scan, as in the front end (chosen)."""


def level_scans_help(path: Path | str, source: Literal["points", "depth"]) -> bool:
    """Return whether most level scans at the start of a recording determine the robot's pose.

    Each scan is aligned with itself. The geometry is sufficient if information remains after
    removal of the information due to noise of the normals (`slam.matching.alignment`).

    Parameters
    ----------
    path
        A rosbag2 folder, an .mcap or a .db3 file.
    source
        Value of ``sensors.level_from``.

    Raises
    ------
    BagError, TopicError
        If the bag cannot be read, or topic names are ambiguous.
    """
    config = Config()
    config.sensors.level_from = source
    sampled, stamps_ns = list[bool](), set[int]()
    with BagReader(path) as reader:
        choice = choose_topics(reader, config)
        reader.add_readers(choice.readers)
        robot = Robot(config, choice.streams, expects_odometry=choice.counts["odom"] > 0)
        projector, next_ns = LevelProjector(config), -(2**62)
        add_latched(reader, choice.topics, robot)
        for role, _, record in reader.records(choice.topics):
            events = robot.add(role, record)
            posed = [e for e in events if isinstance(e, Posed) and e.stamp_ns >= next_ns]
            made = [scan for scan in map(projector.project, posed[:1]) if scan is not None]
            for scan in made:
                next_ns = scan.stamp_ns + SPACING_NS
                stamps_ns.add(scan.stamp_ns)
                events += robot.add("scan", scan)
            scans = [e for e in events if isinstance(e, PosedScan)]
            sampled += [determines_pose(s, config) for s in scans if s.scan.stamp_ns in stamps_ns]
            if len(sampled) >= SAMPLES:
                break
    return bool(sampled) and float(np.mean(sampled)) >= MIN_FRACTION


def determines_pose(posed: PosedScan, config: Config) -> bool:
    """Return whether the geometry of a level scan determines x, y and yaw of the base."""
    scan = make_level_scan(posed, config)
    if len(scan.points) < POINTS:
        return False
    alone, sigma = make_line_map(np.zeros((1, 3)), [scan]), config.matching.range_sigma
    found = align(alone, scan.points, scan.normals, np.zeros(3), sigma)
    return int(np.linalg.matrix_rank(found.information, tol=1.0)) == len(found.pose)
