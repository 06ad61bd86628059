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
from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import TopicChoice, add_latched, choose_topics
from tccm_ros.calibrate.recording import (
    CalibrationRecording,
    CycleScans,
    LevelScans,
    evenly,
    is_near,
)
from tccm_ros.config import Config, RigConfig
from tccm_ros.cuboids.tilt_cycle import Span, TiltCycles
from tccm_ros.errors import BagError, FrameError, TopicError
from tccm_ros.geometry import inverse, planar
from tccm_ros.progress import Bars
from tccm_ros.records import DepthImage, Event, PosedScan, Scan, StreamComplete, TiltAngle
from tccm_ros.robot import MountKind, Robot, Stream
from tccm_ros.robot.chain import JointReading, Part, TransformChain
from tccm_ros.robot.frames import build_chain, find_path, frames_of
from tccm_ros.robot.mount import Mount
from tccm_ros.robot.sensor import Sensor
from tccm_ros.robot.tilt_angle import find_axis
from tccm_ros.robot.tracks import PoseTrack, ScalarTrack, Track
from tccm_ros.sensors.camera_rays import pixel_rays
from tccm_ros.sensors.depth_image import PosedImage, max_mapped_depth
from tccm_ros.sensors.laser_scan import (
    LEVEL_SCAN,
    beam_stamps,
    bearings,
    valid_beams,
)

TRACK_MARGIN_NS = 1_000_000_000
"""Margin of joint samples before and after a tilt cycle, for time offsets (chosen)."""

MAX_CYCLES = 24
"""Maximum number of tilt cycles per bag (chosen: more take time and add little accuracy)."""

LEVEL_SCANS = 6
"""Number of level scans per place (chosen)."""

IMAGE_COLUMNS = 80
"""Approximate number of used columns of a depth image (chosen: as a tilting laser's scan lines)."""

MAX_DEPTH_FACTOR = 1.5
"""Factor on the maximum mapped depth for calibration (chosen: patches that are too thick for a
plane are left out anyway)."""

MIN_SCANS = 8
"""Minimum number of scans of a tilt cycle (chosen)."""

CORRECTIONS = frozenset(
    (
        "tilt_offset", "tilt_scale", "joint_time_offset", "pan_offset", "mount_correction",
        "level_correction",
    )
)  # fmt: skip
"""Parameters of the group `rig` that a calibration estimates."""

END_OF_TIME_NS = 2**62
"""Later than all stamps."""


def uncorrected(config: Config) -> Config:
    """Return the configuration with default values for all corrections of the rig."""
    rig = config.rig.model_copy(update=RigConfig().model_dump(include=set(CORRECTIONS)))
    return config.model_copy(update={"rig": rig})


def read_recording(
    bag: Path | str,
    config: Config,
    remap: Sequence[str] = (),
    bars: Bars | None = None,
    *,
    max_cycles: int = MAX_CYCLES,
) -> CalibrationRecording:
    """Read the tilt cycles, or the depth images of a head, and the level scans of a bag.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file.
    config
        The configuration; its corrections of the rig are not applied.
    remap
        Remappings such as ``scan:=/base_scan``.
    bars
        Progress bars.
    max_cycles
        Maximum number of tilt cycles, distributed over the recording.

    Raises
    ------
    BagError, TopicError, FrameError, UrdfError
        Where the bag cannot be read, has no tilting scans, or the laser's pose is unknown.
    """
    raw, bars = uncorrected(config), bars or Bars()
    with BagReader(bag) as reader:
        choice = choose_topics(reader, raw, remap)
        reader.add_readers(choice.readers)
        topics = choice.topics
        role = _tilting_role(choice)
        if role is None:
            raise TopicError(reader.missing("tilt_scan", topics["tilt_scan"]))
        found = _CycleReader(raw, role, choice.streams, choice.counts["odom"] > 0)
        bars.start("read", reader.duration, "s")
        last_ns = reader.start_ns
        add_latched(reader, topics, found.robot)
        for role, log_ns, record in reader.records(topics):
            bars.advance((log_ns - last_ns) * 1e-9)
            last_ns = log_ns
            found.add(role, record)
        found.finish()
    if not found.cycles:
        raise _no_cycle_error(bag, found.tilting)
    return _recording(Path(bag).name, found, max_cycles)


def _tilting_role(choice: TopicChoice) -> str | None:
    """Return the role of a bag's tilting laser, else of its depth images."""
    kinds = [stream.role for kind in (Scan, DepthImage) for stream in choice.streams
             if stream.record is kind and stream.mount is not MountKind.LEVEL]  # fmt: skip
    return next((role for role in kinds if choice.counts[role]), None)


def _no_cycle_error(bag: Path | str, tilting: Sensor) -> BagError | FrameError:
    if tilting.problem is not None:
        return FrameError(f"{bag}: {tilting.problem}")
    reasons = ", ".join(f"{n} {why}" for why, n in sorted(tilting.dropped.items()))
    return BagError(
        f"{bag}: the tilting sensor makes no tilt cycle and no image"
        + (f" (dropped: {reasons})" if reasons else "")
    )


class _CycleReader:
    """Collects scans of the tilting laser by tilt cycle, or images, and scans of the level laser.

    A level laser with unknown pose is ignored.
    """

    def __init__(
        self, config: Config, role: str, streams: Sequence[Stream], has_odometry: bool
    ) -> None:
        self._config, self._role = config, role
        used = [
            replace(stream, mount=MountKind.TILTING) if stream.role == role else stream
            for stream in streams
            if stream.role in (role, LEVEL_SCAN.role)
        ]
        self.robot = Robot(config, used, expects_odometry=has_odometry)
        self._cycles = TiltCycles(config)
        self._tilt_scans: list[PosedScan] = []
        self.level_scans: list[PosedScan] = []
        self.cycles: list[CycleScans] = []
        self._scans = {role: self._tilt_scans, LEVEL_SCAN.role: self.level_scans}
        self._handlers: dict[type, Callable[[Any], object]] = {
            PosedImage: self._add_image,
            PosedScan: lambda posed: self._scans[posed.role].append(posed),
            TiltAngle: lambda tilt: self._cycles.add(tilt.stamp_ns, tilt.angle),
            StreamComplete: lambda complete: self._close_until(complete.until_ns - TRACK_MARGIN_NS),
        }

    @property
    def tilting(self) -> Sensor:
        """The tilting sensor."""
        return self.robot.sensors[self._role]

    def add(self, role: str, record: Any) -> None:
        """Add one record."""
        self._handle(self.robot.add(role, record))

    def finish(self) -> None:
        """Process the end of the input."""
        self._handle(self.robot.flush())
        self._cycles.finish()
        self._close_until(END_OF_TIME_NS)

    def _add_image(self, posed: PosedImage) -> None:
        cycle = _image_rows(posed, self.tilting.mount, self._config)
        if np.isfinite(cycle.ranges).any():
            self.cycles.append(cycle)

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
    angle = bearings(scans[0].scan)
    directions = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=-1)[None]
    return CycleScans(chain, tilt, stamps, ranges, directions, T_odom_base, span)


def _image_rows(posed: PosedImage, mount: Mount, config: Config) -> CycleScans:
    """Return a depth image, thinned to about `IMAGE_COLUMNS` columns."""
    image, camera = posed.image, posed.image.camera
    assert camera is not None
    step = max(image.depth.shape[1] // IMAGE_COLUMNS, 1)
    depths = image.depth[::step, ::step].astype(float)
    if image.depth.dtype == np.uint16:
        depths *= 0.001
    x, y = pixel_rays(camera)[:, ::step, ::step].astype(float)
    vectors = np.stack([x, y, np.ones(depths.shape)], axis=-1)
    lengths = np.linalg.norm(vectors, axis=-1)
    seen = (depths > 0.0) & (depths < MAX_DEPTH_FACTOR * max_mapped_depth(config))
    ranges = np.where(seen, depths * lengths, np.nan).astype(np.float32)
    span = image.stamp_ns, image.stamp_ns
    chain, tilt = _copy_chain(mount, image.frame_id, span)
    T_odom_base = np.repeat(posed.T_odom_base[:1], len(depths), axis=0)
    stamps = np.full(depths.shape, image.stamp_ns)
    return CycleScans(chain, tilt, stamps, ranges, vectors / lengths[..., None], T_odom_base, span)


def _copy_chain(mount: Mount, frame: str, span_ns: tuple[int, int]) -> tuple[TransformChain, int]:
    """Return the chain to the laser with a tilt cycle's samples, and the tilt joint's index."""
    chain = mount.find(frame, final=True)
    assert chain is not None
    limits = span_ns[0] - TRACK_MARGIN_NS, span_ns[1] + TRACK_MARGIN_NS
    parts = tuple((_copy_part(part, limits), backwards) for part, backwards in chain.parts)
    names = [part.name for part, _ in parts]
    return TransformChain(chain.fixed.copy(), parts), names.index(str(mount.tilt_joint))


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


def _recording(name: str, found: _CycleReader, max_cycles: int) -> CalibrationRecording:
    still = [c for c, at_rest in zip(found.cycles, _are_at_rest(found.cycles)) if at_rest]
    cycles = _spread(still or found.cycles, max_cycles)
    places = _places(cycles)
    firsts = [cycles[i].T_place for i in np.unique(places, return_index=True)[1].tolist()]
    return CalibrationRecording(
        (name,),
        cycles,
        places,
        np.zeros(len(firsts), np.int64),
        planar(inverse(firsts[0]) @ np.array(firsts)),
        _level_scans(found.level_scans, cycles, places),
        found.tilting.mount.base or "",
        _footprint_z(found.robot, found.tilting.mount.base or ""),
        moving=not still,
    )


def _are_at_rest(cycles: Sequence[CycleScans]) -> list[bool]:
    """Return whether the base was at rest per cycle; for images, if an adjacent pose is equal."""
    if not cycles[0].is_image:
        return [cycle.is_still for cycle in cycles]
    same = [bool(is_near(b.place, a.place)) for a, b in pairwise(cycles)]
    return [before or after for before, after in zip([False, *same], [*same, False])]


def _spread(cycles: Sequence[CycleScans], max_cycles: int) -> list[CycleScans]:
    """Return at most `max_cycles` tilt cycles, in consecutive pairs distributed over time."""
    if len(cycles) <= max_cycles:
        return list(cycles)
    firsts = evenly(len(cycles) - 1, max_cycles // 2)
    return [cycles[i] for i in sorted({*firsts.tolist(), *(firsts + 1).tolist()})]


def _places(cycles: Sequence[CycleScans]) -> Int64:
    """Return place numbers: a tilt cycle at the pose of the previous one is at the same place."""
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
        if scans:
            rows = evenly(len(scans), LEVEL_SCANS)
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


def _footprint_z(robot: Robot, base: str) -> float | None:
    """Return the height in the base (m) of a footprint frame, which is on the floor by its name."""
    edges = robot.frames.view(moving_tf=False)
    for frame in sorted({base, *frames_of(edges)}):
        if not frame.endswith("footprint"):
            continue
        if frame == base:
            return 0.0
        with suppress(FrameError):
            chain = build_chain(find_path(base, frame, edges))
            return float(chain.fixed[0][2, 3])
    return None
