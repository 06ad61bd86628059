"""Compiled loops over the beams of a scan. The tests contain numpy references."""

import numpy as np

from tccm_ros.kernels import kernel

BLEND_ANGLE = 0.005
"""Maximum rotation between two poses of a scan, rad; poses are inserted above it. Chosen: blending
matrices over less shortens a vector by at most angle^2 / 8, a 300,000th."""

STRAIGHT_RUN = 3
"""Number of collinear hits that make a wall. Chosen: an edge with two mixed pixels has at most two.
"""

STRAIGHT_STEP = 0.2
STRAIGHT_NOISE = 0.5
"""Tolerance of collinearity of a hit with its neighbours: fractions of the step in range and of the
range noise. Chosen."""

BOX, SPHERE, CYLINDER = 0, 1, 2


@kernel
def is_straight(ranges, hit, i, cos_step, noise):  # type: ignore[no-untyped-def]
    """Return whether hit i is on the straight line through the hits of its two neighbours.

    In polar coordinates, 1/r along a line is a sinusoid of the bearing, hence ``1/r[i-1] + 1/r[i+1]
    = 2 cos(step) / r[i]``. The tolerance is `STRAIGHT_STEP` times the step in range plus
    `STRAIGHT_NOISE` times `noise`.

    Parameters
    ----------
    ranges, hit
        float32 (N,), m, and bool (N,).
    i
        Index of the beam.
    cos_step
        Cosine of the angle between beams.
    noise
        Range noise, m.
    """
    if i < 1 or i + 1 >= len(ranges) or not (hit[i - 1] and hit[i] and hit[i + 1]):
        return False
    a, r, b = np.float64(ranges[i - 1]), np.float64(ranges[i]), np.float64(ranges[i + 1])
    on_line = 2.0 * cos_step * a * b / (a + b)
    return abs(r - on_line) <= STRAIGHT_NOISE * noise + STRAIGHT_STEP * max(abs(r - a), abs(r - b))


@kernel
def ends_straight(ranges, hit, i, side, cos_step, noise):  # type: ignore[no-untyped-def]
    """Return whether hit i is the last of a straight line, before a step away from the laser.

    The last beam before an edge has one neighbour on its surface only. If it is on the line through
    the two hits before it, and `STRAIGHT_RUN` hits before it are straight, it is no mixed pixel.
    The first beam after an edge has the step towards the laser, and is none of these: the surface
    behind is occluded, and does not end there.

    The line is extrapolated, not interpolated: the tolerance for the step of `is_straight` is left
    out, or else a wall behind the edge would be on the line.

    Parameters
    ----------
    ranges, hit, cos_step, noise
        As in `is_straight`.
    i
        Index of the beam.
    side
        -1 if the beams before it have lower indices, 1 if higher.
    """
    last = i + (STRAIGHT_RUN + 2) * side
    if not (0 <= last < len(ranges) and 0 <= i - side < len(ranges)):
        return False
    if hit[i - side] and ranges[i - side] < ranges[i]:
        return False
    for k in range(i + 2 * side, last, side):
        if not is_straight(ranges, hit, k, cos_step, noise):
            return False
    a, b = np.float64(ranges[i + side]), np.float64(ranges[i + 2 * side])
    inverse = 2.0 * cos_step / a - 1.0 / b
    return inverse > 0.0 and abs(np.float64(ranges[i]) - 1.0 / inverse) <= STRAIGHT_NOISE * noise


@kernel
def mark_valid(  # type: ignore[no-untyped-def]
    ranges, low, high, step, shadow_angle, shadow_jump, line_ends
):
    """Return a mask of the beams with a valid hit, bool (N,).

    A beam is rejected if its range is not a number within [low, high], or if it is a mixed pixel:
    its range differs from a neighbour's by more than `shadow_jump`, and the line between their hits
    is within `shadow_angle` of the beam. A wall at a grazing angle has the same steps, but is
    straight: a hit is kept in a run of `STRAIGHT_RUN` hits that are collinear with their
    neighbours, and with `line_ends` also as its last hit before a step away from the laser
    (`ends_straight`).

    Parameters
    ----------
    ranges
        float32 (N,), m.
    low, high
        Range limits, m.
    step
        Angle between beams, rad.
    shadow_angle
        Maximum angle of a mixed pixel, rad; 0 keeps mixed pixels.
    shadow_jump
        Minimum step in range of a mixed pixel, m.
    line_ends
        Whether to keep the last hit of a straight line.
    """
    n = len(ranges)
    hit = np.empty(n, np.bool_)
    valid = np.empty(n, np.bool_)
    for i in range(n):
        hit[i] = ranges[i] >= low and ranges[i] <= high and ranges[i] > 0.0
        valid[i] = hit[i]
    if shadow_angle <= 0.0:
        return valid
    sin_step, cos_step, slope = np.sin(abs(step)), np.cos(step), np.tan(shadow_angle)
    for i in range(n - 1):
        if not (hit[i] and hit[i + 1]):
            continue
        a, b = np.float64(ranges[i]), np.float64(ranges[i + 1])
        if abs(a - b) <= shadow_jump:
            continue
        if b * sin_step < slope * abs(a - b * cos_step):
            valid[i] = False
        if a * sin_step < slope * abs(b - a * cos_step):
            valid[i + 1] = False
    for i in range(n):
        if hit[i] and not valid[i] and is_straight(ranges, hit, i, cos_step, shadow_jump):
            run = 1
            for side in (-1, 1):
                k = i + side
                while run < STRAIGHT_RUN and is_straight(ranges, hit, k, cos_step, shadow_jump):
                    run += 1
                    k += side
            valid[i] = run >= STRAIGHT_RUN
    if not line_ends:
        return valid
    surely = valid.copy()
    for i in range(n):
        for side in (-1, 1):
            if hit[i] and not valid[i] and 0 <= i + side < n and surely[i + side]:
                valid[i] = ends_straight(ranges, hit, i, side, cos_step, shadow_jump)
    return valid


@kernel
def rotation_between(A, B, axis):  # type: ignore[no-untyped-def]
    """Return the angle of R_A^T R_B of two poses, rad in [0, pi], and write its axis.

    Parameters
    ----------
    A, B
        float64 (4, 4).
    axis
        float64 (3,), unit, in A's child frame; written.
    """
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            R[i, j] = A[0, i] * B[0, j] + A[1, i] * B[1, j] + A[2, i] * B[2, j]
    axis[0], axis[1], axis[2] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    double_sine = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    if double_sine > 0.0:
        for i in range(3):
            axis[i] /= double_sine
    return np.arctan2(double_sine, R[0, 0] + R[1, 1] + R[2, 2] - 1.0)


@kernel
def turned(A, axis, angle, t, out):  # type: ignore[no-untyped-def]
    """Write a pose rotated about an axis in its child frame, with translation `t`.

    Parameters
    ----------
    A
        float64 (4, 4).
    axis, angle
        Unit vector float64 (3,) in A's child frame, and rad.
    t
        float64 (3,), the new translation, m.
    out
        float64 (3, 4), written.
    """
    c, s = np.cos(angle), np.sin(angle)
    v = 1.0 - c
    x, y, z = axis[0], axis[1], axis[2]
    for i in range(3):
        a, b, d = A[i, 0], A[i, 1], A[i, 2]
        out[i, 0] = a * (c + x * x * v) + b * (y * x * v + z * s) + d * (z * x * v - y * s)
        out[i, 1] = a * (x * y * v - z * s) + b * (c + y * y * v) + d * (z * y * v + x * s)
        out[i, 2] = a * (x * z * v + y * s) + b * (y * z * v - x * s) + d * (c + z * z * v)
        out[i, 3] = t[i]


@kernel
def refine_poses(times, T):  # type: ignore[no-untyped-def]
    """Insert poses so that neighbours differ by at most `BLEND_ANGLE`.

    Parameters
    ----------
    times, T
        float64 (K,), increasing, and (K, 4, 4).

    Returns
    -------
    float64 (M,) and (M, 3, 4); translations are linear, rotations on the great circle.
    """
    n = len(times)
    steps = np.ones(max(n - 1, 0), np.int64)
    angles = np.empty(max(n - 1, 0))
    axes = np.empty((max(n - 1, 0), 3))
    total = 1
    for k in range(n - 1):
        angles[k] = rotation_between(T[k], T[k + 1], axes[k])
        steps[k] = max(1, int(np.ceil(angles[k] / BLEND_ANGLE)))
        total += steps[k]
    fine_times = np.empty(total)
    fine = np.empty((total, 3, 4))
    m = 0
    t = np.empty(3)
    for k in range(n - 1):
        for s in range(steps[k]):
            f = s / steps[k]
            for i in range(3):
                t[i] = (1.0 - f) * T[k, i, 3] + f * T[k + 1, i, 3]
            fine_times[m] = (1.0 - f) * times[k] + f * times[k + 1]
            turned(T[k], axes[k], f * angles[k], t, fine[m])
            m += 1
    fine_times[m] = times[n - 1]
    fine[m] = T[n - 1, :3]
    return fine_times, fine


@kernel
def place_beams(ranges, valid, cosines, sines, step, times, T):  # type: ignore[no-untyped-def]
    """Return the points of valid beams, each with the pose at its own time.

    Parameters
    ----------
    ranges, valid, cosines, sines
        (N,): ranges in m, mask, and cosine and sine of the bearings.
    step
        Time between beams, s.
    times, T
        float64 (M,), s after the first beam, increasing, and (M, 3, 4): poses of the laser, blended
        linearly.

    Returns
    -------
    points float64 (V, 3) and beams int32 (V,).
    """
    n = len(ranges)
    count = 0
    for i in range(n):
        count += valid[i]
    points = np.empty((count, 3))
    beams = np.empty(count, np.int32)
    last = len(times) - 1
    k = 0 if step >= 0.0 else max(last - 1, 0)
    v = 0
    for i in range(n):
        if not valid[i]:
            continue
        time = i * step
        while k < last - 1 and time >= times[k + 1]:
            k += 1
        while k > 0 and time < times[k]:
            k -= 1
        f = 0.0
        if last > 0:
            f = min(max((time - times[k]) / (times[k + 1] - times[k]), 0.0), 1.0)
        x, y = ranges[i] * cosines[i], ranges[i] * sines[i]
        A, B = T[k], T[min(k + 1, last)]
        for j in range(3):
            a = A[j, 0] * x + A[j, 1] * y + A[j, 3]
            b = B[j, 0] * x + B[j, 1] * y + B[j, 3]
            points[v, j] = a + f * (b - a)
        beams[v] = i
        v += 1
    return points, beams


@kernel
def mark_inside(points, kinds, half, T_shape_frame, padding):  # type: ignore[no-untyped-def]
    """Return a mask of the points inside any of the shapes, bool (N,).

    Parameters
    ----------
    points
        float64 (N, 3), m.
    kinds
        int64 (S,): BOX, SPHERE or CYLINDER (along z).
    half
        float64 (S, 3), half extents, m; the first is the radius of a sphere or cylinder.
    T_shape_frame
        float64 (S, 4, 4), from the points' frame to each shape's frame.
    padding
        Margin around each shape, m.
    """
    inside = np.zeros(len(points), np.bool_)
    for s in range(len(kinds)):
        T = T_shape_frame[s]
        hx, hy, hz = half[s, 0] + padding, half[s, 1] + padding, half[s, 2] + padding
        for n in range(len(points)):
            p = points[n]
            z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
            if abs(z) > hz:
                continue
            x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
            y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
            if kinds[s] == BOX:
                within = abs(x) <= hx and abs(y) <= hy
            elif kinds[s] == SPHERE:
                within = x * x + y * y + z * z <= hx * hx
            else:
                within = x * x + y * y <= hx * hx
            inside[n] |= within
    return inside
