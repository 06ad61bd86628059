"""Whether level scans made of depth images or point clouds tell how the robot moves.

A camera sees a short arc of what is vertical. Where that is a single front, or nothing, a match of
its scans says less than odometry does.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import choose_topics
from tccm_ros.config import Config
from tccm_ros.records import Posed, PosedScan
from tccm_ros.robot import Robot
from tccm_ros.sensors.level_projection import LevelProjector
from tccm_ros.slam.matching.alignment import align
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.matching.line_map import make_line_map

SAMPLES, SPACING_NS = 10, 1_000_000_000
"""Level scans that are looked at, and the time between them at least (chosen)."""

MIN_FRACTION = 0.5
"""Fraction of them that must determine x, y and yaw (chosen)."""

POINTS = 5
"""Points of a scan that is matched at all, as of the front end (chosen)."""


def level_scans_help(path: Path | str, source: Literal["points", "depth"]) -> bool:
    """Return whether most level scans of a recording's beginning determine the robot's pose.

    Each is aligned with itself: what remains of the information after the noise of normals has been
    taken out of it (`slam.matching.alignment`) is what its geometry holds.

    Parameters
    ----------
    path
        A rosbag2 folder, an .mcap or a .db3 file.
    source
        As ``sensors.level_from``.

    Raises
    ------
    BagError, TopicError
        If the bag cannot be read, or names of topics are in doubt.
    """
    config = Config()
    config.sensors.level_from = source
    sampled, stamps_ns = list[bool](), set[int]()
    with BagReader(path) as reader:
        choice = choose_topics(reader, config)
        reader.add_readers(choice.readers)
        robot = Robot(config, choice.streams, expects_odometry=choice.counts["odom"] > 0)
        projector, next_ns = LevelProjector(config), -(2**62)
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
