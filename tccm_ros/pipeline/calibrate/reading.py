"""Read a bag for calibration: scans by tilt cycle, tilt cycles by place, and level scans."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader, remap_topics
from tccm_ros.config import Config, Rig
from tccm_ros.cuboids.tilt_cycle import Span, TiltCycles
from tccm_ros.errors import BagError, FrameError, TopicError
from tccm_ros.geometry import inverse, planar
from tccm_ros.pipeline.calibrate.recording import CycleScans, LevelScans, Recording, is_near
from tccm_ros.progress import Bars, Silent
from tccm_ros.records import Event, PosedScan, StreamComplete, TiltAngle
from tccm_ros.records.building import Record
from tccm_ros.robot import Robot
from tccm_ros.robot.chain import Chain, JointReading, Part
from tccm_ros.robot.frames import build_chain, find_path, frames_of
from tccm_ros.robot.mount import Mount
from tccm_ros.robot.sensor import Sensor
from tccm_ros.robot.tilt_angle import find_axis
from tccm_ros.robot.tracks import PoseTrack, ScalarTrack, Track
from tccm_ros.robot.urdf import Joint
from tccm_ros.sensors.laser_scan import (
    LEVEL_SCAN,
    TILT_SCAN,
    beam_stamps,
    bearings,
    valid_beams,
)
from tccm_ros.sensors.registry import default_streams

TRACK_MARGIN_NS = 1_000_000_000
"""Joint samples are kept this long before and after a tilt cycle, for time offsets (chosen)."""

MAX_CYCLES = 24
"""Tilt cycles of one bag that are used (chosen: more cost time and add little accuracy)."""

LEVEL_SCANS = 6
"""Level scans that are used at each place (chosen)."""

MIN_SCANS = 8
"""Scans that a tilt cycle must have to be used (chosen)."""

CORRECTIONS = frozenset(
    ("tilt_offset", "tilt_scale", "joint_time_offset", "mount_correction", "level_correction")
)
"""Parameters of the group `rig` that a calibration estimates."""

END_OF_TIME_NS = 2**62
"""Later than every stamp."""


def uncorrected(config: Config) -> Config:
    """Return the configuration with the default values of all corrections of the rig."""
    rig = config.rig.model_copy(update=Rig().model_dump(include=set(CORRECTIONS)))
    return config.model_copy(update={"rig": rig})


def read_recording(
    bag: Path | str,
    config: Config,
    remap: Sequence[str] = (),
    bars: Bars | None = None,
    *,
    max_cycles: int = MAX_CYCLES,
) -> Recording:
    """Read the tilt cycles and the level scans of a bag.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file.
    config
        The configuration; its corrections of the rig are not applied.
    remap
        ``scan:=/base_scan`` for topics with other names.
    bars
        Where progress is shown.
    max_cycles
        Tilt cycles that are used at most, spread over the recording.

    Raises
    ------
    BagError, TopicError, FrameError, UrdfError
        Where the bag cannot be read, has no tilting scans, or the laser's pose cannot be found.
    """
    raw, bars = uncorrected(config), bars or Silent()
    topics = remap_topics(remap, DEFAULT_TOPICS)
    with BagReader(bag) as reader:
        counts = {info.name: info.count for info in reader.topics()}
        if not counts.get(topics["tilt_scan"]):
            raise TopicError(reader.missing("tilt_scan", topics["tilt_scan"]))
        found = _CycleReader(raw, bool(counts.get(topics["odom"])))
        bars.start("read", reader.duration, "s")
        last_ns = reader.start_ns
        for role, log_ns, record in reader.records(topics):
            bars.advance((log_ns - last_ns) * 1e-9)
            last_ns = log_ns
            found.add(role, record)
        found.finish()
    if not found.cycles:
        raise _no_cycle_error(bag, found.tilting)
    return _recording(Path(bag).name, found, max_cycles)


def _no_cycle_error(bag: Path | str, tilting: Sensor) -> BagError | FrameError:
    if tilting.problem is not None:
        return FrameError(f"{bag}: {tilting.problem}")
    reasons = ", ".join(f"{n} {why}" for why, n in sorted(tilting.dropped.items()))
    return BagError(
        f"{bag}: the tilting laser makes no tilt cycle"
        + (f" (dropped: {reasons})" if reasons else "")
    )


class _CycleReader:
    """Collects the scans of the tilting laser by tilt cycle, and those of the level laser.

    A level laser whose pose is not known is left out.
    """

    def __init__(self, config: Config, has_odometry: bool) -> None:
        self._config = config
        self.robot = Robot(config, default_streams(), expects_odometry=has_odometry)
        self._cycles = TiltCycles(config)
        self._tilt_scans: list[PosedScan] = []
        self.level_scans: list[PosedScan] = []
        self.cycles: list[CycleScans] = []
        self._scans = {TILT_SCAN.role: self._tilt_scans, LEVEL_SCAN.role: self.level_scans}
        self._handlers: dict[type, Callable[[Any], object]] = {
            PosedScan: lambda posed: self._scans[posed.role].append(posed),
            TiltAngle: lambda tilt: self._cycles.add(tilt.stamp_ns, tilt.angle),
            StreamComplete: lambda complete: self._close_until(complete.until_ns - TRACK_MARGIN_NS),
        }

    @property
    def tilting(self) -> Sensor:
        """The tilting laser."""
        return self.robot.sensors[TILT_SCAN.role]

    def add(self, role: str, record: Record) -> None:
        """Take one record."""
        self._handle(self.robot.add(role, record))

    def finish(self) -> None:
        """Take the end of the input."""
        self._handle(self.robot.flush())
        self._cycles.finish()
        self._close_until(END_OF_TIME_NS)

    def _handle(self, events: Iterable[Event]) -> None:
        for event in events:
            handle = self._handlers.get(type(event))
            if handle is not None:
                handle(event)

    def _close_until(self, until_ns: int) -> None:
        """Collect the tilt cycles that ended before a stamp: all their scans have arrived."""
        closed = self._cycles.closed
        while closed and closed[0].end_ns < until_ns:
            self._close(closed.popleft())

    def _close(self, span: Span) -> None:
        mine = [p for p in self._tilt_scans if p.scan.end_ns < span.end_ns]
        del self._tilt_scans[: len(mine)]
        mine = [p for p in mine if p.scan.stamp_ns >= span.start_ns]
        if span.cycle is not None and len(mine) >= MIN_SCANS:
            self.cycles.append(_cycle_scans(mine, self.tilting.mount, self._config))


def _cycle_scans(scans: Sequence[PosedScan], mount: Mount, config: Config) -> CycleScans:
    beams = len(scans[0].scan.ranges)
    scans = [p for p in scans if len(p.scan.ranges) == beams]
    stamps = np.array([beam_stamps(p.scan) for p in scans])
    ranges = np.array(
        [np.where(valid_beams(p.scan, config), p.scan.ranges, np.nan) for p in scans], np.float32
    )
    span = int(stamps.min()), int(stamps.max())
    chain, tilt = _copy_chain(mount, scans[0].scan.frame_id, span)
    T_odom_base = np.array([p.T_odom_base[len(p.T_odom_base) // 2] for p in scans])
    return CycleScans(chain, tilt, stamps, ranges, bearings(scans[0].scan), T_odom_base, span)


def _copy_chain(mount: Mount, frame: str, span_ns: tuple[int, int]) -> tuple[Chain, int]:
    """Return the chain to the laser with a tilt cycle's samples, and the tilt joint's index."""
    chain = mount.find(frame, final=True)
    assert chain is not None
    limits = span_ns[0] - TRACK_MARGIN_NS, span_ns[1] + TRACK_MARGIN_NS
    parts = tuple((_copy_part(part, limits), backwards) for part, backwards in chain.parts)
    names = [part.name for part, _ in parts]
    return Chain(chain.fixed.copy(), parts), names.index(str(mount.tilt_joint))


def _copy_part(part: Part, limits: tuple[int, int]) -> Part:
    within = (part.track.stamps_ns >= limits[0]) & (part.track.stamps_ns <= limits[1])
    if isinstance(part, JointReading):
        joint = ScalarTrack()
        _fill(joint, part.track, within)
        return replace(part, track=joint)
    moving = PoseTrack()
    _fill(moving, part.track, within)
    return replace(part, track=moving, axis=find_axis(moving))


def _fill(track: Track, source: Track, rows: Bool) -> None:
    for stamp_ns, value in zip(source.stamps_ns[rows].tolist(), source.values[rows]):
        track.append(stamp_ns, value)


def _recording(name: str, found: _CycleReader, max_cycles: int) -> Recording:
    still = [cycle for cycle in found.cycles if cycle.is_still]
    cycles = _spread(still or found.cycles, max_cycles)
    places = _places(cycles)
    firsts = [cycles[i].T_place for i in np.unique(places, return_index=True)[1].tolist()]
    return Recording(
        (name,),
        cycles,
        places,
        np.zeros(len(firsts), np.int64),
        planar(inverse(firsts[0]) @ np.array(firsts)),
        _level_scans(found.level_scans, cycles, places),
        found.tilting.mount.base or "",
        _footprint_z(found.robot),
        moving=not still,
    )


def _spread(cycles: Sequence[CycleScans], max_cycles: int) -> list[CycleScans]:
    """Return at most so many tilt cycles, in pairs that follow each other, spread over the time."""
    if len(cycles) <= max_cycles:
        return list(cycles)
    firsts = np.unique(np.linspace(0, len(cycles) - 2, max_cycles // 2).astype(int))
    return [cycles[i] for i in sorted({*firsts.tolist(), *(firsts + 1).tolist()})]


def _places(cycles: Sequence[CycleScans]) -> Int64:
    """Number the places: a tilt cycle at the pose of the one before is at the same place."""
    numbers = [0]
    for before, cycle in pairwise(cycles):
        together = before.is_still and cycle.is_still and is_near(cycle.place, before.place)
        numbers.append(numbers[-1] + (0 if together else 1))
    return np.array(numbers, np.int64)


def _level_scans(
    level: Sequence[PosedScan], cycles: Sequence[CycleScans], places: Int64
) -> dict[int, LevelScans]:
    found: dict[int, LevelScans] = {}
    for place in np.unique(places).tolist():
        mine = [cycle for cycle, at in zip(cycles, places) if at == place]
        start_ns, end_ns = mine[0].span_ns[0], mine[-1].span_ns[1]
        scans = [p for p in level if start_ns <= p.scan.stamp_ns <= end_ns]
        rows = np.unique(np.linspace(0, len(scans) - 1, LEVEL_SCANS).astype(int))
        if scans:
            found[place] = _level_points([scans[i] for i in rows], mine[0].T_place)
    return found


def _level_points(scans: Sequence[PosedScan], T_odom_place: Float64) -> LevelScans:
    points, poses, ranges = [], [], []
    for posed in scans:
        scan = posed.scan
        seen = np.isfinite(scan.ranges)
        seen &= (scan.ranges > scan.range_min) & (scan.ranges < scan.range_max)
        r, angle = scan.ranges[seen].astype(float), bearings(scan)[seen]
        points.append(np.column_stack([r * np.cos(angle), r * np.sin(angle), np.zeros(len(r))]))
        T = inverse(T_odom_place) @ posed.T_odom_base[0]
        poses.append(np.broadcast_to(T, (len(r), 4, 4)))
        ranges.append(r)
    return LevelScans(
        np.concatenate(points),
        scans[0].T_base_laser[0],
        np.concatenate(poses),
        np.concatenate(ranges),
    )


def _footprint_z(robot: Robot) -> float | None:
    """Return the height in the base (m) of a frame that is on the floor by its name."""
    edges = robot.frames.view(urdf=True, tf=True, moving_tf=False)
    base = robot.sensors[TILT_SCAN.role].mount.base or ""
    for frame in sorted({base, *frames_of(edges)}):
        if not frame.endswith("footprint"):
            continue
        if frame == base:
            return 0.0
        with suppress(FrameError):
            chain = build_chain(find_path(base, frame, edges), _no_joint)
            return float(chain.fixed[0][2, 3])
    return None


def _no_joint(joint: Joint) -> JointReading:
    raise FrameError(f"joint '{joint.name}' moves the footprint")
