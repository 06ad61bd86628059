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
from tccm_ros.slam.base_attitude import LEVEL, Attitude, attitude_of

THIN_DISTANCE = 0.04
"""Beams closer than this (m) along a scan are averaged (chosen: about twice the range noise)."""

NORMAL_BEAMS = 3
"""Initial number of neighbours on either side for a normal (chosen)."""

WIDTHS = (1, 2, 4)
"""Factors on the neighbourhood of a normal, tried in order: noise masks the direction of a short
piece of wall, but not of a longer one (chosen)."""

SEARCH_POINTS = 100
"""Approximate number of points in a correlative search (chosen)."""

MIN_RADIUS = 0.15
"""Minimum radius (m) of the neighbourhood of a normal (chosen)."""

MAX_RADIUS = 0.8
"""Maximum radius (m) of the neighbourhood of a normal (chosen)."""

RADIUS_BEAMS = 4.0
"""Radius of the neighbourhood, in spacings of the beams (chosen)."""

MIN_NEIGHBOURS = 3
"""Minimum number of points for a normal. Chosen: one more than defines a line."""

FLATNESS = 0.2
"""Maximum ratio of thickness to length of a neighbourhood with a normal (chosen)."""


MIN_OFFSET = 0.2
"""Minimum distance of the laser (m) from the line of an observed surface (chosen)."""

ADJACENT_BEAMS = 2.5
"""Points within this number of beam steps are adjacent: one beam between them may be missing
(chosen)."""

MAX_GAP, MAX_BEND = 5.0, 0.05
"""Limits of a sparse surface at a small viewing angle: maximum distance between its points (m), and
maximum distance of the middle of three points from their chord, m (chosen: two standard deviations
of a noisy laser)."""


PROJECTED_SIGMA = 0.03
"""Noise (m) of a point of a level scan made from points of many heights: a mean over 6 to 12 cm of
range, of the furniture in view (figures in docs/design/experiments/wall_slam.md)."""


@dataclass(frozen=True, slots=True, eq=False)
class LevelScan:
    """Planar points of a level scan in the base frame at its stamp.

    Attributes
    ----------
    stamp_ns
        Stamp: time of the first beam.
    odom
        float64 (3,), pose of the base in odom at the stamp.
    beams
        float64 (B, 2), m, in beam order: one point per valid beam.
    origin
        float64 (2,), position of the laser at the stamp.
    points, normals
        float64 (N, 2): the beams averaged over 4 cm, and unit normals towards the laser, zero where
        the neighbourhood is not flat. Isolated samples of a surface are left out (see
        `thin_with_normals`).
    has_odometry
        Whether odometry or tf gives the motion of the base.
    heading
        Integrated gyroscope yaw of the base, rad, with an arbitrary zero; None without one.
    attitude
        Height, roll and pitch of the base in odom at the stamp.
    """

    stamp_ns: int
    odom: Float64
    beams: Float64
    origin: Float64
    points: Float64
    normals: Float64
    has_odometry: bool = True
    heading: float | None = None
    attitude: Attitude = LEVEL

    @property
    def search_points(self) -> Float64:
        """About `SEARCH_POINTS` of the points, evenly spaced."""
        return self.points[:: 1 + len(self.points) // SEARCH_POINTS]


def point_sigma(config: Config) -> float:
    """Return the noise (m) of a point of a level scan of a laser, or of `sensors.level_from`."""
    is_projected = config.sensors.level_from != "none"
    return max(config.matching.range_sigma, PROJECTED_SIGMA if is_projected else 0.0)


def make_level_scan(posed: PosedScan, config: Config) -> LevelScan:
    """Return a level scan, with each beam projected by the pose at its own time."""
    beams, _ = project_level(posed, config)
    at_stamp = 0 if posed.pose_stamps_ns[0] == posed.scan.stamp_ns else -1
    origin = posed.T_base_laser[at_stamp, :2, 3].copy()
    points, normals = thin_with_normals(beams, origin, abs(posed.scan.angle_increment))
    odom = planar(posed.T_odom_base[at_stamp])
    return LevelScan(
        posed.scan.stamp_ns,
        odom,
        beams,
        origin,
        points,
        normals,
        posed.has_odometry,
        posed.heading,
        attitude_of(posed.T_odom_base[at_stamp]),
    )


@kernel
def thin_with_normals(beams: Float64, origin: Float64, step: float) -> tuple[Float64, Float64]:
    """Return beams averaged over 4 cm, and a normal fitted to the neighbours of each mean.

    A point without neighbours is a small object if the adjacent beams hit surfaces behind it.
    Otherwise it is a single sample of a surface at a small viewing angle, or the edge of an
    occluding surface: its position along the surface is determined by the beam, and moves with the
    robot. It gets the normal of the line through adjacent points; without such a line, it is left
    out.

    Parameters
    ----------
    beams
        float64 (B, 2), m, in beam order.
    origin
        float64 (2,), position of the laser; normals point to its side.
    step
        Angle between beams, rad; the spacing of points is proportional to range.

    Returns
    -------
    Points and unit normals, float64 (N, 2) each; normals of corners and small objects are zero
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
    kept = np.ones(count, np.bool_)
    for i in range(count):
        for times in WIDTHS:
            if _fit_normal(points, i, origin, step, times, normals):
                break
        else:
            if _is_sample_of_surface(points, i, origin, step):
                kept[i] = _fit_sparse_normal(points, i, origin, normals)
    return points[kept], normals[kept]


@kernel
def _is_sample_of_surface(points: Float64, i: int, origin: Float64, step: float) -> bool:
    """Return whether point i has few neighbours, but no farther hits (or none) on both sides."""
    rx, ry = points[i, 0] - origin[0], points[i, 1] - origin[1]
    radius = _radius(np.hypot(rx, ry) * step, 1)
    count, behind = 1, 0
    for side in (-1, 1):
        j = i
        while 0 <= j + side < len(points) and count < MIN_NEIGHBOURS:
            dx, dy = points[j + side, 0] - points[j, 0], points[j + side, 1] - points[j, 1]
            if dx * dx + dy * dy > radius * radius:
                break
            j, count = j + side, count + 1
        behind += _is_before(points, j, j + side, origin, step, radius)
    return count < MIN_NEIGHBOURS and behind < 2


@kernel
def _is_before(
    points: Float64, i: int, j: int, origin: Float64, step: float, radius: float
) -> bool:
    """Return whether the adjacent beam of point i hits a farther point j, or nothing."""
    if j < 0 or j >= len(points):
        return True
    ax, ay = points[i, 0] - origin[0], points[i, 1] - origin[1]
    bx, by = points[j, 0] - origin[0], points[j, 1] - origin[1]
    angle = abs(np.arctan2(ax * by - ay * bx, ax * bx + ay * by))
    # Near points are means of several beams.
    adjacent = ADJACENT_BEAMS * step + THIN_DISTANCE / min(np.hypot(ax, ay), np.hypot(bx, by))
    return bool(angle > adjacent or np.hypot(bx, by) > np.hypot(ax, ay) + radius)


@kernel
def _fit_sparse_normal(points: Float64, i: int, origin: Float64, normals: Float64) -> bool:
    """Write the normal of a line through point i and two others; return whether there is one."""
    for first in (i - 1, i - 2, i):
        if first < 0 or first + 2 >= len(points):
            continue
        a, m, b = points[first], points[first + 1], points[first + 2]
        if max(np.hypot(m[0] - a[0], m[1] - a[1]), np.hypot(b[0] - m[0], b[1] - m[1])) > MAX_GAP:
            continue
        dx, dy = b[0] - a[0], b[1] - a[1]
        length = np.hypot(dx, dy)
        forward = (m[0] - a[0]) * dx + (m[1] - a[1]) * dy
        bend = (m[0] - a[0]) * dy - (m[1] - a[1]) * dx
        if not 0.0 < forward < length * length or abs(bend) > MAX_BEND * length:
            continue
        # An edge of an occlusion, a mixed pixel and the background are in line with the laser.
        if abs((a[0] - origin[0]) * dy - (a[1] - origin[1]) * dx) < MIN_OFFSET * length:
            continue
        write_normal(points, i, origin, -dy / length, dx / length, normals)
        return True
    return False


@kernel
def _radius(spacing: float, times: int) -> float:
    """Return the radius of a neighbourhood for a point spacing."""
    return min(times * max(MIN_RADIUS, RADIUS_BEAMS * spacing), MAX_RADIUS)


@kernel
def write_normal(
    points: Float64, i: int, origin: Float64, nx: float, ny: float, normals: Float64
) -> None:
    """Write the unit normal of point i, oriented towards the laser."""
    away = nx * (points[i, 0] - origin[0]) + ny * (points[i, 1] - origin[1])
    sign = -1.0 if away > 0.0 else 1.0
    normals[i, 0], normals[i, 1] = sign * nx, sign * ny


@kernel
def _fit_normal(
    points: Float64, i: int, origin: Float64, step: float, times: int, normals: Float64
) -> bool:
    """Write the normal of point i; return whether its neighbourhood, scaled by `times`, is flat."""
    rx, ry = points[i, 0] - origin[0], points[i, 1] - origin[1]
    radius = _radius(np.sqrt(rx * rx + ry * ry) * step, times)
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
    thick, long, nx, ny = principal_axes(n, sx, sy, sxx, sxy, syy)
    if thick > FLATNESS * FLATNESS * long:
        return False
    write_normal(points, i, origin, nx, ny, normals)
    return True


@kernel
def principal_axes(
    n: float, sx: float, sy: float, sxx: float, sxy: float, syy: float
) -> tuple[float, float, float, float]:
    """Return the variances across and along the line of n points, and its unit normal.

    The arguments are the number of points, the sums of their coordinates, and those of products.
    """
    sx, sy = sx / n, sy / n
    a, b, c = sxx / n - sx * sx, sxy / n - sx * sy, syy / n - sy * sy
    mid, half = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
    angle = 0.5 * np.arctan2(2.0 * b, a - c) + 0.5 * np.pi
    return mid - half, mid + half, np.cos(angle), np.sin(angle)
