"""From posed scans and tilt angles to tilt cycles with their part maps.

A scan is binned as soon as it is certain to which tilt cycle its beams belong. A tilt cycle is
complete when the joint has reversed and every scan before the reversal has come, or can no longer
come.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.part_map import PartMap, PartMapBuilder
from tccm_ros.cuboids.tilt_cycle import Span, TiltCycles
from tccm_ros.cuboids.union import UNION, CuboidRule
from tccm_ros.geometry import interpolate_poses
from tccm_ros.records import PosedScan
from tccm_ros.sensors.laser_scan import used_beams

SPEED_WINDOW_NS = 250_000_000
"""Base speeds are taken over at least this time, ns: shorter steps show the odometry's jitter.
Chosen: 12 samples of an odometry of 50 Hz."""


@dataclass(frozen=True, slots=True, eq=False)
class CycleScan:
    """Beams of a scan that belong to one tilt cycle.

    Attributes
    ----------
    posed
        The scan with its poses.
    keep
        bool (N,), which of all beams of the scan are valid.
    first, last
        The beams [first, last) belong to the tilt cycle.
    """

    posed: PosedScan
    keep: Bool
    first: int
    last: int

    def stamps_ns(self) -> tuple[int, int] | None:
        """Return the times of the first and the last valid beam, None if there is none."""
        valid = np.flatnonzero(self.keep[self.first : self.last])
        if len(valid) == 0:
            return None
        scan = self.posed.scan
        times = [
            scan.stamp_ns + round((self.first + int(i)) * scan.time_increment * 1e9)
            for i in (valid[0], valid[-1])
        ]
        return min(times), max(times)


@dataclass(slots=True, eq=False)
class TiltCycleData:
    """What was measured in one complete tilt cycle.

    Attributes
    ----------
    span
        Its time and number.
    part
        Its part map, with points.
    scans
        The scans that it is made of, in stamp order.
    """

    span: Span
    part: PartMap
    scans: list[CycleScan] = field(default_factory=list)

    @property
    def stamp_ns(self) -> int:
        """Middle of the first and the last used beam."""
        return (self.part.start_ns + self.part.end_ns) // 2

    def T_odom_base(self) -> Float64:
        """Return the base's pose at `stamp_ns`, float64 (4, 4); the identity without scans."""
        stamps, poses = self._pose_samples(lambda posed: posed.T_odom_base)
        return _pose_at(stamps, poses, self.stamp_ns)

    def T_odom_laser(self) -> Float64:
        """Return the laser's pose at `stamp_ns`, float64 (4, 4); the identity without scans."""
        stamps, poses = self._pose_samples(lambda posed: posed.T_odom_base @ posed.T_base_laser)
        return _pose_at(stamps, poses, self.stamp_ns)

    def base_speeds(self) -> tuple[float, float]:
        """Return the largest speed (m/s) and rotation rate (rad/s) of the base in the cycle."""
        stamps, poses = self._pose_samples(lambda posed: posed.T_odom_base)
        if len(stamps) < 2:
            return 0.0, 0.0
        later = np.minimum(np.searchsorted(stamps, stamps + SPEED_WINDOW_NS), len(stamps) - 1)
        full = stamps[later] - stamps >= SPEED_WINDOW_NS
        if not full.any():
            full[0], later[0] = True, len(stamps) - 1
        now, then = poses[full], poses[later[full]]
        seconds = (stamps[later] - stamps)[full] * 1e-9
        step = np.linalg.norm(then[:, :3, 3] - now[:, :3, 3], axis=1)
        cosine = (np.einsum("nij,nij->n", now[:, :3, :3], then[:, :3, :3]) - 1.0) / 2.0
        rotation = np.arccos(np.clip(cosine, -1.0, 1.0))
        return float((step / seconds).max()), float((rotation / seconds).max())

    def angle_step(self) -> float:
        """Return the mean angle between scan lines, rad; 0 with fewer than two scans."""
        if len(self.scans) < 2:
            return 0.0
        middle = [len(s.posed.pose_stamps_ns) // 2 for s in self.scans]
        normals = np.array(
            [s.posed.T_base_laser[k][:3, 2] for s, k in zip(self.scans, middle, strict=True)]
        )
        return float(np.linalg.norm(np.diff(normals, axis=0), axis=1).mean())

    def _pose_samples(self, poses_of: Callable[[PosedScan], Float64]) -> tuple[Int64, Float64]:
        if not self.scans:
            return np.zeros(0, np.int64), np.zeros((0, 4, 4))
        stamps = np.concatenate([s.posed.pose_stamps_ns for s in self.scans])
        poses = np.concatenate([poses_of(s.posed) for s in self.scans])
        stamps, first = np.unique(stamps, return_index=True)
        return stamps, poses[first]


class CycleBuilder:
    """Assigns beams to tilt cycles and builds their part maps.

    Parameters
    ----------
    config
        Groups `cycle`, `map` and `scan`.
    rule
        How points become cuboids.

    Attributes
    ----------
    dropped
        Scans of which no beam was used, by reason.
    """

    def __init__(self, config: Config, rule: CuboidRule = UNION) -> None:
        self._config = config
        self._cycles = TiltCycles(config)
        self._builder = PartMapBuilder(config, rule)
        self.dropped: Counter[str] = Counter()
        self._waiting: deque[CycleScan] = deque()
        self._open: list[CycleScan] = []

    def clear(self) -> None:
        """Forget all scans of the open tilt cycle, as after a jump of the clock."""
        self.dropped["clock jump"] += len(self._waiting) + len(self._open)
        self._waiting.clear()
        self._open = []
        self._builder.clear()
        self._cycles.clear()

    def add_tilt(self, stamp_ns: int, angle: float) -> None:
        """Take the next tilt angle, in stamp order."""
        self._cycles.add(stamp_ns, angle)

    def add_scan(self, posed: PosedScan) -> None:
        """Take the next scan, in stamp order."""
        keep = used_beams(posed, self._config)
        self._waiting.append(CycleScan(posed, keep, 0, len(posed.scan.ranges)))

    def finish(self) -> list[TiltCycleData]:
        """Close the open tilt cycle at the end of the input; return the cycles completed."""
        self._cycles.finish()
        cycles = self.take(complete_ns=2**62)
        self.dropped["no joint samples"] += len(self._waiting)
        self._waiting.clear()
        return cycles

    def take(self, complete_ns: int) -> list[TiltCycleData]:
        """Bin the scans whose tilt cycle is certain and return the tilt cycles that are complete.

        The open cycle ends where no more samples of the joint can come for it.

        Parameters
        ----------
        complete_ns
            No scan with an earlier stamp than this can come any more.

        Returns
        -------
        list[TiltCycleData]
            The tilt cycles completed by this call, in order.
        """
        self._cycles.advance(complete_ns)
        cycles: list[TiltCycleData] = []
        closed = self._cycles.closed
        while True:
            if self._waiting:
                head = self._waiting[0]
                split = _first_beam_at(head, closed[0].end_ns) if closed else head.last
                certain = closed or _end_ns(head) < self._cycles.decided_ns
                if not certain:
                    return cycles
                used = bool(closed[0].cycle is not None if closed else self._cycles.is_moving)
                reason = closed[0].reason if closed else "joint rests"
                self._waiting.popleft()
                self._use(head, split, used, reason)
                if split == head.last:
                    continue
                self._waiting.appendleft(
                    CycleScan(head.posed, head.keep, max(split, head.first), head.last)
                )
            elif not closed or closed[0].end_ns > complete_ns:
                return cycles
            cycle = self._close(closed.popleft())
            if cycle is not None:
                cycles.append(cycle)

    def _use(self, head: CycleScan, split: int, used: bool, reason: str) -> None:
        """Put the beams before `split` into the open part map, or count the scan as dropped."""
        if used and split > head.first:
            self._builder.add(head.posed, head.keep, head.first, split)
            self._open.append(CycleScan(head.posed, head.keep, head.first, split))
        elif not used and split == head.last and head.first == 0:
            self.dropped[reason] += 1

    def _close(self, span: Span) -> TiltCycleData | None:
        scans, self._open = self._open, []
        cycle = self._cycle_data(span, scans)
        # A new region counts from the next tilt cycle on: a part map has one region.
        self._builder.set_region(self._config.map.region)
        return cycle

    def _cycle_data(self, span: Span, scans: list[CycleScan]) -> TiltCycleData | None:
        if span.cycle is None:
            self.dropped[span.reason] += len(scans)
            self._builder.clear()
            return None
        stamps = [s for s in (scan.stamps_ns() for scan in scans) if s is not None]
        start_ns = min((s[0] for s in stamps), default=span.start_ns)
        end_ns = max((s[1] for s in stamps), default=span.end_ns - 1)
        return TiltCycleData(span, self._builder.close(span.cycle, start_ns, end_ns), scans)


def _end_ns(scan: CycleScan) -> int:
    return max(scan.posed.scan.stamp_ns, scan.posed.scan.end_ns)


def _first_beam_at(scan: CycleScan, stamp_ns: int) -> int:
    """Return the first of the scan's beams that is not before a stamp."""
    step_ns = scan.posed.scan.time_increment * 1e9
    ahead_ns = stamp_ns - scan.posed.scan.stamp_ns
    if step_ns == 0.0:
        return scan.last if ahead_ns > 0 else scan.first
    if step_ns < 0.0:  # The last beam is the earliest: the scan goes whole, by its stamp.
        return scan.last if ahead_ns > 0 else scan.first
    stamps = np.rint(np.arange(scan.first, scan.last) * step_ns).astype(np.int64)
    return scan.first + int(np.searchsorted(stamps, ahead_ns))


def _pose_at(stamps: Int64, poses: Float64, stamp_ns: int) -> Float64:
    if len(stamps) == 0:
        return np.eye(4)
    after = int(np.clip(np.searchsorted(stamps, stamp_ns), 1, max(len(stamps) - 1, 1)))
    if len(stamps) == 1:
        return poses[0]
    span = stamps[after] - stamps[after - 1]
    fraction = float(np.clip((stamp_ns - stamps[after - 1]) / span, 0.0, 1.0))
    return interpolate_poses(poses[after - 1], poses[after], fraction)
