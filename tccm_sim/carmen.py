"""Import a CARMEN log: write a bag that replays with default settings.

The order of lines in a log is the true order, but its stamps may step back. The bag has strictly
increasing stamps as near to the logged ones as possible; ``stamps.csv`` has both for each scan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.bags.writer import BagWriter
from tccm_ros.errors import LogError, OutputError
from tccm_ros.geometry import between2, spatial, wrap_angle
from tccm_ros.progress import Bars
from tccm_ros.records import Odometry, RobotDescription, Scan, TransformSample
from tccm_sim.carmen_lines import SCAN_KINDS, CarmenLog, OdomLine, ScanLine, read_log
from tccm_sim.log_times import increasing_stamps, without_outliers, without_resets
from tccm_sim.messages import write_records

BASE, LASER, ODOM = "base_link", "laser", "odom"

SICK_NO_RETURN_M = 81.8
"""Codes 8183 to 8191 cm of the SICK LMS mean no return or dazzle (manual of the LMS 2xx)."""

SICK_RANGE_M = 80.0
"""Maximum range of the SICK LMS, m (manual of the LMS 2xx); used if a log has none."""
RANGE_MIN_M = 0.02
"""Minimum range if a log has none, m. Chosen."""

SENTINEL_FRACTION = 1e-3
SENTINEL_RATIO = 20.0
"""The largest reading means no return if at least this fraction of all readings equals it, and its
count is this multiple of the median count of values in the upper half. Chosen: measured distances
are noisy, or repeat about equally often."""

MAX_OFFSET_SPREAD = 0.005
"""Maximum interquartile range of the laser's offset, m and rad. Beyond it the poses are corrected
ones, and their difference from odometry is not the laser's offset. Chosen."""

CARMEN_OFFSET = "robot_frontlaser_offset"


@dataclass(frozen=True)
class ImportedLog:
    """Summary of an imported log.

    Attributes
    ----------
    kind
        Kind of the scan lines.
    scans, odometry
        Numbers of messages written.
    damaged
        Number of lines that could not be read, and of scans with an outlier stamp.
    steps_back
        Number of scans logged with an earlier time than the previous one.
    moved_s
        Largest change of a stamp, s.
    laser
        Pose of the laser in the base (x, y, yaw).
    range_max
        Maximum range, m.
    """

    kind: str
    scans: int
    odometry: int
    damaged: int
    steps_back: int
    moved_s: float
    laser: tuple[float, float, float]
    range_max: float

    def __str__(self) -> str:
        x, y, yaw = self.laser
        return (
            f"{self.scans} scans ({self.kind}), {self.odometry} odometry, {self.damaged} damaged "
            f"lines; {self.steps_back} stamps step back, changed by up to {self.moved_s:.3f} s; "
            f"laser at {x:g} {y:g} m, {yaw:g} rad; ranges to {self.range_max:g} m"
        )


def import_carmen(
    log: Path | str, out: Path | str, *, overwrite: bool = False, bars: Bars | None = None
) -> ImportedLog:
    """Write a bag with /scan, /odom, /tf_static and /robot_description of a CARMEN log.

    Parameters
    ----------
    log
        A .clf or .log file, plain or compressed by bzip2 or gzip.
    out
        Output folder, also for stamps.csv.
    overwrite
        Whether to replace an existing `out`.
    bars
        Progress bars.

    Raises
    ------
    LogError
        If the log cannot be read or has no scans.
    OutputError
        If `out` cannot be written.
    """
    log, out = Path(log), Path(out)
    if out.suffix == ".mcap":
        raise OutputError(f"{out}: name a folder; stamps.csv is written beside the messages")
    bars = bars or Bars()
    bars.start("read", 1.0)
    read = read_log(log)
    kind = next((kind for kind in SCAN_KINDS if read.scans.get(kind)), None)
    if kind is None:
        found = ", ".join(f"{n} {name}" for name, n in sorted(read.counts.items())) or "none"
        raise LogError(
            f"{log}: no scans; expected lines of {', '.join(SCAN_KINDS)}, lines found: {found} "
            f"({read.damaged} damaged)"
        )
    scans = without_outliers(read.scans[kind])
    read.odometry = without_outliers(read.odometry)
    times, clock = _clock(scans, read)
    stamps = increasing_stamps(times)
    laser = _laser_offset(scans, read)
    no_return, range_max = _no_return(scans)
    bars.start("write", len(scans), "scans")
    with BagWriter(out, overwrite=overwrite) as writer:
        _write_mount(writer, stamps[0], laser)
        for scan, stamp in zip(scans, stamps, strict=True):
            _write_scan(writer, scan, stamp, no_return, range_max)
            bars.advance(1.0)
        written = _write_odometry(writer, scans, stamps, read, clock)
        (writer.folder / "stamps.csv").write_text(_stamps_csv(scans, stamps), encoding="ascii")
    return ImportedLog(
        kind=kind,
        scans=len(scans),
        odometry=written,
        damaged=read.damaged + len(read.scans[kind]) - len(scans),
        steps_back=sum(b.time_ns < a.time_ns for a, b in pairwise(scans)),
        moved_s=max(abs(a - b) for a, b in zip(times, stamps)) * 1e-9,
        laser=(float(laser[0]), float(laser[1]), float(laser[2])),
        range_max=range_max,
    )


def _clock(scans: list[ScanLine], log: CarmenLog) -> tuple[list[int], dict[int, int]]:
    """Return a monotonic time for each scan, and for each line by its number, ns.

    If the computers' clock is constant, the logger's clock is used.
    """
    if len({scan.time_ns for scan in scans}) == 1 and len({s.logged_ns for s in scans}) > 1:
        times = without_resets([scan.logged_ns for scan in scans])
        return times, {scan.line: time for scan, time in zip(scans, times)}
    lines: list[ScanLine | OdomLine] = [*scans, *log.odometry]
    lines.sort(key=lambda line: line.line)
    times = without_resets([line.time_ns for line in lines])
    at = {line.line: time for line, time in zip(lines, times)}
    return [at[scan.line] for scan in scans], at


def _laser_offset(scans: list[ScanLine], log: CarmenLog) -> Float64:
    """Return the pose of the laser in the base (3,): median of pose minus odometry."""
    pairs = [(s.odometry, s.laser) for s in scans if s.odometry and s.laser]
    if pairs:
        odometry, laser = np.moveaxis(np.array(pairs), 1, 0)
        offsets = between2(odometry, laser)
        offsets[:, 2] = wrap_angle(offsets[:, 2])
        low, median, high = np.percentile(offsets, [25, 50, 75], axis=0)
        if (high - low).max() < MAX_OFFSET_SPREAD:
            return np.round(median, 4) + 0.0
    try:
        forward = float(log.parameters.get(CARMEN_OFFSET, "0"))
    except ValueError:
        forward = 0.0
    return np.array([forward if abs(forward) < 10.0 else 0.0, 0.0, 0.0])


def _no_return(scans: list[ScanLine]) -> tuple[float, float]:
    """Return the smallest reading that means no return, and the maximum valid range, m."""
    stated = max(scan.range_max for scan in scans)
    if 0.0 < stated < SICK_NO_RETURN_M:
        return stated, stated
    readings = np.concatenate([scan.ranges for scan in scans])
    readings = readings[(readings > 0.0) & (readings < SICK_NO_RETURN_M)]
    values, counts = np.unique(readings, return_counts=True)
    if len(values) == 0:
        return SICK_NO_RETURN_M, SICK_RANGE_M
    top, others = float(values[-1]), counts[:-1][values[:-1] > 0.5 * values[-1]]
    typical = float(np.median(others)) if len(others) else 1.0
    if counts[-1] >= max(SENTINEL_FRACTION * len(readings), SENTINEL_RATIO * typical):
        return top, top
    return SICK_NO_RETURN_M, SICK_RANGE_M


def _write_mount(writer: BagWriter, stamp: int, laser: Float64) -> None:
    x, y, yaw = laser.tolist()
    urdf = (
        '<?xml version="1.0"?>\n<robot name="carmen">\n'
        f'  <link name="{BASE}"/>\n  <link name="{LASER}"/>\n'
        f'  <joint name="{LASER}_joint" type="fixed">\n'
        f'    <parent link="{BASE}"/>\n    <child link="{LASER}"/>\n'
        f'    <origin xyz="{x:g} {y:g} 0" rpy="0 0 {yaw:g}"/>\n  </joint>\n</robot>\n'
    )
    mount = TransformSample(stamp, BASE, LASER, spatial(laser), True)
    write_records(writer, "/robot_description", stamp, RobotDescription(urdf))
    write_records(writer, "/tf_static", stamp, mount)


def _write_scan(
    writer: BagWriter, line: ScanLine, stamp: int, no_return: float, range_max: float
) -> None:
    ranges = np.where(line.ranges >= no_return, np.inf, line.ranges)
    scan = Scan(
        stamp_ns=stamp,
        frame_id=LASER,
        angle_min=line.angle_min,
        angle_increment=line.angle_increment,
        time_increment=0.0,
        range_min=RANGE_MIN_M,
        range_max=range_max,
        ranges=ranges.astype(np.float32),
    )
    write_records(writer, "/scan", stamp, scan)
    if line.odometry is not None:
        _write_pose(writer, stamp, line.odometry)


def _write_odometry(
    writer: BagWriter,
    scans: list[ScanLine],
    stamps: Sequence[int],
    log: CarmenLog,
    clock: dict[int, int],
) -> int:
    """Write ODOM lines if the scans have no odometry of their own; return the number of poses.

    A scan line repeats the odometry at its time, and ODOM lines would repeat it at another time.
    """
    paired = sum(scan.odometry is not None for scan in scans)
    if paired:
        return paired
    times = increasing_stamps([clock.get(line.line, line.time_ns) for line in log.odometry])
    for line, stamp in zip(log.odometry, times):
        _write_pose(writer, stamp, line.pose)
    return len(times)


def _write_pose(writer: BagWriter, stamp: int, pose: tuple[float, float, float]) -> None:
    write_records(writer, "/odom", stamp, Odometry(stamp, ODOM, BASE, spatial(pose)))


def _stamps_csv(scans: list[ScanLine], stamps: Sequence[int]) -> str:
    rows = [
        f"{scan.index},{_seconds(scan.time_ns)},{_seconds(stamp)}"
        for scan, stamp in zip(scans, stamps)
    ]
    return "\n".join(["raw_scan_index,ipc_time,stamp", *rows]) + "\n"


def _seconds(time_ns: int) -> str:
    return f"{time_ns // 1_000_000_000}.{time_ns % 1_000_000_000:09d}"
