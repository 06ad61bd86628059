"""Directions of a camera's pixels, with lens distortion removed.

Binning and region map a pixel to the whole image (REP-104), and the intrinsics map it to a
direction. The distortion models map undistorted to distorted points; Newton's method inverts them
once per calibration.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tccm_ros.arrays import Float32, Float64
from tccm_ros.records import CameraInfo

UNDISTORTED = ("", "none")
"""Models without coefficients."""

MODELS = ("plumb_bob", "rational_polynomial", *UNDISTORTED)
"""Supported distortion models (the names of image_geometry)."""

ITERATIONS = 20
"""Maximum number of Newton steps; five are enough for ordinary lenses."""

MAX_RESIDUAL = 1e-6
"""Maximum residual of a converged direction, as a tangent."""


def distort(x: Float64, y: Float64, D: Float64) -> tuple[Float64, Float64]:
    """Return distorted points from undistorted ones, as tangents in the optical frame.

    Parameters
    ----------
    x, y
        float64, any shape.
    D
        float64 (N,): k1 k2 p1 p2 k3 of plumb_bob (Brown 1966), then k4 k5 k6 of the rational model
        and s1 s2 s3 s4 of a thin prism, as in OpenCV.
    """
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = np.concatenate([D, np.zeros(12)])[:12]
    r2 = x * x + y * y
    radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4),
    )


def undistort(x: Float64, y: Float64, D: Float64) -> tuple[Float64, Float64]:
    """Return undistorted points from distorted ones; NaN if there is none.

    Pixels beyond the maximum radius of a polynomial model have no direction.

    Parameters
    ----------
    x, y
        float64, distorted points in the plane at unit distance.
    D
        float64, distortion coefficients, as in `distort`.
    """
    step = 1e-6
    a, b = x.copy(), y.copy()
    for _ in range(ITERATIONS):
        fx, fy = distort(a, b, D)
        xa, ya = distort(a + step, b, D)
        xb, yb = distort(a, b + step, D)
        j11, j21, j12, j22 = (xa - fx) / step, (ya - fy) / step, (xb - fx) / step, (yb - fy) / step
        det = j11 * j22 - j12 * j21
        safe = np.where(np.abs(det) > 1e-9, det, 1.0)
        ex, ey = x - fx, y - fy
        if max(np.abs(ex).max(initial=0.0), np.abs(ey).max(initial=0.0)) < 0.01 * MAX_RESIDUAL:
            break
        # Limit the step: near a fold of the model, the tangent leads far away.
        a += np.clip((j22 * ex - j12 * ey) / safe, -0.5, 0.5)
        b += np.clip((j11 * ey - j21 * ex) / safe, -0.5, 0.5)
    fx, fy = distort(a, b, D)
    found = (np.hypot(x - fx, y - fy) < MAX_RESIDUAL) & (det > 0.0)
    return np.where(found, a, np.nan), np.where(found, b, np.nan)


def has_known_lens(camera: CameraInfo) -> bool:
    """Return whether a camera's distortion model is supported."""
    return camera.model in MODELS or not camera.D.any()


def pixel_rays(camera: CameraInfo) -> Float32:
    """Return the point of each pixel's ray at z = 1 (cached: do not write).

    float32 (2, H, W), x and y in the optical frame; NaN outside the lens model.
    """
    D = camera.D.tobytes()
    return _rays(camera.K.tobytes(), D, camera.binning, camera.region[:2], camera.image_size)


@lru_cache(maxsize=8)
def _rays(
    K_bytes: bytes,
    D_bytes: bytes,
    binning: tuple[int, int],
    offset: tuple[int, int],
    size: tuple[int, int],
) -> Float32:
    K, D = np.frombuffer(K_bytes).reshape(3, 3), np.frombuffer(D_bytes)
    # As image_geometry: a bin has the coordinates of its first pixel.
    u = np.arange(size[0]) * float(binning[0]) + offset[0]
    v = np.arange(size[1]) * float(binning[1]) + offset[1]
    x, y = np.meshgrid((u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1])
    if D.any():
        x, y = undistort(x, y, D)
    return np.stack([x, y]).astype(np.float32)
