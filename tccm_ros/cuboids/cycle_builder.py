"""Build cycles with part maps from sensor records and tilt angles.

A scan is binned as soon as the tilt cycles of its beams are certain. A tilt cycle is complete when
the joint has reversed and all scans before the reversal have arrived, or have timed out. Records of
several sensors are processed in stamp order, independent of their order of arrival.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cycle_records import CycleRecord, CycleScan
from tccm_ros.cuboids.part_map import PartMap, PartMapBuilder
from tccm_ros.cuboids.tilt_cycle import Span, TiltCycles
from tccm_ros.cuboids.timed_cycles import TimedCycles
from tccm_ros.cuboids.union import UNION, CuboidRule
from tccm_ros.geometry import interpolate_poses
from tccm_ros.records import START_OF_TIME, Posed, SensorKind

SPEED_WINDOW_NS = 250_000_000
"""Minimum time over which base speeds are computed, ns: shorter steps show the odometry's jitter.
Chosen: 12 samples of 50 Hz odometry."""

PATIENCE_NS = 1_500_000_000
"""Additional timeout for sensors with a larger latency than others, ns, in message time: images
arrive later than odometry, which advances message time. Chosen: no delay while all sensors are
alive."""

END_OF_TIME = 2**62


@dataclass(slots=True, eq=False)
class TiltCycleData:
    """The measurements of one complete cycle.

    Attributes
    ----------
    span
        Time span and number of the cycle.
    part
        Part map of the cycle, with points.
    records
        Records of the cycle, in stamp order.
    """

    span: Span
    part: PartMap
    records: list[CycleRecord] = field(default_factory=list)

    @property
    def stamp_ns(self) -> int:
        """Middle of the times of the first and the last used beam."""
        return (self.part.start_ns + self.part.end_ns) // 2

    @property
    def scans(self) -> list[CycleScan]:
        """The scans of tilting lasers among the records."""
        return [record for record in self.records if isinstance(record, CycleScan)]

    def is_line(self) -> Bool:
        """Return a mask of the records that are scan lines, bool (R,); others are dense points."""
        return np.array([isinstance(record, CycleScan) for record in self.records], np.bool_)

    def is_of(self, kind: SensorKind) -> Bool:
        """Return which records are of one kind of sensor, bool (R,)."""
        return np.array([record.posed.sensor_kind is kind for record in self.records], np.bool_)

    def T_odom_base(self) -> Float64:
        """Return the base pose at `stamp_ns`, float64 (4, 4); the identity without records."""
        stamps, poses = _pose_samples(self.records, lambda posed: posed.T_odom_base)
        return _pose_at(stamps, poses, self.stamp_ns)

    def T_odom_sensor(self) -> Float64:
        """Return the sensor pose at `stamp_ns`, float64 (4, 4); the identity without records.

        The sensor is a tilting laser, if there is one, otherwise that of the first record.
        """
        chosen = self.scans or self.records
        records = [r for r in chosen if r.posed.role == chosen[0].posed.role]
        stamps, poses = _pose_samples(
            records, lambda posed: posed.T_odom_base @ posed.T_base_sensor
        )
        return _pose_at(stamps, poses, self.stamp_ns)

    def sensor_kind(self) -> SensorKind:
        """Return the kind of the sensor of `T_odom_sensor`."""
        records = self.scans or self.records
        return records[0].posed.sensor_kind if records else SensorKind.LASER

    def base_speeds(self) -> tuple[float, float]:
        """Return the maximum speed (m/s) and rotation rate (rad/s) of the base in the cycle."""
        stamps, poses = _pose_samples(self.records, lambda posed: posed.T_odom_base)
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
        """Return the larger of the mean angle of scan lines and the angle of other rays, rad."""
        others = max((record.line_angle for record in self.records), default=0.0)
        steps = self._scan_steps()
        return max(others, float(steps.mean())) if len(steps) else others

    def swept_angle(self) -> float:
        """Return the total angle of the scan lines, rad; inf if the cycle has other points."""
        return float(self._scan_steps().sum()) if self.is_line().all() else np.inf

    def _scan_steps(self) -> Float64:
        """Return the angles between consecutive scan lines, float64 (S - 1,), rad."""
        scans = self.scans
        middle = [len(s.posed.pose_stamps_ns) // 2 for s in scans]
        normals = [s.posed.T_base_laser[k][:3, 2] for s, k in zip(scans, middle, strict=True)]
        return np.linalg.norm(np.diff(np.reshape(normals, (-1, 3)), axis=0), axis=1)


class _Waiting:
    """Queues of all sensors' records, merged in stamp order.

    Parameters
    ----------
    roles
        Roles of the sensors.
    tilting
        Roles of tilting lasers: once one is alive, other sensors are not waited for at the start.
    """

    def __init__(self, roles: Iterable[str], tilting: Iterable[str]) -> None:
        self._tilting = tuple(tilting)
        self.queues: dict[str, deque[CycleRecord]] = {role: deque() for role in roles}
        self.complete_ns: dict[str, int] = {}
        self._first_ns: int | None = None

    def __len__(self) -> int:
        """Return the number of queued records of which nothing has been used."""
        return sum(map(count_begun, self.queues.values()))

    def add(self, record: CycleRecord) -> None:
        """Append a record; records of one role come in stamp order."""
        queue = self.queues.get(record.posed.role)
        if queue is None:  # the role is not configured
            queue = self.queues[record.posed.role] = deque()
        queue.append(record)
        if self._first_ns is None:
            self._first_ns = record.start_ns

    def clear(self) -> None:
        """Clear all queues."""
        for queue in self.queues.values():
            queue.clear()
        self.complete_ns.clear()
        self._first_ns = None

    def is_known(self, role: str) -> bool:
        """Return whether a sensor is alive."""
        return role in self.complete_ns or bool(self.queues.get(role))

    @property
    def is_decided(self) -> bool:
        """Whether it is known which sensors are alive.

        A sensor is not alive, or starts later, if it has no record while the others are complete up
        to the first record.
        """
        if self._first_ns is None or not self.complete_ns:
            return False
        silent = any(not self.is_known(role) for role in self.queues)
        patience_ns = 0 if any(map(self.is_known, self._tilting)) else PATIENCE_NS
        return not silent or max(self.complete_ns.values()) > self._first_ns + patience_ns

    def next(self) -> deque[CycleRecord] | None:
        """Return the queue with the next record; None while an earlier record may still arrive."""
        heads = [(queue[0].start_ns, role) for role, queue in self.queues.items() if queue]
        if not heads:
            return None
        stamp_ns, role = min(heads)
        others = (other for other, queue in self.queues.items() if not queue)
        if any(self._until_ns(other) <= stamp_ns for other in others):
            return None
        return self.queues[role]

    def _until_ns(self, role: str) -> int:
        """Return the stamp before which no further record of a sensor is expected.

        With several sensors, this is `PATIENCE_NS` earlier than its complete time.
        """
        until_ns = self.complete_ns.get(role, END_OF_TIME)
        return until_ns - PATIENCE_NS if len(self.complete_ns) > 1 else until_ns

    @property
    def complete_all_ns(self) -> int:
        """Stamp before which no sensor has a queued or expected record."""
        until = [
            queue[0].start_ns if queue else self._until_ns(role)
            for role, queue in self.queues.items()
            if queue or role in self.complete_ns
        ]
        return min(until, default=START_OF_TIME)


class CycleBuilder:
    """Assigns measurements to cycles and builds their part maps.

    With a tilting laser, its movements are the cycles, and points of other sensors belong to the
    cycle at their time; without one, cycles have a fixed period (`TimedCycles`).

    Parameters
    ----------
    config
        Groups `cycle`, `map`, `scan` and `sensors`.
    rule
        Rule that turns points into cuboids.

    Attributes
    ----------
    dropped
        Number of records of which nothing was used, by reason.
    """

    def __init__(self, config: Config, rule: CuboidRule = UNION) -> None:
        self._config = config
        sensors, numbers = config.sensors, count()
        self._tilting = sensors.tilt_scans
        self._tilt_cycles = TiltCycles(config, numbers)
        self._timed_cycles = TimedCycles(config, numbers)
        self._builder = PartMapBuilder(config, rule)
        self.dropped: Counter[str] = Counter()
        others = (*sensors.depth_images, *sensors.point_clouds)
        self._waiting = _Waiting((*self._tilting, *others), self._tilting)
        self._open: list[CycleRecord] = []
        self._angles: dict[str, list[tuple[int, float]]] = {}
        self._tilt_role: str | None = None

    def clear(self) -> None:
        """Clear all records of the open cycle, after a jump of the clock."""
        self.dropped["clock jump"] += len(self._waiting) + count_begun(self._open)
        self._waiting.clear()
        self._open = []
        self._angles.clear()
        self._tilt_role = None
        self._builder.clear()
        self._tilt_cycles.clear()
        self._timed_cycles.clear()

    def add_tilt(self, role: str, stamp_ns: int, angle: float) -> None:
        """Add the next tilt angle of a laser, in stamp order.

        Parameters
        ----------
        role
            Role of the laser's scans.
        stamp_ns, angle
            Stamp of the joint sample, and angle, rad.
        """
        if role == self._tilt_role:
            self._tilt_cycles.add(stamp_ns, angle)
        elif self._tilt_role is None:
            self._angles.setdefault(role, []).append((stamp_ns, angle))

    def add(self, record: CycleRecord) -> None:
        """Add the next record of a sensor, in stamp order."""
        self._waiting.add(record)

    def add_complete(self, role: str, until_ns: int) -> None:
        """Note that no record of a sensor older than `until_ns` will arrive."""
        self._waiting.complete_ns[role] = until_ns

    def finish(self) -> list[TiltCycleData]:
        """Close the open cycle at the end of the input; return the complete cycles."""
        spans = self._cycles()
        complete_ns = dict(self._waiting.complete_ns)
        self._waiting.complete_ns = dict.fromkeys(self._waiting.queues, END_OF_TIME)
        cycles = self._take(spans)
        spans.finish()
        cycles += self._take(spans)
        self._waiting.complete_ns = complete_ns
        self.dropped["no joint samples"] += len(self._waiting)
        self._waiting.clear()
        return cycles

    def take(self) -> list[TiltCycleData]:
        """Bin the records whose cycle is certain, and return the complete cycles.

        The open tilt cycle is closed if no further joint samples can arrive for it.
        """
        if not self._waiting.is_decided:
            return []
        spans = self._cycles()
        if spans is self._tilt_cycles:
            complete_ns = self._waiting.complete_ns.get(self._tilt_role or "", START_OF_TIME)
        else:
            complete_ns = self._waiting.complete_all_ns
        spans.advance(complete_ns)
        return self._take(spans)

    def _cycles(self) -> TiltCycles | TimedCycles:
        """Return the source of cycles: the first tilting laser, once there is one, else time."""
        if self._tilt_role is not None:
            return self._tilt_cycles
        known = (r for r in self._tilting if r in self._angles or self._waiting.is_known(r))
        self._tilt_role = next(known, None)
        if self._tilt_role is None:
            return self._timed_cycles
        for sample in self._angles.pop(self._tilt_role, ()):
            self._tilt_cycles.add(*sample)
        self._angles.clear()
        self._timed_cycles.finish()  # a laser started late: close the timed cycle
        self._tilt_cycles.closed.extendleft(reversed(self._timed_cycles.closed))
        self._timed_cycles.clear()
        return self._tilt_cycles

    def _take(self, spans: TiltCycles | TimedCycles) -> list[TiltCycleData]:
        cycles: list[TiltCycleData] = []
        closed = spans.closed
        while True:
            queue = self._waiting.next()
            if queue is not None:
                record = queue[0]
                spans.advance_to(record.start_ns, record.posed.T_odom_base[0])
                if not closed and not spans.is_certain(record):
                    return cycles
                before, rest = record.cut(closed[0].end_ns) if closed else (record, None)
                queue.popleft()
                if rest is not None:
                    queue.appendleft(rest)
                if before is not None:
                    is_used = bool(closed[0].cycle is not None if closed else spans.is_moving)
                    self._use(before, is_used, closed[0].reason if closed else "joint rests")
                if rest is None:
                    continue
            elif not closed or closed[0].end_ns > self._waiting.complete_all_ns:
                return cycles
            cycle = self._close(closed.popleft())
            if cycle is not None:
                cycles.append(cycle)

    def _use(self, record: CycleRecord, is_used: bool, reason: str) -> None:
        """Add a record to the open part map, or count it as dropped if it begins here."""
        if is_used:
            record.bin(self._builder)
            self._open.append(record)
        elif record.is_whole:
            self.dropped[reason] += 1

    def _close(self, span: Span) -> TiltCycleData | None:
        records, self._open = self._open, []
        cycle = self._cycle_data(span, records)
        # A new region is used from the next tilt cycle on: a part map has one region.
        self._builder.set_region(self._config.map.region)
        return cycle

    def _cycle_data(self, span: Span, records: list[CycleRecord]) -> TiltCycleData | None:
        if span.cycle is None:
            self.dropped[span.reason] += count_begun(records)
            self._builder.clear()
            return None
        stamps = [s for s in (record.stamps_ns() for record in records) if s is not None]
        start_ns = min((s[0] for s in stamps), default=span.start_ns)
        end_ns = max((s[1] for s in stamps), default=span.end_ns - 1)
        return TiltCycleData(span, self._builder.close(span.cycle, start_ns, end_ns), records)


def count_begun(records: Iterable[CycleRecord]) -> int:
    """Return the number of records that begin in a cycle; a divided record is counted once."""
    return sum(record.is_whole for record in records)


def _pose_samples(
    records: Iterable[CycleRecord], poses_of: Callable[[Posed], Float64]
) -> tuple[Int64, Float64]:
    """Return the distinct stamps and poses (K, 4, 4) of records."""
    chosen = [record.posed for record in records]
    if not chosen:
        return np.zeros(0, np.int64), np.zeros((0, 4, 4))
    stamps = np.concatenate([posed.pose_stamps_ns for posed in chosen])
    poses = np.concatenate([poses_of(posed) for posed in chosen])
    stamps, first = np.unique(stamps, return_index=True)
    return stamps, poses[first]


def _pose_at(stamps: Int64, poses: Float64, stamp_ns: int) -> Float64:
    if len(stamps) == 0:
        return np.eye(4)
    after = int(np.clip(np.searchsorted(stamps, stamp_ns), 1, max(len(stamps) - 1, 1)))
    if len(stamps) == 1:
        return poses[0]
    span = stamps[after] - stamps[after - 1]
    fraction = float(np.clip((stamp_ns - stamps[after - 1]) / span, 0.0, 1.0))
    return interpolate_poses(poses[after - 1], poses[after], fraction)
