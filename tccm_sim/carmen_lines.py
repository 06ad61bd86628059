"""Read the lines of CARMEN logs.

Formats as documented in the headers of logs; angles in rad, distances in m, times in s::

    FLASER n r1 .. rn  x y theta  odom_x odom_y odom_theta  ipc_time host logger_time
    ROBOTLASER1 type start fov resolution max accuracy remission n r1 .. rn  m v1 .. vm
                x y theta  robot_x robot_y robot_theta  tv rv forward side turn  ipc_time host ..
    RAWLASER1   type start fov resolution max accuracy remission n r1 .. rn  m v1 .. vm
                ipc_time host logger_time
    ODOM x y theta tv rv accel  ipc_time host logger_time
    PARAM name value ..

In some logs the stated number of readings is one less than in the FLASER line; the poses then end
at the position of the host name.
"""

from __future__ import annotations

import bz2
import gzip
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import LogError, one_line

MAX_LINE = 2**20
"""Maximum length of a line, bytes. Chosen: a longer one is damaged."""
MAX_LOG = 2**33
"""Maximum size of a decompressed log, bytes. Chosen: a larger one is a compression bomb."""

MAX_BEAMS = 20_000
"""Maximum number of readings of a valid line. Chosen: far above that of any laser."""
MAX_COORDINATE = 1e7
"""Maximum coordinate of a valid line, m. Chosen: far above that of any log."""

MAX_TIME_S = 2**31 - 1
"""Maximum stamp, s: messages have 32 bits of seconds."""

WIDE = {541: (-0.75 * math.pi, math.radians(0.5)), 1081: (-0.75 * math.pi, math.radians(0.25))}
"""First bearing and step of lasers with 270 degrees, by number of beams; others have 180."""

SCAN_KINDS = ("FLASER", "ROBOTLASER1", "RAWLASER1")
"""Kinds of scan lines by preference; a log with several kinds repeats the same scans."""

Pose2 = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class ScanLine:
    """A scan of a log.

    Attributes
    ----------
    index
        Index among the scans of its kind in the file, from 0, including damaged ones.
    line
        Line number in the file, from 0.
    time_ns, logged_ns
        ipc_time and logger_time, ns; the latter is -1 if missing.
    stated
        Number of readings stated by the line.
    angle_min, angle_increment
        First bearing and step, rad.
    range_max
        Maximum range stated by the line, m; 0 if missing.
    ranges
        float64 (N,), m, as logged.
    laser, odometry
        Poses of laser and base in the odometry frame (x, y, yaw); None if missing.
    """

    index: int
    line: int
    time_ns: int
    logged_ns: int
    stated: int
    angle_min: float
    angle_increment: float
    range_max: float
    ranges: Float64
    laser: Pose2 | None
    odometry: Pose2 | None


@dataclass(frozen=True, slots=True)
class OdomLine:
    """An ODOM line.

    Attributes
    ----------
    line
        Line number in the file, from 0.
    time_ns
        ipc_time, ns.
    pose
        x, y, yaw in the odometry frame, m and rad.
    """

    line: int
    time_ns: int
    pose: Pose2


@dataclass
class CarmenLog:
    """The lines of a log by kind, in file order.

    Attributes
    ----------
    scans
        Scans by kind.
    odometry
        ODOM lines.
    parameters
        PARAM lines.
    damaged
        Number of lines of a known kind that cannot be read.
    counts
        Number of all lines by kind.
    """

    scans: dict[str, list[ScanLine]] = field(default_factory=dict)
    odometry: list[OdomLine] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    damaged: int = 0
    counts: dict[str, int] = field(default_factory=dict)


def read_log(path: Path) -> CarmenLog:
    """Read a CARMEN log, plain or compressed by bzip2 or gzip.

    Raises
    ------
    LogError
        If the file cannot be read, is truncated within its compression, or is not a text log.
    """
    log = CarmenLog()
    try:
        with _open(path) as stream:
            for number, line in enumerate(_lines(stream)):
                _take(log, line, number)
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(f"{path}: cannot be read ({one_line(error)})") from None
    except OverflowError as error:
        raise LogError(f"{path}: {one_line(error)}") from None
    _drop_miscounted(log)
    return log


def _open(path: Path) -> IO[bytes]:
    """Open a file according to its first bytes, regardless of its suffix."""
    with path.open("rb") as stream:
        head = stream.read(3)
    if head == b"BZh":
        return bz2.open(path, "rb")
    if head[:2] == b"\x1f\x8b":
        return gzip.open(path, "rb")  # type: ignore[return-value]
    return path.open("rb")


def _lines(stream: IO[bytes]) -> Iterator[bytes]:
    total = 0
    while line := stream.readline(MAX_LINE):
        total += len(line)
        if total > MAX_LOG:
            raise OverflowError(f"more than {MAX_LOG} bytes, no log is as large")
        yield line


def _take(log: CarmenLog, line: bytes, number: int) -> None:
    """Add a line to the log."""
    first = line[:64].split(None, 1)
    kind = first[0].decode("ascii", "replace") if first else ""
    if kind not in (*SCAN_KINDS, "ODOM", "PARAM"):
        return
    words = line.decode("ascii", "replace").split()
    index = log.counts.get(kind, 0)
    log.counts[kind] = index + 1
    try:
        if kind == "PARAM":
            log.parameters[words[1]] = words[2]
        elif kind == "ODOM":
            log.odometry.append(OdomLine(number, _time_ns(words[7]), _pose(words[1:4])))
        else:
            read = _flaser if kind == "FLASER" else _new_laser
            log.scans.setdefault(kind, []).append(read(words, index, number))
    except (ValueError, IndexError):
        log.damaged += 1


def _drop_miscounted(log: CarmenLog) -> None:
    """Drop lines whose number of readings differs from the stated one, unless most lines do.

    In a single such line, a reading was split in two, and the bearings after it are wrong.
    """
    for kind, scans in log.scans.items():
        counted = [scan for scan in scans if len(scan.ranges) == scan.stated]
        if 2 * len(counted) >= len(scans):
            log.damaged += len(scans) - len(counted)
            log.scans[kind] = counted


def _flaser(words: list[str], index: int, number: int) -> ScanLine:
    ranges, after = _readings(words, 1)
    stated = len(ranges)
    if len(words) > after + 8 and _is_number(words[after + 7]) and not _is_number(words[after + 8]):
        ranges, after = np.append(ranges, float(words[after])), after + 1
    rest = words[after:]
    angle_min, increment = _bearings(len(ranges))
    return ScanLine(
        index,
        number,
        _time_ns(rest[6]),
        _logged_ns(rest[8:9]),
        stated,
        angle_min,
        increment,
        0.0,
        ranges,
        _pose(rest[:3]),
        _pose(rest[3:6]),
    )


def _new_laser(words: list[str], index: int, number: int) -> ScanLine:
    """Read ROBOTLASER1 and RAWLASER1, of which only the first has poses."""
    start, _, step, range_max = _numbers(words[2:6])
    ranges, after = _readings(words, 8)
    _, after = _readings(words, after)
    rest = words[after:]
    laser = odometry = None
    if words[0].startswith("ROBOT"):
        laser, odometry, rest = _pose(rest[:3]), _pose(rest[3:6]), rest[11:]
    return ScanLine(
        index,
        number,
        _time_ns(rest[0]),
        _logged_ns(rest[2:3]),
        len(ranges),
        start,
        step,
        range_max,
        ranges,
        laser,
        odometry,
    )


def _readings(words: list[str], at: int) -> tuple[Float64, int]:
    """Return the readings, whose number is words[at], and the index of the next word."""
    count = int(words[at])
    end = at + 1 + count
    if not 0 <= count <= MAX_BEAMS or end > len(words):
        raise ValueError("readings are missing")
    return np.array(list(map(float, words[at + 1 : end]))), end


def _bearings(beams: int) -> tuple[float, float]:
    """Return first bearing and step of a FLASER scan; 180 and 360 beams end one step early."""
    if beams < 2:
        raise ValueError("a scan of less than two beams")
    if beams in WIDE:
        return WIDE[beams]
    return -0.5 * math.pi, math.pi / (beams if beams % 2 == 0 else beams - 1)


def _numbers(words: list[str]) -> list[float]:
    values = [float(word) for word in words]
    if not all(math.isfinite(value) and abs(value) < MAX_COORDINATE for value in values):
        raise ValueError("a number that is not finite")
    return values


def _pose(words: list[str]) -> Pose2:
    x, y, theta = _numbers(words)
    return x, y, theta


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _logged_ns(words: list[str]) -> int:
    """Return the logger's time, ns, or -1 if missing."""
    try:
        return _time_ns(words[0])
    except (ValueError, IndexError):
        return -1


def _time_ns(word: str) -> int:
    """Return a time in s as exact ns; a float64 resolves only 0.1 us at the current epoch."""
    whole, _, part = word.partition(".")
    if not (whole.isdigit() and (part.isdigit() or not part)) or int(whole) > MAX_TIME_S:
        raise ValueError(f"no time: {word}")
    return int(whole) * 1_000_000_000 + int(part[:9].ljust(9, "0"))
