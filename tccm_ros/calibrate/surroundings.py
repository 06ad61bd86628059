"""Search for the planes of buildings: one floor, a ceiling per bag, and walls at each place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.calibrate.recording import evenly

FLOOR, CEILING, FIRST_WALL, NO_PLANE = 0, 1, 2, -1
"""Numbers of planes; walls are numbered from `FIRST_WALL`."""

LOOSE_ANGLE = np.deg2rad(12.0)
"""Maximum angle of patches of floor, ceiling and walls to horizontal and vertical, rad (chosen)."""

BIN, SMOOTH = 0.04, 3
"""Height bins for floor and ceiling, m, and half the number of bins in a sum (chosen)."""

FLOOR_FRACTION = 0.2
"""The floor is the lowest height with at least this fraction of the patches of the most frequent
height (chosen: tables may have more patches than the floor)."""

MIN_HORIZONTAL, MIN_WALL = 12, 14
"""Minimum number of patches of floor or ceiling, and of a wall (chosen)."""

WALL_DISTANCE, WALL_ANGLE = 0.10, np.deg2rad(9.0)
"""Maximum distance (m) and angle (rad) of a wall's patches to its plane (chosen)."""

CORNER = 0.08
"""Hits this close to a second plane are assigned to neither, m (chosen: at the foot of a wall,
gates of 3 cm would assign the lowest hits on the wall to the floor, all of them too high)."""

MAX_WALLS, TRIED = 8, 200
"""Maximum number of walls at one place, and of candidate patches per wall (chosen: computing
time)."""


@dataclass(frozen=True, slots=True)
class WallPlane:
    """A vertical plane at a place: x cos phi + y sin phi = rho.

    Attributes
    ----------
    place
        Number of the place in whose frame it is.
    phi
        Direction of the normal, towards the laser, rad.
    rho
        Distance along the normal, m.
    """

    place: int
    phi: float
    rho: float


@dataclass(frozen=True, slots=True)
class RoomPlanes:
    """The planes of floor, ceilings and walls.

    Attributes
    ----------
    floor
        Height of the floor, m; None without one.
    ceilings
        Height of the ceiling of each bag, m; None without one.
    walls
        Walls of all places.
    """

    floor: float | None
    ceilings: tuple[float | None, ...]
    walls: tuple[WallPlane, ...]


def find_planes(
    centers: Float64, normals: Float64, places: Int64, bag: Int64, laser_z: float
) -> RoomPlanes:
    """Find floor, ceiling and walls among patches.

    Parameters
    ----------
    centers, normals
        float64 (P, 3), relative to each patch's place; normals towards the laser.
    places
        int64 (P,), the place of each patch.
    bag
        int64 (places,), bag of each place. Rooms of different bags may have different ceilings; the
        floor has one height, as the base stands on it.
    laser_z
        Height of the laser, m: the floor is below it, the ceiling above.
    """
    z, up = centers[:, 2], normals[:, 2]
    min_up = np.cos(LOOSE_ANGLE)
    of_bag, faces_down = bag[places], (up < -min_up) & (z > laser_z)
    walls = [
        wall
        for place in np.unique(places).tolist()
        for wall in _walls(centers, normals, (places == place), place)
    ]
    return RoomPlanes(
        _horizontal(z[(up > min_up) & (z < laser_z)], lowest=True),
        tuple(
            _horizontal(z[faces_down & (of_bag == number)], lowest=False)
            for number in range(int(bag.max()) + 1)
        ),
        tuple(walls),
    )


def _horizontal(z: Float64, *, lowest: bool) -> float | None:
    """Return the height with the most patches, or the lowest with enough of them; None for none."""
    if len(z) < MIN_HORIZONTAL:
        return None
    low = float(z.min())
    counts = np.bincount(((z - low) / BIN).astype(np.int64), minlength=1).astype(float)
    smooth = np.convolve(counts, np.ones(2 * SMOOTH + 1), "same")
    if smooth.max() < MIN_HORIZONTAL:
        return None
    at = int(np.argmax(smooth))
    if lowest:
        enough = np.flatnonzero(smooth >= max(FLOOR_FRACTION * smooth.max(), MIN_HORIZONTAL))
        first = int(enough[0])
        at = first + int(np.argmax(smooth[first : first + 2 * SMOOTH + 1]))
    near = np.abs(z - (low + (at + 0.5) * BIN)) < (SMOOTH + 0.5) * BIN
    return float(np.median(z[near]))


def _walls(centers: Float64, normals: Float64, mine: Bool, place: int) -> Sequence[WallPlane]:
    left = np.flatnonzero(mine & (np.abs(normals[:, 2]) < np.sin(LOOSE_ANGLE)))
    walls: list[WallPlane] = []
    while len(left) >= MIN_WALL and len(walls) < MAX_WALLS:
        flat = normals[left, :2] / np.linalg.norm(normals[left, :2], axis=1, keepdims=True)
        xy = centers[left, :2]
        tried = evenly(len(left), TRIED)
        distance = np.abs(flat[tried] @ xy.T - np.sum(flat[tried] * xy[tried], axis=1)[:, None])
        same = (distance < WALL_DISTANCE) & (flat[tried] @ flat.T > np.cos(WALL_ANGLE))
        best = int(np.argmax(same.sum(axis=1)))
        members = same[best]
        if members.sum() < MIN_WALL:
            break
        mean = flat[members].mean(axis=0)
        phi = float(np.arctan2(mean[1], mean[0]))
        rho = float(np.median(xy[members] @ [np.cos(phi), np.sin(phi)]))
        walls.append(WallPlane(place, phi, rho))
        left = left[~members]
    return walls


def near_another(
    points: Float64, places: Int64, plane: Int64, planes: tuple[Float64, Float64, Int64, Int64]
) -> Bool:
    """Return a mask of the hits near a second plane: in a corner, the assignment is ambiguous.

    Parameters
    ----------
    points, places, plane
        float64 (N, 3), m; int64 (N,), place and plane number of each.
    planes
        As in `assign`.
    """
    result = np.zeros(len(points), bool)
    for normal, offset, number, where in zip(*planes):
        near = np.abs(points @ normal - offset) < CORNER
        result |= near & (plane != number) & ((where == -1) | (where == places))
    return result


def assign(
    centers: Float64,
    normals: Float64,
    places: Int64,
    spread: Float64,
    planes: tuple[Float64, Float64, Int64, Int64],
    gates: tuple[float, float],
) -> Int64:
    """Return the plane number of each patch, `NO_PLANE` if none is near and parallel enough.

    Parameters
    ----------
    centers, normals, places
        As in `find_planes`.
    spread
        float64 (P,), rad, standard deviation of the normals.
    planes
        Normals float64 (Q, 3) towards the laser, offsets float64 (Q,), numbers int64 (Q,), and
        places int64 (Q,), -1 for planes visible from all places.
    gates
        Maximum distance, m, and angle, rad.
    """
    n, d, numbers, where = planes
    distance = np.abs(centers @ n.T - d)
    angle = np.arccos(np.clip(normals @ n.T, -1.0, 1.0))
    ok = (distance < gates[0]) & (angle < gates[1] + 2.0 * spread[:, None])
    ok &= (where == -1) | (where == places[:, None])
    cost = np.where(ok, distance, np.inf)
    best = np.argmin(cost, axis=1)
    found = np.isfinite(cost[np.arange(len(best)), best])
    return np.where(found, numbers[best], NO_PLANE)
