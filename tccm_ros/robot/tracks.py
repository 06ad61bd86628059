"""Time-stamped samples in stamp order, with interpolation and without extrapolation.

A track keeps a bounded history. A sample that is not newer than the previous one is dropped, so
that an interpolated value never changes between two queries.
"""

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel

MAX_SAMPLES = 16384
"""Samples of a track above which the older half is deleted. Chosen: 160 s at 100 Hz."""

SAME_POSE = 1e-7
"""Transforms are equal if their numbers differ by less: rounding of a driver that recomputes them
in single precision for each message."""


class Track:
    """Samples of `width` numbers, sorted by stamp.

    Parameters
    ----------
    width
        Number of values per sample.
    max_samples
        Bound of the history.

    Attributes
    ----------
    heard
        Number of samples received, including dropped ones.
    latest_ns
        Newest stamp; None without samples.
    """

    def __init__(self, width: int, max_samples: int = MAX_SAMPLES):
        self.heard = 0
        self.latest_ns: int | None = None
        size = min(64, max_samples)
        self._stamps = np.zeros(size, np.int64)
        self._values = np.zeros((size, width))
        self._count = 0
        self._max_samples = max_samples

    def __len__(self) -> int:
        return self._count

    @property
    def stamps_ns(self) -> Int64:
        """Stamps of the samples, int64 (N,), strictly increasing (a view)."""
        return self._stamps[: self._count]

    @property
    def values(self) -> Float64:
        """The samples, float64 (N, width) (a view)."""
        return self._values[: self._count]

    def clear(self) -> None:
        """Forget all samples."""
        self._count = 0
        self.latest_ns = None

    def append(self, stamp_ns: int, value: Float64 | float) -> bool:
        """Append a sample; return False and drop it where it is not the newest."""
        self.heard += 1
        if self.latest_ns is not None and stamp_ns <= self.latest_ns:
            return False
        n = self._count
        if n == len(self._stamps):
            n = self._make_room()
        self._stamps[n] = self.latest_ns = stamp_ns
        self._values[n] = value
        self._count = n + 1
        return True

    def keep(self, kept: Sequence[bool]) -> None:
        """Keep only the samples for which `kept`, bool (N,), is True."""
        if not all(kept):
            count = sum(kept)
            self._stamps[:count] = self.stamps_ns[list(kept)]
            self._values[:count] = self.values[list(kept)]
            self._count = count
            self.latest_ns = int(self._stamps[count - 1]) if count else None

    def widest_gap_ns(self, start_ns: int, end_ns: int) -> int | None:
        """Return the widest gap between the samples around [start, end].

        Returns
        -------
        The gap in ns (0 where one sample at start = end suffices), or None if no sample is at or
        before the start or none at or after the end.
        """
        if self.latest_ns is None or self.latest_ns < end_ns:
            return None
        gap = widest_gap(self._stamps[: self._count], start_ns, end_ns)
        return None if gap < 0 else gap

    def brackets(self, start_ns: int, end_ns: int, max_gap_ns: int) -> bool:
        """Return whether samples cover an interval without a wide gap.

        Parameters
        ----------
        start_ns, end_ns
            The interval.
        max_gap_ns
            Maximum gap between two samples.
        """
        gap = self.widest_gap_ns(start_ns, end_ns)
        return gap is not None and gap <= max_gap_ns

    def stamps_within(self, start_ns: int, end_ns: int) -> Int64:
        """Return the sample stamps in the open interval (start, end), int64 (M,)."""
        return stamps_between(self._stamps[: self._count], start_ns, end_ns)

    def _make_room(self) -> int:
        """Grow the arrays, or delete the older half; return the number of samples."""
        first = self._count // 2 if self._count >= self._max_samples else 0
        kept = self._count - first
        size = min(max(2 * kept, 64), self._max_samples)
        stamps, values = np.zeros(size, np.int64), np.zeros((size, self._values.shape[1]))
        stamps[:kept] = self._stamps[first : self._count]
        values[:kept] = self._values[first : self._count]
        self._stamps, self._values, self._count = stamps, values, kept
        return kept


class ScalarTrack(Track):
    """Positions of one joint, rad or m."""

    def __init__(self) -> None:
        super().__init__(1)

    def at(self, stamps_ns: Int64, *, wraps: bool) -> Float64:
        """Return positions float64 (K,) at stamps int64 (K,) that the samples bracket.

        With `wraps`, positions are angles and are interpolated the short way: an encoder that steps
        from +pi to -pi has not rotated back.
        """
        return interpolate_scalars(
            self.stamps_ns, self.values[:, 0], np.asarray(stamps_ns, np.int64), wraps
        )


class PoseTrack(Track):
    """Rigid transforms T_a_b, kept as translation and unit quaternion xyzw.

    Attributes
    ----------
    T_constant
        float64 (4, 4), the transform while all samples so far are equal; None before the first and
        after a change.
    has_moved
        Whether two samples differed.
    """

    def __init__(self) -> None:
        super().__init__(7)
        self.T_constant: Float64 | None = None
        self.has_moved = False

    def append_pose(self, stamp_ns: int, T_a_b: Float64) -> bool:
        """Append a transform float64 (4, 4); return False where it is not the newest."""
        self.note(T_a_b)
        return self.append(stamp_ns, pose_to_numbers(T_a_b))

    def note(self, T_a_b: Float64) -> None:
        """Compare a transform float64 (4, 4) with the previous ones."""
        if self.has_moved:
            return
        if self.T_constant is None:
            self.T_constant = T_a_b
        elif np.abs(T_a_b - self.T_constant).max() > SAME_POSE:
            self.T_constant, self.has_moved = None, True

    def at(self, stamps_ns: Int64) -> Float64:
        """Return transforms float64 (K, 4, 4) at stamps int64 (K,).

        The stamps lie within the samples, or the transform is constant.
        """
        if not self._count and self.T_constant is not None:
            return np.broadcast_to(self.T_constant, (len(stamps_ns), 4, 4)).copy()
        return interpolate_transforms(self.stamps_ns, self.values, np.asarray(stamps_ns, np.int64))


@kernel
def widest_gap(stamps, start, end):  # type: ignore[no-untyped-def]
    """Return the widest gap between the stamps around [start, end], -1 if they do not bracket it.

    Parameters
    ----------
    stamps
        int64 (N,), ns, increasing.
    start, end
        The interval, ns.
    """
    if len(stamps) == 0 or stamps[0] > start or stamps[-1] < end:
        return -1
    first = np.searchsorted(stamps, start, "right") - 1
    last = np.searchsorted(stamps, end)
    widest = 0
    for i in range(first, last):
        widest = max(widest, stamps[i + 1] - stamps[i])
    return widest


@kernel
def stamps_between(stamps, start, end):  # type: ignore[no-untyped-def]
    """Return the stamps in an open interval, int64 (M,) (a view).

    Parameters
    ----------
    stamps
        int64 (N,), ns, increasing.
    start, end
        The interval, ns; both ends are excluded.
    """
    return stamps[np.searchsorted(stamps, start, "right") : np.searchsorted(stamps, end)]


@kernel
def merge_stamps(start, end, step, inner):  # type: ignore[no-untyped-def]
    """Return increasing stamps int64 (K,) from start to end.

    Parameters
    ----------
    start, end
        The interval, ns, start < end; both ends are included.
    step
        Maximum step, ns.
    inner
        int64 (N,), further stamps in the interval to include.
    """
    count = -(-(end - start) // step)
    merged = np.empty(count + 1 + len(inner), np.int64)
    for i in range(count + 1):
        merged[i] = start + (end - start) * i // count
    merged[count + 1 :] = inner
    merged.sort()
    kept = 1
    for i in range(1, len(merged)):
        if merged[i] != merged[kept - 1]:
            merged[kept] = merged[i]
            kept += 1
    return merged[:kept]


@kernel
def bracket(stamps, stamp):  # type: ignore[no-untyped-def]
    """Return (i, j, fraction): the samples around a stamp within the samples."""
    j = np.searchsorted(stamps, stamp)
    if j >= len(stamps):
        j = len(stamps) - 1
    if stamps[j] <= stamp or j == 0:
        return j, j, 0.0
    step = stamps[j] - stamps[j - 1]
    return j - 1, j, (stamp - stamps[j - 1]) / step


@kernel
def interpolate_scalars(stamps, values, at, wraps):  # type: ignore[no-untyped-def]
    """Return values at stamps, float64 (K,), linear between samples.

    Parameters
    ----------
    stamps, values
        int64 (N,), ns, increasing, and float64 (N,).
    at
        int64 (K,), ns, within the stamps.
    wraps
        Whether values are angles in rad, interpolated the short way.
    """
    result = np.empty(len(at))
    for k in range(len(at)):
        i, j, f = bracket(stamps, at[k])
        step = values[j] - values[i]
        if wraps:
            step -= 2.0 * np.pi * np.rint(step / (2.0 * np.pi))
        result[k] = values[i] + f * step
    return result


@kernel
def slerp(a, b, f):  # type: ignore[no-untyped-def]
    """Interpolate unit quaternions xyzw along the shorter great circle (Shoemake, SIGGRAPH 1985).

    Parameters
    ----------
    a, b
        float64 (4,), unit quaternions.
    f
        0 at a, 1 at b.
    """
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = 1.0
    if dot < 0.0:
        dot, sign = -dot, -1.0
    if dot > 0.9999999:
        wa, wb = 1.0 - f, f * sign
    else:
        angle = np.arccos(dot)
        wa = np.sin((1.0 - f) * angle) / np.sin(angle)
        wb = np.sin(f * angle) / np.sin(angle) * sign
    q = np.empty(4)
    norm = 0.0
    for i in range(4):
        q[i] = wa * a[i] + wb * b[i]
        norm += q[i] * q[i]
    return q / np.sqrt(norm)


@kernel
def pose_to_numbers(T):  # type: ignore[no-untyped-def]
    """Return translation and unit quaternion xyzw, w >= 0, of a pose (4, 4), float64 (7,).

    The largest of the four components is found first (Shepperd 1978) to avoid division by a small
    number.
    """
    trace = T[0, 0] + T[1, 1] + T[2, 2]
    largest = 3
    for i in range(3):
        if T[i, i] > (trace if largest == 3 else T[largest, largest]):
            largest = i
    q = np.empty(4)
    if largest == 3:
        q[0], q[1], q[2] = T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1]
        q[3] = 1.0 + trace
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i] = 1.0 + T[i, i] - T[j, j] - T[k, k]
        q[j] = T[j, i] + T[i, j]
        q[k] = T[k, i] + T[i, k]
        q[3] = T[k, j] - T[j, k]
    norm = np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    if q[3] < 0.0:
        norm = -norm
    result = np.empty(7)
    for i in range(3):
        result[i] = T[i, 3]
    result[3:] = q / norm
    return result


@kernel
def quaternion_to_pose(q, t, T):  # type: ignore[no-untyped-def]
    """Write the pose of a quaternion and a translation.

    Parameters
    ----------
    q
        float64 (4,), xyzw, unit.
    t
        float64 (3,), m.
    T
        float64 (4, 4), written.
    """
    x, y, z, w = q[0], q[1], q[2], q[3]
    T[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    T[0, 1] = 2.0 * (x * y - z * w)
    T[0, 2] = 2.0 * (x * z + y * w)
    T[1, 0] = 2.0 * (x * y + z * w)
    T[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    T[1, 2] = 2.0 * (y * z - x * w)
    T[2, 0] = 2.0 * (x * z - y * w)
    T[2, 1] = 2.0 * (y * z + x * w)
    T[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    for i in range(3):
        T[i, 3] = t[i]
        T[3, i] = 0.0
    T[3, 3] = 1.0


@kernel
def interpolate_transforms(stamps, values, at):  # type: ignore[no-untyped-def]
    """Return poses at stamps, float64 (K, 4, 4): translation linear, rotation by `slerp`.

    Parameters
    ----------
    stamps, values
        int64 (N,), ns, increasing, and float64 (N, 7): translation in m, unit quaternion xyzw.
    at
        int64 (K,), ns, within the stamps.
    """
    result = np.empty((len(at), 4, 4))
    for k in range(len(at)):
        i, j, f = bracket(stamps, at[k])
        t = values[i, :3] * (1.0 - f) + values[j, :3] * f
        quaternion_to_pose(slerp(values[i, 3:], values[j, 3:], f), t, result[k])
    return result
