"""Level scans for matching: planar points at one time, thinned, with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import planar
from tccm_ros.kernels import kernel
from tccm_ros.records import PosedScan
from tccm_ros.sensors.laser_scan import project_level

THIN_DISTANCE = 0.04
"""Beams closer than this (m) along a scan are averaged (chosen: about twice the noise of a
range)."""

NORMAL_BEAMS = 3
"""Neighbours on either side that a normal is fitted to at first (chosen)."""

WIDTHS = (1, 2, 4)
"""Factors on the neighbourhood of a normal, tried in turn: noise hides the direction of a short
piece of wall, a longer one shows it (chosen)."""

SEARCH_POINTS = 100
"""Approximate number of points that a search scores (chosen)."""

MIN_RADIUS = 0.15
"""Minimum radius (m) of the neighbourhood of a normal, whatever the spacing of the beams
(chosen)."""

MAX_RADIUS = 0.8
"""Maximum radius (m) of the neighbourhood of a normal (chosen)."""

RADIUS_BEAMS = 4.0
"""Radius of the neighbourhood, in distances between beams (chosen)."""

MIN_NEIGHBOURS = 3
"""Points that a normal is fitted to at least. Chosen: one more than a line through two has."""

FLATNESS = 0.2
"""Largest ratio of a neighbourhood's thickness to its length that still has a normal (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class LevelScan:
    """Planar points in the base frame of the scan's stamp.

    Attributes
    ----------
    stamp_ns
        Time of the first beam.
    odom
        float64 (3,), base in odom at the stamp.
    beams
        float64 (B, 2), m, in beam order: one point for each valid beam.
    origin
        float64 (2,), where the laser was at the stamp.
    points, normals
        float64 (N, 2): the beams averaged over 4 cm, and unit normals towards the laser, zero
        where the surroundings are not flat.
    has_odometry
        Whether odometry or tf tells how the base moves.
    """

    stamp_ns: int
    odom: Float64
    beams: Float64
    origin: Float64
    points: Float64
    normals: Float64
    has_odometry: bool = True

    @property
    def search_points(self) -> Float64:
        """About `SEARCH_POINTS` of the points, evenly spread."""
        return self.points[:: 1 + len(self.points) // SEARCH_POINTS]


def make_level_scan(posed: PosedScan, config: Config) -> LevelScan:
    """Project a level scan, each beam by the poses of its own time."""
    beams, _ = project_level(posed, config)
    at_stamp = 0 if posed.pose_stamps_ns[0] == posed.scan.stamp_ns else -1
    origin = posed.T_base_laser[at_stamp, :2, 3].copy()
    points, normals = thin_with_normals(beams, origin, abs(posed.scan.angle_increment))
    odom = planar(posed.T_odom_base[at_stamp])
    return LevelScan(posed.scan.stamp_ns, odom, beams, origin, points, normals, posed.has_odometry)


@kernel
def thin_with_normals(
    beams: Float64, origin: Float64, step: float
) -> tuple[Float64, Float64]:  # pragma: no cover - compiled
    """Average beams over 4 cm and fit a normal to the neighbours of each mean.

    Parameters
    ----------
    beams
        float64 (B, 2), m, in beam order.
    origin
        float64 (2,), the laser; normals point to its side.
    step
        Angle between beams, rad: the spacing of points grows with their range.

    Returns
    -------
    Points and unit normals, float64 (N, 2) each; zero where the surroundings are not flat
    """
    points = np.empty((len(beams), 2))
    count = 0
    i = 0
    while i < len(beams):
        j, sx, sy = i, 0.0, 0.0
        while j < len(beams):
            dx, dy = beams[j, 0] - beams[i, 0], beams[j, 1] - beams[i, 1]
            if dx * dx + dy * dy >= THIN_DISTANCE * THIN_DISTANCE:
                break
            sx, sy, j = sx + beams[j, 0], sy + beams[j, 1], j + 1
        points[count, 0], points[count, 1] = sx / (j - i), sy / (j - i)
        count, i = count + 1, j
    points = points[:count].copy()
    normals = np.zeros((count, 2))
    for i in range(count):
        for times in WIDTHS:
            if _fit_normal(points, i, origin, step, times, normals):
                break
    return points, normals


@kernel
def _fit_normal(
    points: Float64, i: int, origin: Float64, step: float, times: int, normals: Float64
) -> bool:  # pragma: no cover - compiled
    """Write the normal of point i and return True, if a neighbourhood `times` as large is flat."""
    rx, ry = points[i, 0] - origin[0], points[i, 1] - origin[1]
    spacing = np.sqrt(rx * rx + ry * ry) * step
    radius = min(times * max(MIN_RADIUS, RADIUS_BEAMS * spacing), MAX_RADIUS)
    sx = sy = sxx = sxy = syy = 0.0
    n = 0
    for side in (-1, 1):
        j = i if side < 0 else i + 1
        for _ in range(times * NORMAL_BEAMS + (1 if side < 0 else 0)):
            if j < 0 or j >= len(points):
                break
            x, y = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            if x * x + y * y > radius * radius:
                break
            sx, sy, n = sx + x, sy + y, n + 1
            sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
            j += side
    if n < MIN_NEIGHBOURS:
        return False
    sx, sy = sx / n, sy / n
    a, b, c = sxx / n - sx * sx, sxy / n - sx * sy, syy / n - sy * sy
    mid, half = 0.5 * (a + c), np.sqrt(0.25 * (a - c) ** 2 + b * b)
    if mid - half > FLATNESS * FLATNESS * (mid + half):
        return False
    angle = 0.5 * np.arctan2(2.0 * b, a - c) + 0.5 * np.pi
    nx, ny = np.cos(angle), np.sin(angle)
    sign = -1.0 if nx * rx + ny * ry > 0.0 else 1.0
    normals[i, 0], normals[i, 1] = sign * nx, sign * ny
    return True
