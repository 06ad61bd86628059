"""Measurements available in one step of the control loop, in the odometry frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Float64


@dataclass(frozen=True, slots=True, eq=False)
class TopCycle:
    """Points on horizontal surfaces from one tilt cycle.

    Attributes
    ----------
    stamp_s
        Middle of the cycle, s.
    points
        float64 (N, 3), m; z over z = 0 of the base frame.
    sensor
        float64 (3,), position of the sensor.
    """

    stamp_s: float
    points: Float64
    sensor: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Newest measurement of every input.

    Attributes
    ----------
    now_s
        Time of the step, s, on the clock of all stamps.
    pose, pose_s
        float64 (3,), planar pose of the base, and its stamp.
    map_odom
        float64 (3,), planar pose of odom in map; None while the robot is not localised.
    why_lost
        Reason for lost localisation, for the user.
    scan, scan_s
        float64 (N, 2), points of the level laser, and its stamp.
    laser
        float64 (2,), position of the level laser at that stamp.
    obstacle_points, obstacles_s
        float64 (M, 3), cubes of the integration map and of `ObstacleMemory` that contain points: x
        and y of the middle, z of a point in it; and the stamp of the newest, s.
    cycle
        Newest tilt cycle; None before the first.
    cube_m
        Edge length of the cubes, m.
    """

    now_s: float
    pose: Float64
    pose_s: float
    map_odom: Float64 | None
    why_lost: str = ""
    scan: Float64 = field(default_factory=lambda: np.zeros((0, 2)))
    scan_s: float = -np.inf
    laser: Float64 = field(default_factory=lambda: np.zeros(2))
    obstacle_points: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    obstacles_s: float = -np.inf
    cycle: TopCycle | None = None
    cube_m: float = 0.0
