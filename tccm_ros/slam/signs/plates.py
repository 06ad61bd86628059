"""Size and tilt of a plate on its wall, and their limits for door signs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64

HEIGHTS_M = (0.8, 2.4)
"""Minimum and maximum height of the middle of a door sign above z = 0 of the base frame, m (chosen:
signs are read by standing people)."""

SIZES_M = (0.02, 0.6)
"""Minimum and maximum length of the longer side of the text on a plate, m. Plates are 4 to 60 cm
long; a digit fills half of the smallest."""

MAX_TILT = 0.26
"""Maximum angle between the lines of a sign and the horizontal, rad. Chosen: 15 deg, several times
the error of a line's edges."""

MIN_COSINE = 0.2
"""Minimum cosine of the angle between a ray and the normal of a wall for an intersection
(chosen)."""


class PlateOnWall(NamedTuple):
    """Size and tilt of the text on a plate, in the plane of the wall.

    Attributes
    ----------
    size
        float64 (2,), width and height, m; NaN where unknown.
    tilt
        Angle of its lines to the horizontal, 0 to pi, rad; NaN where unknown.
    """

    size: Float64
    tilt: float


def plate_on_wall(
    position: Float64, normal: Float64, origins: Float64, corners: Float64
) -> PlateOnWall:
    """Return the medians over views of a plate's size and tilt on a vertical wall.

    Parameters
    ----------
    position, normal
        float64 (3,) each, of the sign in map: m, and horizontal unit vector towards the reader.
    origins
        float64 (N, 3), positions of the cameras in map.
    corners
        float64 (N, 4, 3), unit vectors from the cameras to the corners of the plate: top left, top
        right, bottom right, bottom left; NaN where unknown.
    """
    towards = -(corners @ normal)
    depth = (origins - position) @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        corners_3d = origins[:, None] + (depth[:, None] / towards)[..., None] * corners
    corners_3d = corners_3d[(towards > MIN_COSINE).all(axis=1)]
    if not len(corners_3d):
        return PlateOnWall(np.full(2, np.nan), np.nan)
    right = np.cross(-normal, [0.0, 0.0, 1.0])
    across = 0.5 * (corners_3d[:, 1] - corners_3d[:, 0] + corners_3d[:, 2] - corners_3d[:, 3])
    down = 0.5 * (corners_3d[:, 3] - corners_3d[:, 0] + corners_3d[:, 2] - corners_3d[:, 1])
    lengths = np.linalg.norm([across, down], axis=2)
    tilt = np.arctan2(np.abs(across[:, 2]), across @ right)
    return PlateOnWall(np.median(lengths, axis=1), float(np.median(tilt)))


def misplacement(position: Float64, plate: PlateOnWall) -> str:
    """Return why height, size or tilt exclude a door sign; empty where they do not.

    Parameters
    ----------
    position
        float64 (3,), in map, m.
    plate
        Size and tilt of the plate.
    """
    z, size = float(position[2]), float(plate.size.max())
    if not HEIGHTS_M[0] <= z <= HEIGHTS_M[1]:
        return f"at a height of {z:.2f} m"
    if size < SIZES_M[0] or size > SIZES_M[1]:
        return f"{100.0 * size:.0f} cm long"
    if plate.tilt > MAX_TILT:
        return f"its lines are at {np.degrees(plate.tilt):.0f} deg to the horizontal"
    return ""
