"""The parts of sensor records in a cycle: beams of a scan, or points of an image or cloud.

Both can be cut in time, are binned into the cycle's part map, and provide their rays through free
space.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.geometry import transform
from tccm_ros.records import Posed, PosedScan
from tccm_ros.sensors.laser_scan import directions, laser_poses
from tccm_ros.sensors.laser_scan_kernels import place_beams
from tccm_ros.sensors.measured import MeasuredPoints

Rays = tuple[Float64, Float64, Bool]
"""Rays: origins and ends float64 (N, 3), m, and whether each ends on a surface."""


@dataclass(frozen=True, slots=True, eq=False)
class CycleScan:
    """The beams of a scan in one tilt cycle.

    Attributes
    ----------
    posed
        The scan with its poses.
    keep
        bool (N,), mask of all valid beams of the scan.
    first, last
        Range of beams [first, last) in the tilt cycle.
    """

    posed: PosedScan
    keep: Bool
    first: int
    last: int

    @property
    def start_ns(self) -> int:
        """Time by which scans are ordered."""
        return self.posed.scan.stamp_ns

    @property
    def end_ns(self) -> int:
        """Time of the last measurement."""
        return max(self.posed.scan.stamp_ns, self.posed.scan.end_ns)

    @property
    def line_angle(self) -> float:
        """Angle between rays, if it follows from the record alone, rad; 0 for scans."""
        return 0.0

    def cut(self, stamp_ns: int) -> tuple[CycleScan | None, CycleScan | None]:
        """Return the parts before and from a stamp; None for an empty part."""
        split = self._first_beam_at(stamp_ns)
        before = replace(self, last=split) if split > self.first else None
        rest = replace(self, first=max(split, self.first)) if split < self.last else None
        return before, rest

    def stamps_ns(self) -> tuple[int, int] | None:
        """Return the times of the first and the last valid beam; None without valid beams."""
        valid = np.flatnonzero(self.keep[self.first : self.last])
        if len(valid) == 0:
            return None
        scan = self.posed.scan
        times = [
            scan.stamp_ns + round((self.first + int(i)) * scan.time_increment * 1e9)
            for i in (valid[0], valid[-1])
        ]
        return min(times), max(times)

    @property
    def is_whole(self) -> bool:
        """Whether no part of the record is in an earlier cycle."""
        return self.first == 0

    def bin(self, builder: PartMapBuilder) -> None:
        """Bin the points into the open part map."""
        builder.add(self.posed, self.keep, self.first, self.last)

    def rays(
        self,
        max_length: float,
        enough: tuple[float, float] | None = None,
        T_frame_odom: Float64 | None = None,
    ) -> Rays:
        """Return the beams with a hit and those with no return (+inf, REP-117).

        Parameters
        ----------
        max_length
            Maximum length of a beam, m; beams without a return get this length.
        enough
            Beam thinning: sufficient distance between beams, m, at a range, m; no thinning by
            default.
        T_frame_odom
            float64 (4, 4), frame of the result; None for odom.
        """
        scan = self.posed.scan
        step = float(scan.time_increment)
        every = 1
        if enough is not None:
            distance, at_range = enough
            every = max(int(distance / max(abs(scan.angle_increment) * at_range, 1e-9)), 1)
        useful = np.zeros(len(scan.ranges), np.bool_)
        chosen = slice(self.first, self.last, every)
        useful[chosen] = (self.keep | np.isposinf(scan.ranges))[chosen]
        ranges = np.minimum(scan.ranges, np.float32(max_length))
        at_laser = np.zeros_like(ranges)
        for array in (ranges, at_laser):
            array.flags.writeable = False  # as in a scan, for the same compiled kernel
        times, T = laser_poses(self.posed, T_frame_odom)
        cosines, sines = directions(scan)
        ends, beams = place_beams(ranges, useful, cosines, sines, step, times, T)
        origins, _ = place_beams(at_laser, useful, cosines, sines, step, times, T)
        return origins, ends, self.keep[beams] & (ranges[beams] < max_length)

    def _first_beam_at(self, stamp_ns: int) -> int:
        """Return the index of the first beam at or after a stamp."""
        step_ns = self.posed.scan.time_increment * 1e9
        ahead_ns = stamp_ns - self.posed.scan.stamp_ns
        if step_ns <= 0.0:  # Equal or decreasing times: do not divide the scan.
            return self.last if ahead_ns > 0 else self.first
        stamps = np.rint(np.arange(self.first, self.last) * step_ns).astype(np.int64)
        return self.first + int(np.searchsorted(stamps, ahead_ns))


@dataclass(frozen=True, slots=True, eq=False)
class CyclePoints:
    """The points of an image or a cloud in one cycle.

    Attributes
    ----------
    posed
        The record with its poses.
    measured
        Points and rays of the record.
    is_whole
        Whether no part of its points is in an earlier cycle.
    """

    posed: Posed
    measured: MeasuredPoints
    is_whole: bool = True

    @property
    def start_ns(self) -> int:
        """Time of the first measurement."""
        stamps = self.stamps_ns()
        return self.posed.stamp_ns if stamps is None else min(stamps[0], self.posed.stamp_ns)

    @property
    def end_ns(self) -> int:
        """Time of the last measurement."""
        stamps = self.stamps_ns()
        return self.posed.stamp_ns if stamps is None else max(stamps[1], self.posed.stamp_ns)

    @property
    def line_angle(self) -> float:
        """Angle between rays, rad."""
        return self.measured.line_angle

    def cut(self, stamp_ns: int) -> tuple[CyclePoints | None, CyclePoints | None]:
        """Return the parts before and from a stamp; None for an empty part.

        Rays go to the part that contains the record's stamp.
        """
        stamps, nothing = self.measured.stamps_ns, np.zeros(0, np.bool_)
        if stamps is None or not len(stamps):
            return (self, None) if self.posed.stamp_ns < stamp_ns else (None, self)
        early = stamps < stamp_ns
        if early.all() or not early.any():
            return (self, None) if early.all() else (None, self)
        rest = replace(
            self.measured.chosen(~early),
            origins=np.zeros((0, 3)),
            ends=np.zeros((0, 3)),
            hits=nothing,
        )
        before = replace(self, measured=self.measured.chosen(early))
        return before, CyclePoints(self.posed, rest, is_whole=False)

    def stamps_ns(self) -> tuple[int, int] | None:
        """Return the times of the first and the last point; None without points."""
        if not len(self.measured.points):
            return None
        stamps = self.measured.stamps_ns
        if stamps is None:
            return self.posed.stamp_ns, self.posed.stamp_ns
        return int(stamps.min()), int(stamps.max())

    def bin(self, builder: PartMapBuilder) -> None:
        """Bin the points into the open part map."""
        builder.add_points(self.measured.points, self.posed.stamp_ns, self.measured.gaps)

    def rays(
        self,
        max_length: float,
        enough: tuple[float, float] | None = None,
        T_frame_odom: Float64 | None = None,
    ) -> Rays:
        """Return the rays, as `CycleScan.rays`.

        Parameters
        ----------
        max_length
            Maximum length of a ray, m.
        enough
            Unused: depth images and clouds are thinned before.
        T_frame_odom
            float64 (4, 4), frame of the result; None for odom.
        """
        origins, ends, hits = self.measured.origins, self.measured.ends, self.measured.hits
        lengths = np.linalg.norm(ends - origins, axis=1)
        far = lengths > max_length
        if far.any():
            scale = np.where(far, max_length / np.maximum(lengths, 1e-9), 1.0)
            ends, hits = origins + (ends - origins) * scale[:, None], hits & ~far
        if T_frame_odom is None:
            return origins, ends, hits
        return transform(T_frame_odom, origins), transform(T_frame_odom, ends), hits


CycleRecord = CycleScan | CyclePoints
"""The part of a record in a cycle."""
