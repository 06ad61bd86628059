"""A recorded bag through the processors: the same ones as the live nodes', fed from a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Literal, cast

from tccm_ros.config import Config
from tccm_ros.errors import BagError, FrameError, MapError, TopicError
from tccm_ros.io.bags import DEFAULT_TOPICS, BagReader, remap_topics
from tccm_ros.io.cycles import CycleHistory
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor, TccmRecord
from tccm_ros.messages import Record
from tccm_ros.progress import Bars, Silent
from tccm_ros.records import Odometry, Scan
from tccm_ros.stopwatch import Stopwatch
from tccm_ros.surfaces.continuation import Continuation, last_sample
from tccm_ros.surfaces.saved_map import SavedMap
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution

__all__ = ["Outcome", "Pipeline", "Session", "run_bag"]

SCAN_ROLES = ("tilt_scan", "scan")

LoggedRecord = tuple[str, int, Record]
"""Role, log time (ns) and record."""

OPENING_NS = 5_000_000_000
"""So much of a bag tells whether it goes on with the run that was saved."""

PARTS_KEPT = 400
"""Cycles whose part maps are kept for result.mcap: memory stays bounded in a bag of hours."""


@dataclass(frozen=True, slots=True)
class Session:
    """How a bag begins.

    Attributes
    ----------
    kind
        ``first``: with nothing; ``continued``: where the saved run was interrupted; ``new``: a
        session of its own, whose place in the saved map has to be found.
    reason
        Why it is a new one.
    """

    kind: Literal["first", "continued", "new"]
    reason: str


@dataclass(slots=True, eq=False)
class Outcome:
    """What a replay has found, before it is written.

    Attributes
    ----------
    config
        As it was run.
    earlier
        The tilt cycles of the run that this bag goes on with: their planes and objects.
    cycles
        The tilt cycles of this bag, without their points.
    history
        Coarse part maps of every cycle, for the report.
    tccm, slam
        The processors at the end: the integration map, counts and drops.
    solution
        Trajectory, walls and surfaces.
    messages
        Messages read, by topic.
    unreadable
        Messages that could not be used, by topic and what was wrong with the first.
    bag_duration
        s.
    session
        How the bag begins.
    run
        The run before its end, for the next bag of the same recording; None if nothing came.
    """

    config: Config
    earlier: list[CycleResult]
    cycles: list[CycleResult]
    history: CycleHistory
    tccm: TccmProcessor
    slam: SurfaceSlam
    solution: SurfaceSolution
    messages: Counter[str] = field(default_factory=Counter)
    unreadable: Counter[str] = field(default_factory=Counter)
    bag_duration: float = 0.0
    session: Session = Session("first", "")
    run: Continuation | None = None


class Pipeline:
    """The two processors and the hand-over between them."""

    def __init__(
        self,
        config: Config,
        *,
        expects_odometry: bool,
        saved: SavedMap | None = None,
        clock: Stopwatch | None = None,
    ):
        self.config = config
        self.clock = clock or Stopwatch()
        self.tccm = TccmProcessor(config, expects_odometry=expects_odometry)
        self.slam = (
            SurfaceSlam(config, expects_odometry=expects_odometry)
            if saved is None
            else SurfaceSlam.from_saved(config, saved, expects_odometry=expects_odometry)
        )
        self.earlier: list[CycleResult] = []
        self.cycles: list[CycleResult] = []
        self.history = CycleHistory(config.map.window_cycles)
        self.last: Odometry | Scan | None = None

    def go_on_with(self, run: Continuation) -> None:
        """Take up an interrupted run where it was.

        Raises
        ------
        MapError
            If its state is damaged.
        """
        processors = run.processors(self.config)
        self.tccm, self.slam = processors["tccm"], processors["slam"]
        self.earlier = processors["cycles"]

    def interrupt(self) -> Continuation | None:
        """Return the run as it is now, for `go_on_with`; None if it has not begun."""
        if self.last is None:
            return None
        cycles = [*self.earlier, *map(_outline, self.cycles)]
        processors = {"tccm": self.tccm, "slam": self.slam, "cycles": cycles}
        return Continuation.of(processors, last_sample(self.last), self.config)

    def add(self, role: str, record: Record) -> list[CycleResult]:
        """Give one record to whom it concerns; return the cycles that are complete now."""
        results: list[CycleResult] = []
        if isinstance(record, Odometry) or (
            isinstance(record, Scan) and not isinstance(self.last, Odometry)
        ):
            self.last = record
        if role != "scan":
            with self.clock.stage("tccm"):
                results = self.tccm.add(cast(TccmRecord, record))
        with self.clock.stage("slam"):
            if role != "tilt_scan":
                self.slam.add(record)
            elif isinstance(record, Scan):
                self.slam.add_pose_stamp(record.stamp_ns)
        self._hand_over(results)
        return results

    def finish(self) -> list[CycleResult]:
        """Take the end of the input."""
        with self.clock.stage("tccm"):
            results = self.tccm.finish()
        self._hand_over(results)
        with self.clock.stage("slam"):
            self.slam.finish()
        return results

    def solve(self) -> SurfaceSolution:
        """Optimise the graph and build the surface map."""
        with self.clock.stage("solve"):
            return self.slam.solve()

    def _hand_over(self, results: Sequence[CycleResult]) -> None:
        for result in results:
            with self.clock.stage("slam"):
                self.slam.add(result.surfaces)
                self.slam.add(result.view)
            with self.clock.stage("history"):
                self.history.add(result.cycle, result.stamp_ns, result.part.cuboids())
            self.cycles.append(replace(result, part=result.part.without_points()))
            if len(self.cycles) > PARTS_KEPT:
                old = self.cycles[-PARTS_KEPT - 1]
                self.cycles[-PARTS_KEPT - 1] = replace(old, part=old.part.without_cuboids())


def _outline(cycle: CycleResult) -> CycleResult:
    """Return a cycle's planes and objects alone."""
    return replace(
        cycle,
        part=cycle.part.without_points().without_cuboids(),
        surfaces=replace(
            cycle.surfaces, points=cycle.surfaces.points[:0], surface=cycle.surfaces.surface[:0]
        ),
        view=replace(cycle.view, intervals=cycle.view.intervals[:0]),
    )


def run_bag(
    bag: Path | str,
    config: Config,
    *,
    remap: Sequence[str] = (),
    saved: SavedMap | None = None,
    bars: Bars | None = None,
    clock: Stopwatch | None = None,
) -> Outcome:
    """Run a bag through the processors.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file.
    config
        The configuration.
    remap
        ``scan:=/base_scan`` for topics with other names.
    saved
        A map to go on with.
    bars
        Where progress is shown.
    clock
        Where the time of each stage is added up.

    Raises
    ------
    BagError, TopicError, FrameError, UrdfError
        As the modules that read say; also where no scan could be used.
    MapError
        Where the bag's place in the saved map was not found.
    """
    bars, clock = bars or Silent(), clock or Stopwatch()
    with BagReader(bag) as reader:
        topics = _topics(reader, remap)
        present = {info.name for info in reader.topics() if info.count}
        pipeline = Pipeline(
            config, expects_odometry=topics["odom"] in present, saved=saved, clock=clock
        )
        records = reader.records(topics)
        session = Session("first", "")
        if saved is not None:
            first, records = _opening(records)
            session = _begin(pipeline, saved, first)
        messages = _feed(pipeline, reader, topics, records, bars)
        bars.start("solve", 1.0)
        with clock.stage("keep"):
            run = pipeline.interrupt()
        pipeline.finish()
        _check_used(pipeline, reader, topics)
        solution = pipeline.solve()
        if not pipeline.slam.is_placed(solution):
            raise MapError(
                f"{reader.path}: its place in the saved map was not found for certain; "
                "nothing is changed: map it without --map"
            )
        return Outcome(
            config,
            pipeline.earlier,
            pipeline.cycles,
            pipeline.history,
            pipeline.tccm,
            pipeline.slam,
            solution,
            messages,
            Counter({f"{t}: {reader.problems[t]}": n for t, n in reader.dropped.items()}),
            reader.duration,
            session,
            run,
        )


def _opening(
    records: Iterator[LoggedRecord],
) -> tuple[dict[type, Odometry | Scan], Iterator[LoggedRecord]]:
    """Return the first odometry and the first scan of the first records, and all records."""
    read: list[LoggedRecord] = []
    first: dict[type, Odometry | Scan] = {}
    for item in records:
        read.append(item)
        if isinstance(item[2], Odometry | Scan):
            first.setdefault(type(item[2]), item[2])
        if len(first) == 2 or item[1] - read[0][1] > OPENING_NS:
            break
    return first, chain(read, records)


def _begin(pipeline: Pipeline, saved: SavedMap, first: Mapping[type, Odometry | Scan]) -> Session:
    """Go on with the run that was saved, if these records do; say how the bag begins."""
    if saved.run is None:
        return Session("new", "the map holds no run")
    record = first.get(Odometry if saved.run.last.pose else Scan)
    sample = None if record is None else last_sample(record)
    reason = saved.run.refusal(pipeline.config, sample)
    if reason:
        return Session("new", reason)
    pipeline.go_on_with(saved.run)
    return Session("continued", "")


def _topics(reader: BagReader, remap: Sequence[str]) -> Mapping[str, str]:
    """Return the topic of each role; a bag without scans, or without what was named, is wrong."""
    topics = remap_topics(remap)
    counts = {info.name: info.count for info in reader.topics()}
    named = [role for role, topic in topics.items() if topic != DEFAULT_TOPICS[role]]
    absent = [role for role in named if topics[role] not in counts]
    if not any(counts.get(topics[role]) for role in SCAN_ROLES):
        absent = absent or ["tilt_scan"]
    if absent:
        raise TopicError(reader.missing(absent[0], topics[absent[0]]))
    return topics


def _feed(
    pipeline: Pipeline,
    reader: BagReader,
    topics: Mapping[str, str],
    records: Iterator[LoggedRecord],
    bars: Bars,
) -> Counter[str]:
    messages: Counter[str] = Counter()
    last_ns = reader.start_ns
    bars.start("replay", reader.duration, "s")
    while True:
        with pipeline.clock.stage("read"):
            item = next(records, None)
        if item is None:
            return messages
        role, log_ns, record = item
        messages[topics[role]] += 1
        pipeline.add(role, record)
        if log_ns - last_ns > 100_000_000:
            bars.advance((log_ns - last_ns) * 1e-9)
            last_ns = log_ns


def _check_used(pipeline: Pipeline, reader: BagReader, topics: Mapping[str, str]) -> None:
    """Raise what explains why a laser that is there gave nothing at all."""
    counts = {info.name: info.count for info in reader.topics()}
    for topic in (topics[role] for role in SCAN_ROLES):
        if counts.get(topic) and reader.dropped[topic] == counts[topic]:
            raise BagError(
                f"{reader.path}: no message on {topic} could be used: {reader.problems[topic]}"
            )
    for laser, sync, used in (
        ("tilting", pipeline.tccm.synchroniser, pipeline.tccm.counts["cycles"]),
        ("level", pipeline.slam.sync, pipeline.slam.counts["level scans"]),
    ):
        if used or not sync.counts["scans"]:
            continue
        if sync.problem is not None:
            raise FrameError(f"{reader.path}: {laser} laser: {sync.problem}")
        dropped = pipeline.tccm.dropped if laser == "tilting" else pipeline.slam.dropped
        reasons = ", ".join(f"{n} {why}" for why, n in sorted(dropped.items())) or "no sweep"
        raise BagError(f"{reader.path}: no scan of the {laser} laser could be used: {reasons}")
