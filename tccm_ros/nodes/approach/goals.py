"""Conversion and validation of the goal messages of approach_node, in the map's frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from shapely import Point

from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.settings import Goal, RobotBase, Surroundings
from tccm_ros.approach.speeds import SpeedLimits
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.errors import MotionError
from tccm_ros.geometry import planar
from tccm_ros.ros.map_records import MapSurface
from tccm_ros.slam.occupancy import OccupancyGrid

MAX_GAP_M, MAX_DISTANCE_M, MAX_BACK_M = 1.0, 3.0, 2.0
"""Maximum values of gap, reach and retreat in a goal, m. Chosen: no arm is longer."""

MIN_GAP_M = 0.02
"""Minimum gap, m: the specified accuracy of a gap."""

SAME_HEIGHT_M = 0.03
"""Surfaces that differ less in height may be confused, m (`locating.HEIGHT_M`)."""


def robot_of(config: Config, corners: Sequence[float] = ()) -> RobotBase:
    """Return the base from the parameters, or with another footprint.

    Raises
    ------
    MotionError
        For corners that do not form a footprint, see `Footprint.of`.
    """
    s = config.approach
    limits = SpeedLimits(s.speed, s.yaw_rate, s.acceleration, s.yaw_acceleration)
    footprint = Footprint.of(list(corners) or s.footprint)
    return RobotBase(footprint, limits, s.height, s.latency, s.margin, s.patience)


def checked(name: str, value: float, default: float, low: float, high: float) -> float:
    """Return a value of a goal, m, or the default where it is 0.

    Raises
    ------
    MotionError
        For a value outside [low, high], and nan.
    """
    if value == 0.0:
        return default
    if not low <= value <= high:
        raise MotionError(f"{name} is {value:g} m; expected {low:g} to {high:g} m, or 0")
    return value


def goal_of(
    request: Any,
    surface: MapSurface,
    config: Config,
    in_map: Callable[[Any], Float64],
) -> Goal:
    """Return the `Goal` of an ApproachSurface request.

    Parameters
    ----------
    request
        The action's goal.
    surface
        The requested surface.
    config
        Group `approach`.
    in_map
        Returns a geometry_msgs/PointStamped as float64 (2,) in map.

    Raises
    ------
    MotionError
        For values outside their limits, and a spot that is not on the surface.
    """
    settings = config.approach
    gap = checked("gap", request.gap, settings.gap, MIN_GAP_M, MAX_GAP_M)
    max_distance = checked("reach", request.reach, settings.reach, 0.05, MAX_DISTANCE_M)
    side = None
    if request.has_side:
        if not math.isfinite(request.side):
            raise MotionError(f"side is {request.side:g}; expected an angle in rad")
        side = float(request.side)
    spot = in_map(request.spot) if request.spot.header.frame_id else None
    target = target_of(surface)
    if spot is not None:
        off = target.polygon.distance(Point(spot))
        if off > SAME_HEIGHT_M:
            raise MotionError(f"the spot is {off:.2f} m beside surface {surface.id}")
    staging = max(settings.staging_distance, 0.0)
    return Goal(target, gap, staging, max_distance if spot is not None else math.inf, spot, side)


def target_of(surface: MapSurface) -> Target:
    """Return a surface of the map as the target of an approach."""
    message = surface.message
    outline = surface.boundary[:, :2]
    is_round = message.shape == message.SHAPE_CIRCLE
    height = float(surface.T_map_surface[2, 3])
    return Target(outline, planar(surface.T_map_surface), height, is_round)


def surroundings_of(
    grid: OccupancyGrid | None, surfaces: Sequence[MapSurface], surface: MapSurface
) -> Surroundings:
    """Return the map around a surface.

    Raises
    ------
    MotionError
        If no grid has been received.
    """
    if grid is None:
        raise MotionError("where the floor is free is not known: nobody publishes 'map'")
    others = [s for s in surfaces if s.id != surface.id and s.label != "floor"]
    others = [s for s in others if not _is_above(surface, s)]
    z = float(surface.T_map_surface[2, 3])
    same = [o for o in others if abs(float(o.T_map_surface[2, 3]) - z) < SAME_HEIGHT_M]
    return Surroundings(grid, [o.boundary for o in others], [o.boundary for o in same])


def _is_above(surface: MapSurface, other: MapSurface) -> bool:
    """Return whether another surface is a board over or under this one, and so moves with it."""
    target = target_of(surface).polygon
    middle = other.boundary[:, :2].mean(axis=0)
    return bool(target.contains(Point(middle)))


def grid_of(message: Any) -> OccupancyGrid:
    """Return a nav_msgs/OccupancyGrid.

    Raises
    ------
    MotionError
        If the grid is rotated against its frame, or its sizes are inconsistent.
    """
    info, origin = message.info, message.info.origin
    if abs(origin.orientation.z) > 1e-3:
        raise MotionError("the grid on 'map' is turned against its frame; publish it straight")
    data = np.asarray(message.data, np.int8)
    if len(data) != info.width * info.height or not info.resolution > 0.0:
        raise MotionError(
            f"the grid on 'map' has {len(data)} cells, expected {info.width} x {info.height}"
        )
    cells = data.reshape(info.height, info.width)
    return OccupancyGrid(
        cells, float(info.resolution), np.array([origin.position.x, origin.position.y])
    )
