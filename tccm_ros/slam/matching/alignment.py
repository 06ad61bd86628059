"""Point-to-line alignment of a scan with a local map, from an approximate pose.

`agreement` rates a result by the surfaces that the scan hits, minus those that it sees through.
People who walk along with the robot keep their relative position, so that a match with them
suggests a robot at rest. At the true pose, a scan sees through few surfaces of other scans; a match
with people gains little, as two keyframes hardly ever see them at the same position.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.kernels import kernel
from tccm_ros.slam.matching.buckets import BUCKET
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.matching.line_map import LineMap
from tccm_ros.slam.matching.visibility import passes_and_hits
from tccm_ros.slam.se2 import transform_points

ISOTROPIC_WEIGHT = 0.15
"""Information of a point without a normal, per direction, relative to one on a line: the position
of a hit on an object of unknown shape is known to a few centimetres only (chosen)."""

ISOTROPIC_SIGMAS = 2.0
"""Noise of a point without a normal, in standard deviations of a point on a line (chosen)."""

UNCONFIRMED_WEIGHT, MIN_CONFIRMED = 0.1, 0.5
"""Weight of points seen by a single scan of the map (such as people who walk along), if at least
this fraction of the neighbours is confirmed; in new areas all points have weight 1 (chosen)."""

MIN_INFORMATION_RATIO = 3.0
"""Minimum ratio of information to that of noise in the normals; directions below it are unobserved:
along a corridor, that noise alone looks like information (chosen)."""

MIN_INFORMATION = (1.0 / 0.3**2, 1.0 / 0.3**2)
"""Information (1/m^2, 1/rad^2) added to that of noise: a match with an uncertainty of more than 0.2
m or 0.2 rad is not informative (chosen)."""

RADIUS_SHRINK, MIN_RADIUS_SIGMAS = 0.7, 6.0
"""Factor on the search radius for neighbours per step, and its minimum, in sigma (chosen)."""

CAUCHY_SIGMAS = 2.0
"""Scale of the robust (Cauchy) weight, in standard deviations (chosen)."""

MIN_FACING_COSINE = -0.1
"""Cosine between the normals of a point and its neighbour below which they face opposite sides
(chosen)."""

RIDGE = (1e-6, 1e-9)
"""Ridge of the normal equations: relative to the trace, and absolute (chosen)."""

MAX_STEPS = 25
"""Maximum number of Gauss-Newton steps (chosen)."""

CONVERGED_STEP = 1e-5
"""Step (m, rad) below which the alignment ends: a hundredth of the noise of a result (chosen)."""


class Alignment(NamedTuple):
    """The result of `align`.

    Attributes
    ----------
    pose
        float64 (3,), pose of the scan in the map.
    information
        float64 (3, 3) of (x, y, yaw), x and y along the map's axes, without the prior. Zero in
        directions where the map gives no more information than noise.
    inliers
        Fraction of the scan's points with a neighbour in the map, 0..1.
    confirmed
        Fraction of the scan's points whose neighbour is confirmed, 0..1.
    """

    pose: Float64
    information: Float64
    inliers: float
    confirmed: float


class Prior(NamedTuple):
    """A prior on the pose of a scan.

    Attributes
    ----------
    pose
        float64 (3,), (x, y, yaw) in the map, m and rad.
    information
        float64 (3, 3), inverse covariance of (x, y, yaw) along the map's axes.
    """

    pose: Float64
    information: Float64


def align(
    line_map: LineMap,
    points: Float64,
    normals: Float64,
    start: Float64,
    sigma: float,
    prior: Prior | None = None,
) -> Alignment:
    """Align a scan by robust Gauss-Newton on point-to-line distances.

    The search radius for neighbours starts at a bucket's edge and shrinks to six sigma.

    Parameters
    ----------
    line_map
        The map.
    points, normals
        float64 (N, 2), points and normals of the scan, in the base frame.
    start
        float64 (3,), initial pose in the map.
    sigma
        Noise of the distance of a point to a line, m.
    prior
        Prior from odometry; None for no prior.

    Returns
    -------
    Alignment
        The pose after the last step; the prior's or `start` if no point has a neighbour.
    """
    start = np.asarray(start, float)
    known = prior or Prior(start, np.zeros((3, 3)))
    return Alignment(*_align(line_map, points, normals, start, float(sigma), known))


def agreement(result: Alignment, scan: LevelScan, line_map: LineMap) -> float:
    """Return how well a scan agrees with the confirmed surfaces of a map.

    Parameters
    ----------
    result
        The scan's alignment with the map.
    scan
        The scan.
    line_map
        The map.

    Returns
    -------
    float
        Fraction of the scan on confirmed surfaces, minus the fraction of confirmed surfaces in view
        that the scan sees through: -1..1.
    """
    return result.confirmed - seen_through(result.pose, scan, line_map)


def seen_through(pose: Float64, scan: LevelScan, line_map: LineMap) -> float:
    """Return the fraction of the confirmed surfaces in view that a scan sees through, 0..1.

    Parameters
    ----------
    pose
        float64 (3,), pose of the scan in the map.
    scan
        The scan.
    line_map
        The map.
    """
    passes, hits = passes_and_hits(
        line_map.points[line_map.confirmed],
        transform_points(pose, scan.origin[None]),
        np.array([len(scan.points)]),
        transform_points(pose, scan.points),
    )
    passed, hit = int(passes.sum()), int(hits.sum())
    return passed / max(passed + hit, 1)


class _Equations(NamedTuple):
    """Normal equations ``H x = -b``, float64 (3, 3) and (3,); `noise` is float64 (3, 3)."""

    H: Float64
    noise: Float64
    b: Float64


@kernel
def _align(
    line_map: LineMap, points: Float64, normals: Float64, start: Float64, sigma: float, prior: Prior
) -> tuple[Float64, Float64, float, float]:
    pose = start.copy()
    H, noise, b = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    inliers, confirmed = 0.0, 0.0
    for step in range(MAX_STEPS):
        radius = max(BUCKET * RADIUS_SHRINK**step, MIN_RADIUS_SIGMAS * sigma)
        inliers, confirmed = _normal_equations(
            line_map, points, normals, pose, sigma, radius, _Equations(H, noise, b)
        )
        _drop_noise(H, noise, b)
        A = H + prior.information
        difference = pose - prior.pose
        difference[2] = np.arctan2(np.sin(difference[2]), np.cos(difference[2]))
        g = b + prior.information @ difference
        # A small ridge stabilises directions that neither map nor odometry determine.
        for k in range(3):
            A[k, k] += RIDGE[0] * (A[0, 0] + A[1, 1] + A[2, 2]) + RIDGE[1]
        delta = -np.linalg.solve(A, g)
        pose += delta
        small = max(abs(delta[0]), abs(delta[1]), abs(delta[2])) < CONVERGED_STEP
        if small and radius <= MIN_RADIUS_SIGMAS * sigma:
            break
    pose[2] = np.arctan2(np.sin(pose[2]), np.cos(pose[2]))
    return pose, H, inliers, confirmed


@kernel
def _normal_equations(
    line_map: LineMap,
    points: Float64,
    normals: Float64,
    pose: Float64,
    sigma: float,
    radius: float,
    equations: _Equations,
) -> tuple[float, float]:
    """Add J^T W J to H and J^T W r to b; return the fractions of inliers and of confirmed inliers.

    `noise` becomes the part of H due to the standard deviation of the normals' directions: E[n n^T]
    contains their variance in the wall's own direction.
    """
    H, noise, b = equations.H, equations.noise, equations.b
    H[:], noise[:], b[:] = 0.0, 0.0, 0.0
    H1, noise1, b1 = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    J = np.empty(3)
    count, confirmed = 0, 0
    for i in range(len(points)):
        rx = c * points[i, 0] - s * points[i, 1]
        ry = s * points[i, 0] + c * points[i, 1]
        nx = c * normals[i, 0] - s * normals[i, 1]
        ny = s * normals[i, 0] + c * normals[i, 1]
        x, y = rx + pose[0], ry + pose[1]
        j = _nearest(line_map, x, y, nx, ny, radius)
        if j < 0:
            continue
        dx, dy = x - line_map.points[j, 0], y - line_map.points[j, 1]
        mx, my = line_map.normals[j, 0], line_map.normals[j, 1]
        count += 1
        G, N, g = H1, noise1, b1
        if line_map.confirmed[j]:
            G, N, g = H, noise, b
            confirmed += 1
        if mx != 0.0 or my != 0.0:
            r = mx * dx + my * dy
            J[0], J[1], J[2] = mx, my, my * rx - mx * ry
            w = _robust(r, sigma) / (sigma * sigma)
            _add(G, g, J, r, w)
            J[0], J[1], J[2] = -my, mx, mx * rx + my * ry
            _add_square(N, J, w * line_map.variances[j])
        else:
            w = (
                ISOTROPIC_WEIGHT
                * _robust(np.sqrt(dx * dx + dy * dy), ISOTROPIC_SIGMAS * sigma)
                / sigma**2
            )
            J[0], J[1], J[2] = 1.0, 0.0, -ry
            _add(G, g, J, dx, w)
            J[0], J[1], J[2] = 0.0, 1.0, rx
            _add(G, g, J, dy, w)
    weight = UNCONFIRMED_WEIGHT if confirmed >= MIN_CONFIRMED * count else 1.0
    H += weight * H1
    noise += weight * noise1
    b += weight * b1
    n = max(len(points), 1)
    return count / n, confirmed / n


@kernel
def _drop_noise(H: Float64, noise: Float64, b: Float64) -> None:
    """Remove directions in which matching has no more information than noise.

    A step in them would follow the noise, with too small a covariance. They are the eigenvectors of
    the information in units of the noise's information (Zhang and Singh, "On degeneracy of
    optimization-based state estimation problems", ICRA 2016, with the threshold in these units):
    shifts along a corridor, rotations about the centre of a round hall.
    """
    N = noise.copy()
    N[0, 0] += MIN_INFORMATION[0]
    N[1, 1] += MIN_INFORMATION[0]
    N[2, 2] += MIN_INFORMATION[1]
    if _is_positive(H - MIN_INFORMATION_RATIO * N):
        return
    L = np.linalg.cholesky(N)
    to_units = np.linalg.inv(L)
    values, vectors = np.linalg.eigh(to_units @ H @ np.ascontiguousarray(to_units.T))
    keep = np.zeros((3, 3))
    for k in range(3):
        if values[k] >= MIN_INFORMATION_RATIO:
            _add_square(keep, vectors[:, k].copy(), 1.0)
    project = L @ keep @ to_units
    H[:] = project @ H @ np.ascontiguousarray(project.T)
    b[:] = project @ b


@kernel
def _is_positive(M: Float64) -> bool:
    """Return whether a symmetric matrix (3, 3) is positive definite (Sylvester)."""
    minor = M[0, 0] * M[1, 1] - M[0, 1] * M[0, 1]
    last = M[2, 2] * minor - M[0, 2] * (M[0, 2] * M[1, 1] - M[0, 1] * M[1, 2])
    last -= M[1, 2] * (M[0, 0] * M[1, 2] - M[0, 1] * M[0, 2])
    return bool(M[0, 0] > 0.0 and minor > 0.0 and last > 0.0)


@kernel
def _add_square(M: Float64, v: Float64, w: float) -> None:
    """Add w v v^T to M."""
    for k in range(3):
        for m in range(3):
            M[k, m] += w * v[k] * v[m]


@kernel
def _robust(r: float, sigma: float) -> float:
    """Return the Cauchy weight of a residual."""
    u = r / (CAUCHY_SIGMAS * sigma)
    return 1.0 / (1.0 + u * u)


@kernel
def _add(H: Float64, b: Float64, J: Float64, r: float, w: float) -> None:
    for k in range(3):
        b[k] += w * J[k] * r
    _add_square(H, J, w)


@kernel
def _nearest(line_map: LineMap, x: float, y: float, nx: float, ny: float, radius: float) -> int:
    """Return the nearest map point within `radius` on the same face of a wall, or -1."""
    origin, starts = line_map.buckets.origin, line_map.buckets.starts
    px, py = x - origin[0], y - origin[1]
    low_x, high_x = int(np.floor((px - radius) / BUCKET)), int(np.floor((px + radius) / BUCKET))
    low_y, high_y = int(np.floor((py - radius) / BUCKET)), int(np.floor((py + radius) / BUCKET))
    best, min_d2 = -1, radius * radius
    for gx in range(max(low_x, 0), min(high_x + 1, starts.shape[0])):
        for gy in range(max(low_y, 0), min(high_y + 1, starts.shape[1])):
            for j in range(starts[gx, gy, 0], starts[gx, gy, 1]):
                dx, dy = x - line_map.points[j, 0], y - line_map.points[j, 1]
                d = dx * dx + dy * dy
                if d < min_d2:
                    dot = line_map.normals[j, 0] * nx + line_map.normals[j, 1] * ny
                    if dot > MIN_FACING_COSINE:
                        best, min_d2 = j, d
    return best
