"""Point-to-line alignment of a scan with a local map, from a start that is nearly right.

`agreement` rates a result by the surfaces that the scan hits, less those that it sees through.
People who walk along with the robot are where they were in the scan before, so that a match with
them says that the robot stands still. At the true pose, a scan sees through few surfaces that
other scans have seen, and a match with the people adds little, because two keyframes hardly ever
see them at the same position.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.kernels import kernel
from tccm_ros.slam.buckets import BUCKET
from tccm_ros.slam.level_scan import LevelScan
from tccm_ros.slam.line_map import LineMap
from tccm_ros.slam.se2 import transform_points
from tccm_ros.slam.visibility import passes_and_hits

ISOTROPIC_WEIGHT = 0.15
"""Information of a point without a normal, in each direction, relative to one on a line:
the position of a hit on an object of unknown shape is known to a few centimetres only (chosen)."""

ISOTROPIC_SIGMAS = 2.0
"""Noise of such a point, in standard deviations of a point on a line (chosen)."""

UNCONFIRMED_WEIGHT, MIN_CONFIRMED = 0.1, 0.5
"""Weight of points that a single scan of the map saw (people who walk along are among them), where
at least this fraction of the neighbours is confirmed; in new areas all points have weight 1
(chosen)."""

MIN_INFORMATION_RATIO = 3.0
"""A direction is taken as unknown where its information is less than this many times that which
noise of the normals adds: along a corridor, that noise alone looks like information (chosen)."""

RADIUS_SHRINK, MIN_RADIUS_SIGMAS = 0.7, 6.0
"""Factor on the search radius for neighbours from step to step; its minimum, in sigma (chosen)."""

CAUCHY_SIGMAS = 2.0
"""Scale of the robust (Cauchy) weight, in standard deviations (chosen)."""

MIN_FACING_COSINE = -0.1
"""Cosine between the normals of a point and its neighbour below which they face away from each
other (chosen)."""

RIDGE = (1e-6, 1e-9)
"""Added to the diagonal of the normal equations: relative to its trace, and absolute (chosen)."""

MAX_STEPS = 25
"""Gauss-Newton steps at most (chosen)."""

CONVERGED_STEP = 1e-5
"""A step (m, rad) below this ends the alignment: a hundredth of the noise of a result (chosen)."""


class Alignment(NamedTuple):
    """The outcome of `align`.

    Attributes
    ----------
    pose
        float64 (3,), of the scan in the map.
    information
        float64 (3, 3) of (x, y, yaw): x, y along the map's axes; the prior not included. It is
        zero in a direction in which the map has no more than noise would give.
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
    """Align a scan by robust Gauss-Newton steps on point-to-line distances.

    A neighbour may be as far as the edge of a bucket at first; this narrows to six sigma.

    Parameters
    ----------
    line_map
        The map.
    points, normals
        float64 (N, 2), of the scan, in the base frame.
    start
        float64 (3,), pose in the map to start from.
    sigma
        Noise of a point's distance to a line, m.
    prior
        Of odometry; None where nothing is known.

    Returns
    -------
    Alignment
        The pose after the last step; where no point has a neighbour, the prior's or the start.
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
        Fraction of the scan that lies on confirmed surfaces, less the fraction of the confirmed
        surfaces in view that the scan sees through: -1..1.
    """
    passes, hits = passes_and_hits(
        line_map.points[line_map.confirmed],
        transform_points(result.pose, scan.origin[None]),
        np.array([len(scan.points)]),
        transform_points(result.pose, scan.points),
    )
    passed, hit = int(passes.sum()), int(hits.sum())
    return result.confirmed - passed / max(passed + hit, 1)


class _Equations(NamedTuple):
    """Normal equations ``H x = -b``, float64 (3, 3) and (3,); `noise` is float64 (2, 2)."""

    H: Float64
    noise: Float64
    b: Float64


@kernel
def _align(
    line_map: LineMap,
    points: Float64,
    normals: Float64,
    start: Float64,
    sigma: float,
    prior: Prior,
) -> tuple[Float64, Float64, float, float]:  # pragma: no cover - compiled
    pose = start.copy()
    H, noise, b = np.zeros((3, 3)), np.zeros((2, 2)), np.zeros(3)
    inliers, confirmed = 0.0, 0.0
    for step in range(MAX_STEPS):
        radius = max(BUCKET * RADIUS_SHRINK**step, MIN_RADIUS_SIGMAS * sigma)
        inliers, confirmed = _normal_equations(
            line_map, points, normals, pose, sigma, radius, _Equations(H, noise, b)
        )
        _drop_direction_of_noise(H, noise, b)
        A = H + prior.information
        difference = pose - prior.pose
        difference[2] = np.arctan2(np.sin(difference[2]), np.cos(difference[2]))
        g = b + prior.information @ difference
        # A tiny ridge holds directions that neither the map nor odometry knows.
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
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Sum J^T W J into H and J^T W r into b.

    `noise` becomes the part of H's first two rows and columns that stems from normals that are
    off by their standard deviation: E[n n^T] holds their variance in the wall's own direction.
    Returns the fractions of inliers and of confirmed ones.
    """
    H, noise, b = equations.H, equations.noise, equations.b
    H[:], noise[:], b[:] = 0.0, 0.0, 0.0
    H1, noise1, b1 = np.zeros((3, 3)), np.zeros((2, 2)), np.zeros(3)
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
            w *= line_map.variances[j]
            N[0, 0] += w * my * my
            N[0, 1] -= w * mx * my
            N[1, 1] += w * mx * mx
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
    noise[1, 0] = noise[0, 1]
    b += weight * b1
    n = max(len(points), 1)
    return count / n, confirmed / n


@kernel
def _drop_direction_of_noise(H: Float64, noise: Float64, b: Float64) -> None:  # pragma: no cover
    """Remove the direction of the smallest information on the position, if it is noise.

    A step along it would follow the noise, and its covariance would be too small.
    """
    mid, half = 0.5 * (H[0, 0] + H[1, 1]), np.hypot(0.5 * (H[0, 0] - H[1, 1]), H[0, 1])
    angle = 0.5 * np.arctan2(2.0 * H[0, 1], H[0, 0] - H[1, 1])
    # Across the direction of the most information.
    x, y = -np.sin(angle), np.cos(angle)
    by_noise = x * x * noise[0, 0] + 2.0 * x * y * noise[0, 1] + y * y * noise[1, 1]
    if mid - half >= MIN_INFORMATION_RATIO * by_noise:
        return
    keep = np.array([[1.0 - x * x, -x * y, 0.0], [-x * y, 1.0 - y * y, 0.0], [0.0, 0.0, 1.0]])
    H[:] = keep @ H @ keep
    b[:] = keep @ b


@kernel
def _robust(r: float, sigma: float) -> float:  # pragma: no cover - compiled
    """Return the weight of a residual (Cauchy)."""
    u = r / (CAUCHY_SIGMAS * sigma)
    return 1.0 / (1.0 + u * u)


@kernel
def _add(H: Float64, b: Float64, J: Float64, r: float, w: float) -> None:  # pragma: no cover
    for k in range(3):
        b[k] += w * J[k] * r
        for m in range(3):
            H[k, m] += w * J[k] * J[m]


@kernel
def _nearest(
    line_map: LineMap,
    x: float,
    y: float,
    nx: float,
    ny: float,
    radius: float,
) -> int:  # pragma: no cover - compiled
    """Return the nearest map point within `radius` that does not face away, or -1."""
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
