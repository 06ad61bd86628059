"""A room of boxes, with a tilting laser on a robot that may drive.

Independent of the mapping code: the simulator casts the beams. The laser is at
(0.1, 0, 1.4) in the base, tilts about y through itself, positive downwards, and measures while the
joint moves.
"""

import math

import numpy as np

from tccm_ros.config import Config
from tccm_ros.records import JointSample, Odometry, Scan
from tccm_sim.scene import Scene

LASER = (0.1, 0.0, 1.4)
BEAMS = 181
FIRST, STEP = -math.pi / 3, 2 * math.pi / 3 / 180
SCAN_TIME, HALF_TIME = 0.028, 1.4
TILT_LIMITS = (math.radians(10), math.radians(65))

FLOOR = (-9.0, 9.0, -9.0, 9.0, -1.0, 0.0)
WALL = (3.0, 9.0, -9.0, 9.0, 0.0, 3.0)
TABLE = (0.9, 1.7, -0.6, 0.6, 0.66, 0.7)
BOX = (1.2, 1.4, -0.1, 0.1, 0.7, 0.9)


def settings(**groups):
    """Return a configuration for this robot."""
    rig = {"kinematics": "rig", "tilt_laser": (*LASER, 0.0, 0.0, 0.0)}
    tree = {"rig": rig, "frames": {"tilt_joint": "tilt", "base": "base"}, **groups}
    return Config.model_validate(tree)


def tilt_at(t):
    """Return the tilt angle of a triangle between the limits of TILT_LIMITS, rad."""
    phase = (t / HALF_TIME) % 2.0
    fraction = phase if phase < 1.0 else 2.0 - phase
    return TILT_LIMITS[0] + (TILT_LIMITS[1] - TILT_LIMITS[0]) * fraction


def base_at(t, drive):
    """Return (x, y, yaw) of a base that drives a circle: `drive` is (speed, turn rate)."""
    v, w = drive
    if w == 0.0:
        return v * t, 0.0, 0.0
    return v / w * math.sin(w * t), v / w * (1 - math.cos(w * t)), w * t


def cast(beams, boxes):
    """Return the distance to the nearest box along beams (origin, direction), inf for none."""
    scene = Scene()
    for box in boxes:
        scene.block("box", *np.reshape(box, (3, 2)))
    origins, directions = (np.array(part, float) for part in zip(*beams, strict=True))
    return scene.freeze().cast(origins, directions, np.zeros(len(beams)))[0]


def beam(t, bearing, drive):
    """Return origin and direction of a beam in the world, at its own time."""
    x, y, yaw = base_at(t, drive)
    a = tilt_at(t)
    forward, left = math.cos(bearing), math.sin(bearing)
    u, v, w = forward * math.cos(a), left, -forward * math.sin(a)
    c, s = math.cos(yaw), math.sin(yaw)
    origin = (x + c * LASER[0] - s * LASER[1], y + s * LASER[0] + c * LASER[1], LASER[2])
    return origin, (c * u - s * v, s * u + c * v, w)


def record(seconds, boxes_at, drive=(0.0, 0.0), noise=0.0, every=2, seed=0):
    """Return the records of a run, in stamp order.

    `boxes_at(t)` gives the boxes at a time; one beam in `every` is measured.
    """
    rng = np.random.default_rng(seed)
    records = []
    for k in range(round(seconds * 100) + 6):
        t = k / 100
        records.append(JointSample(ns(t), ("tilt",), np.array([tilt_at(t)])))
        x, y, yaw = base_at(t, drive)
        T = np.eye(4)
        T[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
        T[:2, 3] = x, y
        records.append(Odometry(ns(t), "odom", "base", T))
    step, beams = STEP * every, BEAMS // every
    increment = 0.02 / beams
    for k in range(int(seconds / SCAN_TIME)):
        start = k * SCAN_TIME + 0.0003
        rays = [beam(start + i * increment, FIRST + i * step, drive) for i in range(beams)]
        ranges = cast(rays, boxes_at(start)) + rng.normal(0.0, noise, beams)
        records.append(
            Scan(ns(start), "laser", FIRST, step, increment, 0.05, 20.0, ranges.astype(np.float32))
        )
    return sorted(records, key=lambda r: (r.stamp_ns, type(r).__name__))


def ns(t):
    """Return seconds as ns, from an epoch that floats cannot hold exactly."""
    return 1_700_000_000_000_000_000 + round(t * 1e9)
