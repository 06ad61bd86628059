"""A robot with odometry and surface messages of an ideal room, without bags."""

import numpy as np
from room import Board, Room, Screen

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import Odometry

WALLS = [
    Screen(-2.5, -2.0, 3.5, -2.0, 2.5),
    Screen(3.5, -2.0, 3.5, 2.6, 2.5),
    Screen(3.5, 2.6, -2.5, 2.6, 2.5),
    Screen(-2.5, 2.6, -2.5, -2.0, 2.5),
    Screen(0.9, 2.6, 0.9, 1.9, 2.5),
    Screen(2.3, -2.0, 2.3, -1.2, 2.5),
    Screen(2.3, -1.2, 2.9, -0.9, 2.5),
    Screen(1.5, 2.6, 1.8, 2.0, 2.5),
]
TABLE = Board(1.6, 0.2, 0.8, 1.2, 0.74)
ROOM = Room([TABLE, Board(2.9, 1.6, 0.5, 0.9, 0.9)], WALLS, Board(0.5, 0.3, 6.0, 4.6, 0.0))
PLACES = [(0.0, 0.0, 0.0), (0.0, 0.6, 0.1), (0.2, 0.6, -0.4), (0.2, -0.4, 0.3)]


def odometry(stamp_ns, place):
    return Odometry(stamp_ns, "odom", "base", spatial(np.array(place, float)))


def drive(slam, places=PLACES, start=(0.0, 0.0, 0.0), seed=0):
    """Add a view from each place; odometry is relative to `start`. Return the processor."""
    from tccm_ros.geometry import between2

    for k, place in enumerate(places):
        stamp = (k + 1) * 1_000_000_000
        slam.add(odometry(stamp - 400_000_000, between2(np.array(start), np.array(place))))
        slam.add(odometry(stamp + 400_000_000, between2(np.array(start), np.array(place))))
        for record in ROOM.look(place, stamp, seed=seed + k, noise=0.003):
            slam.add(record)
        slam.add_pose_stamp(stamp)
    return slam


def new_slam():
    return SurfaceSlam(Config())
