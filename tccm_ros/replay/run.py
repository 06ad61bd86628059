"""Process a bag with the pipeline: topics, records, and checks that its lasers are used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

from tccm_ros.bags.reader import BagPaths, BagReader
from tccm_ros.bags.topics import (
    TopicChoice,
    add_latched,
    choose_topics,
    sensor_is_base,
    with_level_scans,
)
from tccm_ros.calibrate.joint_timing import JointTiming, joint_timing, with_joint_timing
from tccm_ros.config import Config
from tccm_ros.errors import BagError, FrameError, MapError, TopicError
from tccm_ros.mapping.saved_map import SavedMap
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.progress import Bars
from tccm_ros.records import Scan
from tccm_ros.replay.outcome import ReplayOutcome
from tccm_ros.replay.processors import OnCycle, OnEvent, Pipeline
from tccm_ros.robot import MountKind, Stream
from tccm_ros.stopwatch import Stopwatch
from tccm_ros.warm_up.compilation import compile_kernels

PROGRESS_STEP_NS = 100_000_000
"""Bag time between updates of the progress bar, ns. Chosen."""

OnProgress = Callable[[SurfaceSlam], object]
"""Called with the processor of the map while a bag is read."""


def run_bag(
    bag: BagPaths,
    config: Config,
    *,
    remap: Sequence[str] = (),
    saved: SavedMap | None = None,
    events: bool = False,
    on_cycle: OnCycle = lambda cycle, cuboids: None,
    on_event: OnEvent | None = None,
    on_progress: OnProgress = lambda slam: None,
    bars: Bars | None = None,
    clock: Stopwatch | None = None,
) -> ReplayOutcome:
    """Process a bag.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file; or several, read as one recording.
    config
        The configuration.
    remap
        Remappings of topics such as ``scan:=/base_scan``.
    saved
        A saved map to continue.
    events
        Whether to solve the map after each view to find changes.
    on_cycle
        Called with each complete tilt cycle and the integration map after it.
    on_event
        Called with each event of the intake, in order; None if not needed.
    on_progress
        Called with the processor of the map every `PROGRESS_STEP_NS` of the bag.
    bars
        Progress bars.
    clock
        Measures the time of each stage.

    Raises
    ------
    BagError, TopicError, FrameError, UrdfError
        If the bag cannot be read, or none of its scans can be used.
    MapError
        If the bag could not be localised in the saved map.
    """
    bars, clock = bars or Bars(), clock or Stopwatch()
    with BagReader(bag) as reader:
        config, choice, timing_notes = _plan(reader, config, remap)
        compile_kernels(_processors(choice), config, bars)
        pipeline = Pipeline(
            config,
            streams=choice.streams,
            expects_odometry=choice.counts["odom"] > 0,
            saved=saved,
            events=events,
            on_cycle=on_cycle,
            on_event=on_event,
            clock=clock,
        )
        add_latched(reader, choice.topics, pipeline.robot)
        messages = _feed(pipeline, reader, choice.topics, on_progress, bars)
        bars.start("solve", 1.0)
        solution = _solve(pipeline, reader, choice)
        return ReplayOutcome(
            config=config,
            cycles=pipeline.cycles,
            history=pipeline.history,
            tccm=pipeline.tccm,
            slam=pipeline.slam,
            solution=solution,
            messages=messages,
            dropped=_dropped(pipeline, reader, choice) + Counter(solution.unused_detections),
            bag_duration=reader.duration,
            continues_map=saved is not None,
            found_topics=(
                *choice.notes,
                *timing_notes,
                *_lasers_that_are_bases(pipeline, choice),
                *pipeline.robot.remarks,
                *_missing_extra(pipeline),
            ),
            changes=tuple(pipeline.changes),
        )


def _plan(
    reader: BagReader, config: Config, remap: Sequence[str]
) -> tuple[Config, TopicChoice, Sequence[str]]:
    """Choose the topics; return the configuration for them, and notes on the joint's timing."""
    choice = choose_topics(reader, config, remap)
    _check_there(reader, choice)
    with_levels = with_level_scans(config, choice)
    if with_levels is not config:
        config, choice = with_levels, choose_topics(reader, with_levels, remap)
    reader.add_readers(choice.readers)
    timing = joint_timing(reader, choice, config)
    corrected = with_joint_timing(config, timing)
    return corrected, choice, _timing_notes(timing, is_corrected=corrected is not config)


def _solve(pipeline: Pipeline, reader: BagReader, choice: TopicChoice) -> SurfaceSolution:
    """Return the map of all records; raise an error if they give none."""
    pipeline.finish()
    _check_used(pipeline, reader, choice)
    solution = pipeline.solve()
    if not pipeline.slam.is_aligned(solution):
        raise MapError(
            f"{reader.path}: could not be localised in the saved map, which is unchanged "
            f"({pipeline.slam.unplaced_reason(solution)}); expected a recording of the same rooms: "
            "replay it without --map"
        )
    return solution


def _dropped(pipeline: Pipeline, reader: BagReader, choice: TopicChoice) -> Counter[str]:
    """Return the numbers of unused records by reason, and of unread messages by topic."""
    unread = Counter({f"{t}: {reader.problems[t]}": n for t, n in reader.dropped.items()})
    return pipeline.dropped + unread + Counter(choice.unread)


def _processors(choice: TopicChoice) -> set[str]:
    """Return the processors that a recording needs; SLAM always, for the trajectory."""
    return {"slam"} | {s.processor for s in choice.streams if choice.counts[s.role]}


def _check_there(reader: BagReader, choice: TopicChoice) -> None:
    """Raise TopicError if there is no sensor, or if a topic set by the user is missing."""
    names = {info.name for info in reader.topics()}
    absent = [role for role in sorted(choice.named) if not choice.counts[role]]
    measured = [stream.role for stream in choice.streams if not stream.is_occasional]
    if not any(choice.counts[role] for role in measured):
        unread = [role for role in measured if choice.topics[role] in names]
        absent = absent or unread or measured
    if absent:
        raise TopicError(reader.missing(absent[0], choice.topics[absent[0]]))


def _feed(
    pipeline: Pipeline,
    reader: BagReader,
    topics: Mapping[str, str],
    on_progress: OnProgress,
    bars: Bars,
) -> Counter[str]:
    """Add all records to the pipeline and return the number of messages by topic."""
    messages: Counter[str] = Counter()
    last_ns = reader.start_ns
    records = reader.records(topics)
    bars.start("replay", reader.duration, "s")
    while True:
        with pipeline.clock.stage("read"):
            item = next(records, None)
        if item is None:
            return messages
        role, log_ns, record = item
        messages[topics[role]] += 1
        pipeline.add(role, record)
        if log_ns - last_ns > PROGRESS_STEP_NS:
            bars.advance((log_ns - last_ns) * 1e-9)
            last_ns = log_ns
            pipeline.stages.run("maps for viewers", partial(on_progress, pipeline.slam))


def _check_used(pipeline: Pipeline, reader: BagReader, choice: TopicChoice) -> None:
    """Raise an error with the reason if no record of a kind of sensor could be used."""
    mapped = [s for s in choice.streams if s.processor == "tccm"]
    level = [s for s in choice.streams if s.mount is MountKind.LEVEL]
    for streams, used in (
        (mapped, pipeline.tccm.counts["scans used"]),
        (level, pipeline.slam.counts["level scans"]),
    ):
        topics = [(s, choice.topics[s.role]) for s in streams if choice.counts[s.role]]
        if used or not topics:
            continue
        for stream, topic in topics:
            what = _name_of(stream)
            if reader.dropped[topic] == choice.counts[stream.role]:
                raise BagError(
                    f"{reader.path}: no message on {topic} could be used: {reader.problems[topic]}"
                )
            sensor, unused = pipeline.robot.sensors[stream.role], _unused_inputs(reader, choice)
            if sensor.problem is not None:
                raise FrameError(f"{reader.path}: {what}: {sensor.problem}{unused}")
            dropped = sensor.dropped + (pipeline.tccm.dropped if streams is mapped else Counter())
            reasons = ", ".join(f"{n} {why}" for why, n in sorted(dropped.items()))
            kind = "scan" if stream.record is Scan else "record"
            raise BagError(
                f"{reader.path}: no {kind} of the {what} could be used: "
                f"{reasons or 'no tilt cycle'}{unused}"
            )


def _unused_inputs(reader: BagReader, choice: TopicChoice) -> str:
    """Return the topics of the robot of which no message could be used, as the end of an error."""
    sensors = {stream.role for stream in choice.streams}
    return "".join(
        f"; no message on {topic} could be used: {reader.problems[topic]}"
        for role, topic in choice.topics.items()
        if role not in sensors and 0 < choice.counts[role] <= reader.dropped[topic]
    )


def _lasers_that_are_bases(pipeline: Pipeline, choice: TopicChoice) -> Iterator[str]:
    for role, sensor in pipeline.robot.sensors.items():
        if sensor.posed and sensor.mount.is_base and choice.counts[role]:
            yield sensor_is_base(choice.topics[role], sensor.stream.record)


def _timing_notes(timing: JointTiming | None, *, is_corrected: bool) -> Sequence[str]:
    """Return a line on a delay between a tilting laser and its joint, and whether it is used."""
    if timing is None or not timing.is_significant:
        return ()
    return (f"{timing.text()}; {'it is used' if is_corrected else 'it is not what you set'}",)


def _missing_extra(pipeline: Pipeline) -> Iterator[str]:
    """Yield the missing requirement for reading door signs, if there are pictures."""
    if pipeline.signs.problem:
        yield f"door signs are not read: {pipeline.signs.problem}"


def _name_of(stream: Stream) -> str:
    names = {MountKind.TILTING: "tilting laser", MountKind.LEVEL: "level laser"}
    return names.get(stream.mount, f"sensor on {stream.role}")
