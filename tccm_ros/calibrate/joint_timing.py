"""Estimate the delay between the stamps of a tilting laser and those of its joint.

A surface that is seen while the laser tilts up and again while it tilts down is mapped twice if the
joint's stamps are late or early. With the right delay, the points of two consecutive tilt cycles
fill the same voxels.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import TopicChoice, add_latched
from tccm_ros.config import Config
from tccm_ros.cuboids.tilt_cycle import TiltCycles
from tccm_ros.records import PosedScan, TiltAngle
from tccm_ros.robot import MountKind, Robot
from tccm_ros.robot.tracks import interpolate_transforms, pose_to_numbers
from tccm_ros.sensors.laser_scan import beam_stamps, bearings, valid_beams

MIN_PAIRS, MAX_PAIRS = 3, 4
"""Minimum and maximum number of pairs of tilt cycles: the maximum limits the computing time, the
minimum gives a majority (chosen)."""

MAX_POINTS = 5_000
"""Maximum number of points of a tilt cycle (chosen: limits the computing time)."""

READ_TIME = 30.0
"""Duration (s) of a recording to read (chosen: lasers tilt up and down in some seconds)."""

VOXELS = 0.1, 0.05, 0.05
"""Edges of the voxels of the searches, m (chosen: 50 ms move points at 3 m by the first if a laser
tilts at 40 deg/s)."""

STEPS, MAX_DELAY = (0.05, 0.01, 0.002), 0.6
"""Steps of the candidate delays of the searches, each around the best delay of the one before, and
the maximum delay, s. Chosen: the first peak is 0.1 s wide; the last ones of correct recordings are
within 2 ms of 0; larger delays approach half a tilt cycle."""

MIN_GAIN = 0.1
"""Minimum gain of agreement in each of a majority of pairs, as a fraction of the voxels (chosen:
correct recordings gain up to 0.02, a delay of 0.1 s some 0.3)."""

MAJORITY = 0.75
"""Fraction of the pairs that must gain (chosen: one may differ, as something moved)."""

ROLES = ("joint_states", "robot_description", "tf", "tf_static", "odom")
"""Roles that determine the pose of the tilting laser."""


Hits = tuple[Float64, Int64]
"""Points in the laser's frame (N, 3), m, and their stamps (N,), ns."""


class JointTiming(NamedTuple):
    """The estimated delay of a tilting laser's joint.

    Attributes
    ----------
    time_offset
        Value of ``rig.joint_time_offset``, s, with which tilting up and down agree best.
    agreement
        Fraction of voxels in common of two consecutive tilt cycles, as configured and with it.
    is_significant
        Whether the configured offset is wrong.
    """

    time_offset: float
    agreement: tuple[float, float]
    is_significant: bool

    def text(self) -> str:
        """Return the finding as one line."""
        before, after = (100.0 * fraction for fraction in self.agreement)
        return (
            f"rig.joint_time_offset={self.time_offset:.2f} makes tilting up and down agree in "
            f"{after:.0f} % of the space they fill instead of {before:.0f} %: stamps of the joint "
            "and of the tilting laser contradict each other"
        )


def joint_timing(reader: BagReader, choice: TopicChoice, config: Config) -> JointTiming | None:
    """Return the delay of a bag's tilting laser; None if it is not observable.

    Parameters
    ----------
    reader
        The bag, with the readers of `choice`.
    choice
        Its topics.
    config
        Believed values of ``rig.*``.

    Raises
    ------
    BagError
        If the bag is damaged.
    """
    tilting = [s for s in choice.streams if s.mount is MountKind.TILTING][:1]
    if not tilting or not choice.counts[tilting[0].role]:
        return None
    topics = {role: choice.topics[role] for role in (*ROLES, tilting[0].role)}
    robot = Robot(config, tilting, expects_odometry=choice.counts["odom"] > 0)
    timer = JointTimer(config, tilting[0].role)
    add_latched(reader, topics, robot)
    for role, log_ns, record in reader.records(topics):
        for event in robot.add(role, record):
            timer.add(event)
        if timer.is_full or log_ns - reader.start_ns > READ_TIME * 1e9:
            break
    return timer.estimate()


def with_joint_timing(config: Config, timing: JointTiming | None) -> Config:
    """Return a configuration with a significant delay, unless it has one."""
    if timing is None or not timing.is_significant or config.rig.joint_time_offset != 0.0:
        return config
    corrected = config.model_copy(deep=True)
    corrected.rig.joint_time_offset = timing.time_offset
    return corrected


class JointTimer:
    """Collects the scans of the first tilt cycles for `estimate`.

    Parameters
    ----------
    config
        Configuration with which the scans were posed.
    role
        Role of the tilting laser.
    """

    def __init__(self, config: Config, role: str) -> None:
        self._config, self._role = config, role
        self._cycles = TiltCycles(config)
        self._scans: list[PosedScan] = []

    def add(self, event: object) -> None:
        """Add a scan of the laser or a tilt angle; other events are ignored."""
        if getattr(event, "role", None) != self._role:
            return
        if isinstance(event, PosedScan):
            self._scans.append(event)
        elif isinstance(event, TiltAngle):
            self._cycles.add(event.stamp_ns, event.angle)

    @property
    def is_full(self) -> bool:
        """Whether there are enough tilt cycles."""
        return sum(span.cycle is not None for span in self._cycles.closed) > MAX_PAIRS + 1

    def estimate(self) -> JointTiming | None:
        """Return the delay with which tilting up and down agree; None with too few cycles."""
        spans = [(s.start_ns, s.end_ns) for s in self._cycles.closed if s.cycle]  # 0 is partial
        hits = [found for span in spans if len((found := self._hits(*span))[1])]
        pairs = list(pairwise(hits))[:MAX_PAIRS]
        if len(pairs) < MIN_PAIRS:
            return None
        search = _Search(pairs, self._scans, VOXELS[0])
        before = self._config.rig.joint_time_offset
        if all(search.is_better(0.0, delay) for delay in (-STEPS[0], STEPS[0])):
            agreement = float(np.median(search.agreement(0.0)))
            return JointTiming(before, (agreement, agreement), False)
        best = search.best_within(0.0, MAX_DELAY, STEPS[0])
        first, last = (float(np.median(search.agreement(delay))) for delay in (0.0, best))
        is_significant = search.is_better(best, 0.0)
        for width, step, voxel in zip(STEPS, STEPS[1:], VOXELS[1:]) if is_significant else ():
            best = _Search(pairs, self._scans, voxel).best_within(best, width, step)
        return JointTiming(round(before + best, 3), (first, last), is_significant)

    def _hits(self, start_ns: int, end_ns: int) -> Hits:
        """Return a sample of the hits of a tilt cycle."""
        scans = [p.scan for p in self._scans if start_ns <= p.scan.stamp_ns < end_ns]
        every = max(sum(len(scan.ranges) for scan in scans) // MAX_POINTS, 1)
        points, stamps = [np.zeros((0, 3))], [np.zeros(0, np.int64)]
        for scan in scans:
            beams = np.flatnonzero(valid_beams(scan, self._config))[::every]
            angles, ranges = bearings(scan)[beams], scan.ranges[beams].astype(np.float64)
            x, y = ranges * np.cos(angles), ranges * np.sin(angles)
            points.append(np.column_stack([x, y, np.zeros_like(x)]))
            stamps.append(beam_stamps(scan)[beams])
        return np.concatenate(points), np.concatenate(stamps)


class _Search:
    """The agreement of pairs of tilt cycles by delay.

    Parameters
    ----------
    pairs
        Hits of consecutive tilt cycles.
    scans
        All scans, with their poses.
    voxel
        Edge of the voxels, m.
    """

    def __init__(
        self, pairs: Sequence[tuple[Hits, Hits]], scans: Sequence[PosedScan], voxel: float
    ) -> None:
        self._pairs, self._voxel = pairs, voxel
        self._laser = _pose_samples(scans, "T_base_laser")
        self._base = _pose_samples(scans, "T_odom_base")
        self._known: dict[float, Float64] = {}

    def agreement(self, delay: float) -> Float64:
        """Return the fraction of voxels that both tilt cycles of each pair fill, float64 (P,)."""
        delay = round(delay, 3)
        if delay not in self._known:
            fractions = []
            for pair in self._pairs:
                up, down = (self._filled(*hits, round(delay * 1e9)) for hits in pair)
                both = len(np.intersect1d(up, down, assume_unique=True))
                fractions.append(both / min(len(up), len(down)))
            self._known[delay] = np.array(fractions)
        return self._known[delay]

    def best_within(self, middle: float, width: float, step: float) -> float:
        """Return the delay with the best agreement within a distance of another."""
        delays = (middle + np.arange(-width, width + step / 2, step)).tolist()
        return max(delays, key=lambda delay: float(np.median(self.agreement(delay))))

    def is_better(self, delay: float, other: float) -> bool:
        """Return whether a delay agrees significantly better than another."""
        gains = self.agreement(delay) - self.agreement(other)
        return float(np.quantile(gains, 1.0 - MAJORITY)) > MIN_GAIN

    def _filled(self, points: Float64, stamps_ns: Int64, delay_ns: int) -> Int64:
        """Return the keys of the voxels that hits fill, sorted."""
        for samples, at_ns in ((self._laser, stamps_ns - delay_ns), (self._base, stamps_ns)):
            T = interpolate_transforms(*samples, np.clip(at_ns, samples[0][0], samples[0][-1]))
            points = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
        # rint: floor and ceiling at whole multiples are in the middle of a voxel
        x, y, z = (np.rint(points / self._voxel).astype(np.int64) & 0x1FFFFF).T
        return np.unique((x << 42) | (y << 21) | z)


def _pose_samples(scans: Sequence[PosedScan], name: str) -> tuple[Int64, Float64]:
    """Return stamps (K,), ns, and numbers (K, 7) of all poses of a kind, without duplicates."""
    stamps = np.concatenate([posed.pose_stamps_ns for posed in scans])
    poses = np.concatenate([getattr(posed, name) for posed in scans])
    stamps, firsts = np.unique(stamps, return_index=True)
    return stamps, np.array([pose_to_numbers(np.ascontiguousarray(poses[k])) for k in firsts])
