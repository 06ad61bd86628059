"""Process a bag with the pipeline: topics, records, and checks that its lasers were used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagPaths, BagReader, remap_topics
from tccm_ros.config import Config
from tccm_ros.errors import BagError, FrameError, MapError, TopicError
from tccm_ros.pipeline.outcome import Outcome
from tccm_ros.pipeline.processors import OnCycle, Pipeline
from tccm_ros.progress import Bars, Silent
from tccm_ros.stopwatch import Stopwatch
from tccm_ros.surfaces.saved_map import SavedMap

SCAN_ROLES = ("tilt_scan", "scan")

PROGRESS_STEP_NS = 100_000_000
"""Time of the bag between two updates of the progress bar, ns; chosen."""


def run_bag(
    bag: BagPaths,
    config: Config,
    *,
    remap: Sequence[str] = (),
    saved: SavedMap | None = None,
    on_cycle: OnCycle = lambda cycle, cuboids: None,
    bars: Bars | None = None,
    clock: Stopwatch | None = None,
) -> Outcome:
    """Process a bag.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file; or several, read as one recording.
    config
        The configuration.
    remap
        ``scan:=/base_scan`` for topics with other names.
    saved
        A saved map to continue.
    on_cycle
        Called with each complete tilt cycle, and the integration map after it.
    bars
        Shows the progress.
    clock
        Adds up the time of each stage.

    Raises
    ------
    BagError, TopicError, FrameError, UrdfError
        If the bag cannot be read, or none of its scans could be used.
    MapError
        If the bag could not be localised in the saved map.
    """
    bars, clock = bars or Silent(), clock or Stopwatch()
    with BagReader(bag) as reader:
        topics = _topics(reader, remap)
        present = {info.name for info in reader.topics() if info.count}
        pipeline = Pipeline(
            config,
            expects_odometry=topics["odom"] in present,
            saved=saved,
            on_cycle=on_cycle,
            clock=clock,
        )
        messages = _feed(pipeline, reader, topics, bars)
        bars.start("solve", 1.0)
        pipeline.finish()
        _check_used(pipeline, reader, topics)
        solution = pipeline.solve()
        if not pipeline.slam.is_aligned(solution):
            raise MapError(
                f"{reader.path}: could not be localised in the saved map, which is "
                "unchanged; expected a recording of the same rooms: replay it without --map"
            )
        unreadable = Counter({f"{t}: {reader.problems[t]}": n for t, n in reader.dropped.items()})
        return Outcome(
            config,
            pipeline.cycles,
            pipeline.history,
            pipeline.tccm,
            pipeline.slam,
            solution,
            messages,
            pipeline.dropped + unreadable,
            reader.duration,
            saved is not None,
        )


def _topics(reader: BagReader, remap: Sequence[str]) -> Mapping[str, str]:
    """Return the topic of each role; raise TopicError without scans or a remapped topic."""
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
    pipeline: Pipeline, reader: BagReader, topics: Mapping[str, str], bars: Bars
) -> Counter[str]:
    """Add all records to the pipeline; return the numbers of messages by topic."""
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


def _check_used(pipeline: Pipeline, reader: BagReader, topics: Mapping[str, str]) -> None:
    """Raise an error with the reason where no scan of a recorded laser could be used."""
    counts = {info.name: info.count for info in reader.topics()}
    for topic in (topics[role] for role in SCAN_ROLES):
        if counts.get(topic) and reader.dropped[topic] == counts[topic]:
            raise BagError(
                f"{reader.path}: no message on {topic} could be used: {reader.problems[topic]}"
            )
    for laser, role, used in (
        ("tilting", "tilt_scan", pipeline.tccm.counts["cycles"]),
        ("level", "scan", pipeline.slam.counts["level scans"]),
    ):
        sensor = pipeline.robot.sensors[role]
        if used or not sensor.received:
            continue
        if sensor.problem is not None:
            raise FrameError(f"{reader.path}: {laser} laser: {sensor.problem}")
        dropped = sensor.dropped + (pipeline.tccm.dropped if laser == "tilting" else Counter())
        reasons = ", ".join(f"{n} {why}" for why, n in sorted(dropped.items())) or "no tilt cycle"
        raise BagError(f"{reader.path}: no scan of the {laser} laser could be used: {reasons}")
