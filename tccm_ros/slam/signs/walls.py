"""Walls of door signs, and occlusion of signs by walls."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.slam.walls.association import WallTable

MAX_WALL_DISTANCE = 0.15
"""Maximum distance (m) of a sign from its wall. Chosen: plates stand out from the wall, and a
triangulated point has an error of centimetres."""

MAX_BEYOND_END = 0.3
"""Maximum distance (m) of a sign from the observed part of its wall, along the wall (chosen: the
width beside a door's frame)."""

MIN_BEHIND = 0.3
"""Distance (m) of a point behind a wall facing its cameras from which it is a reflection. Chosen:
more than the errors of triangulation and of the association with a wall."""


def wall_of_sign(position: Float64, origin: Float64, walls: WallTable) -> int:
    """Return the index of the nearest wall that a sign may be fixed to, -1 for none.

    Parameters
    ----------
    position
        float64 (3,), of the sign in map.
    origin
        float64 (3,), position of the observer: a wall has one side.
    walls
        Walls in map.
    """
    if not len(walls):
        return -1
    distance = np.abs(_beyond(position, walls))
    fits = (distance < MAX_WALL_DISTANCE) & (_beyond(origin, walls) < 0.0)
    fits &= _is_within(position, walls, MAX_BEYOND_END)
    return int(np.argmin(np.where(fits, distance, np.inf))) if fits.any() else -1


def is_behind_wall(position: Float64, origins: Float64, walls: WallTable) -> bool:
    """Return whether most cameras see a point through a wall, as a reflection in it.

    Parameters
    ----------
    position
        float64 (3,), in map.
    origins
        float64 (N, 3), positions of the cameras.
    walls
        Walls in map.
    """
    is_behind = _beyond(position, walls) > MIN_BEHIND
    crossed = [bool((_crosses(x, position, walls) & is_behind).any()) for x in origins]
    return 2 * sum(crossed) > len(origins)


def is_hidden(position: Float64, origins: Float64, walls: WallTable) -> Bool:
    """Return a mask of the cameras from which a wall of the map occludes a sign, bool (N,).

    Parameters
    ----------
    position
        float64 (3,), of the sign in map; its own wall, within `MAX_WALL_DISTANCE`, is ignored.
    origins
        float64 (N, 3), positions of the cameras.
    walls
        Walls in map.
    """
    is_other = np.abs(_beyond(position, walls)) > MAX_WALL_DISTANCE
    hidden = [(_crosses(origin, position, walls) & is_other).any() for origin in origins]
    return np.array(hidden, bool)


def _crosses(start: Float64, end: Float64, walls: WallTable) -> Bool:
    """Return whether the way between two points (3,) crosses each wall, bool (W,)."""
    before, behind = _beyond(start, walls), _beyond(end, walls)
    is_crossed = before * behind < 0.0
    fraction = before / np.where(is_crossed, before - behind, np.inf)
    return is_crossed & _is_within(start + fraction[:, None] * (end - start), walls, 0.0)


def _beyond(point: Float64, walls: WallTable) -> Float64:
    """Return the distance of a point (3,) behind each wall, seen from its observers, (W,)."""
    return np.asarray(point[0] * np.cos(walls.phi) + point[1] * np.sin(walls.phi) - walls.rho)


def _is_within(points: Float64, walls: WallTable, margin: float) -> Bool:
    """Return whether points (3,) or (W, 3) are within the extent of each wall, bool (W,)."""
    along = -points[..., 0] * np.sin(walls.phi) + points[..., 1] * np.cos(walls.phi)
    low, high = walls.extent[:, 0] - margin, walls.extent[:, 1] + margin
    return np.asarray((along >= low) & (along <= high))
