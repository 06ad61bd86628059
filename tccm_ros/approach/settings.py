"""What an approach is asked for, and the robot and world that it is asked in."""

from __future__ import annotations

from dataclasses import dataclass, field

from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.speeds import Limits
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.slam.occupancy import OccupancyGrid


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """The base.

    Attributes
    ----------
    footprint, limits
        Its outline and speeds.
    height
        Of the robot, m: what is higher is not in its way.
    latency_s
        Between a command and the motion that it makes, s.
    margin
        Distance to keep from all but the surface that is approached, m.
    patience_s
        How long something in the way, and a tilt cycle, are waited for, s.
    """

    footprint: Footprint
    limits: Limits
    height: float
    latency_s: float
    margin: float
    patience_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Where the base is wanted.

    Attributes
    ----------
    target
        The surface, in map.
    gap
        Between the footprint and the edge, m.
    staging
        Length of the straight way up to the edge, m.
    max_distance
        Greatest horizontal distance of the spot from the base's origin, m.
    spot
        float64 (2,), what the arm is to get to, in map; it moves with the surface. None: any.
    side
        Direction from the surface's middle to the side to stand at, in its own frame, rad; None:
        any.
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
