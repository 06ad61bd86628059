"""Inputs of an approach: the robot, the goal and the surrounding map."""

from __future__ import annotations

from dataclasses import dataclass, field

from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.speeds import SpeedLimits
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.slam.occupancy import OccupancyGrid


@dataclass(frozen=True, slots=True, eq=False)
class RobotBase:
    """The base.

    Attributes
    ----------
    footprint, limits
        Its footprint and velocity limits.
    height
        Height of the robot, m: higher obstacles are ignored.
    latency_s
        Latency from a command to its motion, s.
    margin
        Minimum distance from all obstacles but the approached surface, m.
    patience_s
        Maximum time of waiting for an obstacle to leave, and for a tilt cycle, s.
    """

    footprint: Footprint
    limits: SpeedLimits
    height: float
    latency_s: float
    margin: float
    patience_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Goal of an approach.

    Attributes
    ----------
    target
        The surface, in map.
    gap
        Distance between the footprint and the edge, m.
    staging
        Length of the final straight motion to the edge, m.
    max_distance
        Maximum horizontal distance of the spot from the base's origin, m.
    spot
        float64 (2,), position that the arm must get to, in map; it moves with the surface. None:
        any.
    side
        Direction from the surface's middle to the wanted side, in its own frame, rad; None: any.
    """

    target: Target
    gap: float
    staging: float
    max_distance: float
    spot: Float64 | None = None
    side: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """The map around a surface.

    Attributes
    ----------
    grid
        Occupancy, in map.
    overhangs
        Outlines (N, 2 or 3) of all other furniture, in map.
    same_height
        Outlines of other surfaces at the height of this one.
    """

    grid: OccupancyGrid
    overhangs: list[Float64] = field(default_factory=list)
    same_height: list[Float64] = field(default_factory=list)
