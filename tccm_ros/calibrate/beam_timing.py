"""Estimate the beam order and latency of a level laser.

Some drivers stamp the end of a rotation instead of its start, or publish the beams of a clockwise
laser in the order of bearings. While the robot turns, scans with wrong beam times are distorted and
disagree with odometry. Pairs of scans are matched for several directions and delays; those for
which matching agrees with odometry are proposed.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import add_latched, choose_topics
from tccm_ros.calibrate.recording import evenly
from tccm_ros.config import Config
from tccm_ros.geometry import planar, transform2, wrap_angle
from tccm_ros.records import Odometry, PosedScan
from tccm_ros.robot import Robot
from tccm_ros.sensors.laser_scan import (
    LEVEL_SCAN,
    beam_stamps,
    bearings,
    timed_scan,
    valid_beams,
)
from tccm_ros.slam.matching.alignment import align
from tccm_ros.slam.matching.level_scan import LevelScan, thin_with_normals
from tccm_ros.slam.matching.line_map import make_line_map
from tccm_ros.slam.odometry_model import odometry_covariance
from tccm_ros.slam.se2 import between_se2, inverse_se2, transform_points

MIN_YAW_RATE = 0.2
"""Minimum yaw rate (rad/s): below it, a scan of 0.1 s is distorted by less than its noise, 3 cm at
1.5 m."""

MIN_PAIRS, MAX_PAIRS = 15, 40
"""Minimum number of pairs of scans, and maximum number to limit the computing time (chosen)."""

MAX_GAP = 0.5
"""Maximum time (s) between two scans of a pair, as odometry drifts (chosen)."""

READ_TIME = 120.0
"""Duration (s) of a recording to read (chosen: robots turn within two minutes)."""

OF_ROBOT = ("joint_states", "robot_description", "tf", "tf_static")
"""Roles that determine the pose of the level laser."""

OFFSETS, FINE_OFFSETS = np.arange(-6, 3) / 4.0, np.array([-1.0, 1.0]) / 8.0
"""Candidate delays in rotations: first, and then around the best of them."""

MAX_CHI2 = 50.0
"""Maximum squared deviation of a step over odometry's variance; beyond it, a match has failed
(chosen)."""

EXPECTED_CHI2, SIGNIFICANT = 3.0, 4.0
"""Expected mean for three degrees of freedom and correct times, and minimum improvement of the mean
over all pairs, in its standard deviations (chosen)."""


class BeamTiming(NamedTuple):
    """A direction and a delay, with the agreement of matching and odometry.

    Attributes
    ----------
    reverse, time_offset
        Values of ``scan.reverse`` and ``scan.time_offset`` (s).
    step_error
        Root mean square difference of steps from odometry: m, rad.
    """

    reverse: bool
    time_offset: float
    step_error: tuple[float, float]


class BeamTimingEstimate(NamedTuple):
    """Estimated beam times of a recording.

    Attributes
    ----------
    configured, best
        Timing as configured, and timing with the best agreement with odometry.
    is_significant
        Whether the configured timing disagrees with odometry and the best one is significantly
        better.
    pairs
        Number of pairs of scans used.
    """

    configured: BeamTiming
    best: BeamTiming
    is_significant: bool
    pairs: int

    def text(self) -> str:
        """Return the proposal as one line."""
        before, after = (_in_words(timing.step_error) for timing in (self.configured, self.best))
        reverse = str(self.best.reverse).lower()
        return (
            f"--set scan.reverse={reverse} --set scan.time_offset={self.best.time_offset:.3f} "
            f"makes level scans agree with odometry while the robot turns: steps differ by {after} "
            f"instead of {before}"
        )


def read_beam_timing(
    bag: Path | str, config: Config | None = None, remap: Sequence[str] = ()
) -> BeamTimingEstimate | None:
    """Return the beam times of a bag's level laser; None if they are not observable.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file.
    config
        Believed values of ``scan.*``.
    remap
        Remappings such as ``scan:=/base_scan``.

    Raises
    ------
    BagError, TopicError
        If the bag cannot be read, or topic names are ambiguous.
    """
    config = config or Config()
    with BagReader(bag) as reader:
        choice = choose_topics(reader, config, remap)
        counts = {info.name: info.count for info in reader.topics()}
        if min(counts.get(choice.topics[role], 0) for role in ("scan", "odom")) < MIN_PAIRS:
            return None
        reader.add_readers(choice.readers)
        topics = {role: choice.topics[role] for role in (*OF_ROBOT, "scan", "odom")}
        streams = [stream for stream in choice.streams if stream.role == LEVEL_SCAN.role]
        robot, timer = Robot(config, streams, expects_odometry=True), BeamTimer(config)
        add_latched(reader, topics, robot)
        for role, log_ns, record in reader.records(topics):
            for event in robot.add(role, record):
                timer.add(event)
            if log_ns - reader.start_ns > READ_TIME * 1e9:
                break
    return timer.estimate()


class BeamTimer:
    """Collects level scans and odometry for `estimate`.

    Parameters
    ----------
    config
        ``scan.*`` with which the scans were read, ``matching.*`` and ``odometry.*``.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._scans: list[PosedScan] = []
        self._odometry: dict[int, Float64] = {}

    def add(self, event: object) -> None:
        """Add a posed level scan or an odometry sample; other events are ignored."""
        if isinstance(event, PosedScan) and event.has_odometry:
            self._scans.append(event)
        elif isinstance(event, Odometry):
            self._odometry[event.stamp_ns] = planar(event.T_odom_base)

    def estimate(self) -> BeamTimingEstimate | None:
        """Return the timing that agrees with odometry; None with too few pairs of scans."""
        track = _Track(self._odometry)
        pairs = list(_turning_pairs(self._scans, track))
        if len(pairs) < MIN_PAIRS:
            return None
        pairs = [pairs[k] for k in evenly(len(pairs), MAX_PAIRS)]
        limits, rotation = self._config.scan, _rotation(pairs)
        steps = [_Steps(self._config, track, pairs, limits.reverse, limits.time_offset)]
        if _mean_chi2(steps[0]) <= EXPECTED_CHI2:
            return BeamTimingEstimate(steps[0].timing, steps[0].timing, False, len(pairs))
        for reverse in (False, True)[: 1 + (pairs[0][0].scan.time_increment != 0.0)]:
            for offset in OFFSETS * rotation:
                steps.append(_Steps(self._config, track, pairs, reverse, offset))
        near = min(steps, key=_mean_chi2).timing
        for offset in near.time_offset + FINE_OFFSETS * rotation:
            steps.append(_Steps(self._config, track, pairs, near.reverse, offset))
        configured, best = steps[0], min(steps, key=_mean_chi2)
        gain = configured.chi2 - best.chi2
        is_sure = float(gain.mean()) > SIGNIFICANT * float(gain.std()) / len(gain) ** 0.5
        return BeamTimingEstimate(configured.timing, best.timing, is_sure, len(pairs))


def _rotation(pairs: Sequence[tuple[PosedScan, PosedScan]]) -> float:
    """Return the duration (s) of a rotation, from beam times or else between scans."""
    scan = pairs[0][0].scan
    beams = abs(scan.time_increment) * len(scan.ranges)
    return beams or min((b.scan.stamp_ns - a.scan.stamp_ns) * 1e-9 for a, b in pairs)


class _Track:
    """Planar poses of odometry over time."""

    def __init__(self, samples: dict[int, Float64]) -> None:
        self.stamps_ns = np.array(sorted(samples), np.int64)
        self._poses = np.array([samples[int(t)] for t in self.stamps_ns]).reshape(-1, 3)
        self._poses[:, 2] = np.unwrap(self._poses[:, 2])

    def at(self, stamps_ns: Int64) -> Float64:
        """Return interpolated poses (N, 3), held at the ends."""
        since, known = ((t - self.stamps_ns[0]).astype(float) for t in (stamps_ns, self.stamps_ns))
        return np.stack([np.interp(since, known, column) for column in self._poses.T], axis=-1)


class _Steps:
    """Steps between pairs of scans for one direction and delay, compared with odometry."""

    def __init__(
        self,
        config: Config,
        track: _Track,
        pairs: Sequence[tuple[PosedScan, PosedScan]],
        reverse: bool,
        time_offset: float,
    ) -> None:
        limits = config.scan
        time_offset = round(float(time_offset), 3)
        changes = {"reverse": reverse != limits.reverse, "time_offset": time_offset}
        timed = config.model_copy(update={"scan": limits.model_copy(update=changes)})
        self.chi2 = np.zeros(len(pairs))
        errors = np.zeros((len(pairs), 3))
        for k, pair in enumerate(pairs):
            first, second = (_level_scan(posed, track, timed, limits.time_offset) for posed in pair)
            by_odometry = between_se2(first.odom, second.odom)
            lines = make_line_map(np.zeros((1, 3)), [first])
            sigma = config.matching.range_sigma
            found = align(lines, second.points, second.normals, by_odometry, sigma)
            errors[k] = between_se2(by_odometry, found.pose)
            variances = np.diag(odometry_covariance(by_odometry, config.odometry))
            self.chi2[k] = min(float(np.sum(errors[k] ** 2 / variances)), MAX_CHI2)
        kept = errors[self.chi2 < MAX_CHI2] if (self.chi2 < MAX_CHI2).any() else errors
        rms = np.sqrt(np.mean(kept**2, axis=0))
        self.timing = BeamTiming(
            reverse, time_offset, (float(np.hypot(rms[0], rms[1])), float(rms[2]))
        )


def _mean_chi2(steps: _Steps) -> float:
    return float(steps.chi2.mean())


def _turning_pairs(
    scans: Sequence[PosedScan], track: _Track
) -> Iterator[tuple[PosedScan, PosedScan]]:
    """Yield consecutive scans while the robot turns, with odometry around them."""
    if len(track.stamps_ns) < MIN_PAIRS:
        return
    first_ns, last_ns = int(track.stamps_ns[0]), int(track.stamps_ns[-1])
    for a, b in itertools.pairwise(scans):
        seconds = (b.scan.stamp_ns - a.scan.stamp_ns) * 1e-9
        margin_ns = 2 * (b.scan.stamp_ns - a.scan.stamp_ns)
        is_inside = a.scan.stamp_ns - margin_ns > first_ns and b.scan.stamp_ns + margin_ns < last_ns
        if 0.0 < seconds < MAX_GAP and is_inside:
            before, after = track.at(np.array([a.scan.stamp_ns, b.scan.stamp_ns]))
            if abs(float(after[2] - before[2])) > MIN_YAW_RATE * seconds:
                yield a, b


def _level_scan(posed: PosedScan, track: _Track, config: Config, read_offset: float) -> LevelScan:
    """Return a scan with corrected beam times."""
    shifted = replace(posed.scan, stamp_ns=posed.scan.stamp_ns - round(read_offset * 1e9))
    scan = timed_scan(shifted, config)
    valid = valid_beams(scan, config)
    angles, T = bearings(scan)[valid], posed.T_base_laser[0]
    directions = np.stack([np.cos(angles), np.sin(angles)])
    in_base = (T[:2, :2] @ directions * scan.ranges[valid]).T + T[:2, 3]
    poses = track.at(beam_stamps(scan)[valid])
    odom = track.at(np.array([scan.stamp_ns]))[0]
    odom[2] = wrap_angle(odom[2])
    in_odom = transform2(poses, in_base[:, None])[:, 0]
    beams = transform_points(inverse_se2(odom), in_odom)
    origin = T[:2, 3].copy()
    points, normals = thin_with_normals(beams, origin, abs(scan.angle_increment))
    return LevelScan(scan.stamp_ns, odom, beams, origin, points, normals)


def _in_words(error: tuple[float, float]) -> str:
    return f"{1e3 * error[0]:.1f} mm and {np.rad2deg(error[1]):.2f} deg"
