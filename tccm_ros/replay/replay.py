"""`tccm replay`: process a bag and write its result folder atomically."""

from __future__ import annotations

import platform
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tccm_ros import __version__
from tccm_ros.arrays import Float64
from tccm_ros.atomic import output_folder
from tccm_ros.bags.reader import BagPaths, bag_paths
from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.geometry import inverse
from tccm_ros.progress import Bars
from tccm_ros.records import Event
from tccm_ros.replay.outcome import ReplayOutcome
from tccm_ros.replay.run import run_bag
from tccm_ros.replay.unfinished_maps import UnfinishedMaps
from tccm_ros.results.cycles_file import CycleParts, save_cycles
from tccm_ros.results.exports import write_results
from tccm_ros.results.map_file import is_map, load_map, save_map
from tccm_ros.results.models import (
    CountsEntry,
    ScansUsedEntry,
    SessionEntry,
    SessionKind,
    SummaryFile,
    TimingFile,
)
from tccm_ros.results.numbers import write_json
from tccm_ros.results.result_bag import CycleMessageStore, write_result_bag
from tccm_ros.results.surface_counts import count_surfaces
from tccm_ros.stopwatch import Stopwatch

if TYPE_CHECKING:
    from tccm_ros.report.pictures import Pictures
    from tccm_ros.results.folder_reader import Results

LIBRARIES = ("gtsam", "numba", "numpy", "scipy", "shapely")

PROCESSING = ("read", "pose", "tccm", "signs", "slam", "events", "history", "solve")
"""Stages in the real-time factor: reading and processing, without imports and pictures."""


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a finished replay.

    Attributes
    ----------
    out
        Output folder.
    content
        Content of summary.json.
    seconds
        Time of each stage, s.
    real_time_factor
        Seconds of the bag per second of processing.
    found_topics
        One line for each topic assigned by its type, and for a laser that is the base.
    why_empty
        Reasons why there are no surfaces or no walls, one line each.
    """

    out: Path
    content: SummaryFile
    seconds: dict[str, float]
    real_time_factor: float
    found_topics: tuple[str, ...] = ()
    why_empty: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the summary as plain data."""
        return {
            "out": str(self.out),
            **asdict(self.content),
            "real_time_factor": self.real_time_factor,
            "why_empty": list(self.why_empty),
        }

    def text(self) -> str:
        """Return the summary as lines for a terminal."""
        counts, session = self.content.counts, self.content.session
        lines = [
            *self.found_topics,
            f"{counts.surface_counts.text()}, {counts.objects} objects, {counts.walls} walls, "
            f"{counts.cycles} tilt cycles, {counts.keyframes} keyframes, "
            f"{counts.loops_accepted} loops; {_factor_text(self.real_time_factor)} real time",
        ]
        if session.kind == SessionKind.NEW:
            lines.append("a new session of the saved map")
        if counts.unjoined_trajectories:
            lines.append(
                f"separate trajectories, as no place of the map matches them: "
                f"{counts.unjoined_trajectories}; a drive that meets both joins them"
            )
        if counts.dropped:
            reasons = ", ".join(f"{n} {why}" for why, n in counts.dropped.items())
            lines.append(f"dropped: {reasons}")
        lines += [f"left out, as it failed: {stage}" for stage in counts.failed_stages]
        lines.append(f"map       {self.out / 'surfaces.json'}")
        if (self.out / "report.html").exists():
            lines.append(f"pictures  {self.out / 'map.png'}, {self.out / 'map3d.png'}")
            lines.append(f"report    {self.out / 'report.html'}  (open it in a browser)")
        return "\n".join([*lines, *self.why_empty])


class Watcher(Protocol):
    """Observes a replay, for example to record it for a viewer."""

    def add(self, event: Event) -> None:
        """Receive an event of the intake; they arrive in order."""

    def finish(self, outcome: ReplayOutcome, parts: CycleParts) -> None:
        """Receive the results and the coarsened part maps."""


def _factor_text(factor: float) -> str:
    return f"{factor:.0f} x" if factor >= 10.0 else f"{factor:.1f} x"


def replay(
    bag: BagPaths,
    out: Path | str,
    config: Config,
    *,
    saved_map: Path | str | None = None,
    remap: Sequence[str] = (),
    pictures: bool = True,
    events: bool = False,
    watcher: Watcher | None = None,
    bars: Bars | None = None,
    clock: Stopwatch | None = None,
) -> Summary:
    """Process a bag and write its results.

    Parameters
    ----------
    bag
        A rosbag2 folder, an .mcap or a .db3 file; or several, read as one recording.
    out
        Output folder, created if needed; older result files are replaced.
    config
        The configuration.
    saved_map
        A map to continue: the map.mcap of an earlier replay or of a live node.
    remap
        Remappings of topics such as ``scan:=/base_scan``.
    pictures
        Whether to write map.png, map3d.png and report.html.
    events
        Whether to solve the map after each view, as a live node does, for the events in
        result.mcap. This doubles the time.
    watcher
        Observes the replay. Its failure is counted, and the results are complete.
    bars
        Progress bars.
    clock
        Measures the time of each stage.

    Raises
    ------
    TccmError
        Of any subclass; `out` is then unchanged.
    """
    bars, clock = bars or Bars(), clock or Stopwatch()
    with output_folder(out) as folder:
        saved = None if saved_map is None else load_map(saved_map)
        messages, unfinished = CycleMessageStore(config, folder), UnfinishedMaps(folder, config)
        outcome = run_bag(
            bag, config, remap=remap, saved=saved, events=events, on_cycle=messages.add,
            on_event=None if watcher is None else watcher.add, on_progress=unfinished.offer,
            bars=bars, clock=clock,
        )  # fmt: skip
        bars.start("write", 1.0)
        with clock.stage("write"):
            parts = outcome.history.parts(_T_map_odom(outcome))
            _write(folder, outcome, messages, parts)
        if watcher is not None:
            bars.start("watch", 1.0)
            with clock.stage("watch"):
                outcome.solution.stages.run("watch", partial(watcher.finish, outcome, parts))
        _copy_stamps(bag_paths(bag), folder)
        factor, stages = _real_time_factor(outcome, clock), outcome.solution.stages
        content = _write_summary(folder, outcome)
        if pictures:
            bars.start("pictures", 1.0)
            drawn = stages.run("pictures", lambda: _write_pictures(folder, clock))
        timing = _write_timing(folder, factor, clock)
        if pictures and drawn is not None:
            results = replace(drawn[0], timing=timing)
            stages.run("report", lambda: _write_page(results, drawn[1], folder, clock))
        if stages.failed:
            content = _write_summary(folder, outcome)
        unfinished.close()
    return Summary(
        Path(out),
        content,
        clock.seconds,
        factor,
        outcome.found_topics,
        tuple(outcome.why_empty()),
    )


def _write_timing(folder: Path, factor: float, clock: Stopwatch) -> TimingFile:
    seconds = {name: round(value, 6) for name, value in clock.seconds.items()}
    timing = TimingFile(seconds, round(factor, 3))
    write_json(folder / "timing.json", timing)
    return timing


def _write_pictures(folder: Path, clock: Stopwatch) -> tuple[Results, Pictures]:
    """Draw the pictures and return them with the loaded results."""
    # Imported here, since matplotlib takes half a second, which a replay without pictures saves.
    from tccm_ros.report.pictures import write_pictures
    from tccm_ros.results.folder_reader import load_results

    with clock.stage("pictures"):
        results = load_results(folder)
        return results, write_pictures(results, folder)


def _write_page(results: Results, drawn: Pictures, folder: Path, clock: Stopwatch) -> None:
    from tccm_ros.report.html_report import write_page

    with clock.stage("report"):
        write_page(results, drawn, folder)


def _write_summary(folder: Path, outcome: ReplayOutcome) -> SummaryFile:
    content = _summary(outcome)
    write_json(folder / "summary.json", content)
    return content


def _write(
    folder: Path, outcome: ReplayOutcome, messages: CycleMessageStore, parts: CycleParts
) -> None:
    """Write the files of the map, then the optional ones."""
    config, solution, cycles = outcome.config, outcome.solution, outcome.cycles
    stages = solution.stages
    write_results(folder, solution, cycles, outcome.tccm.map.cuboids(), config)
    saved = outcome.slam.saved(solution)
    save_map(folder / "map.mcap", saved, solution, config.frames.map_name)
    stages.run("cycles.npz", lambda: save_cycles(folder / "cycles.npz", parts))
    stages.run(
        "result.mcap",
        lambda: write_result_bag(
            folder / "result.mcap", cycles, messages, solution, config, outcome.changes,
            solution.grid,
        ),
    )  # fmt: skip


def _T_map_odom(outcome: ReplayOutcome) -> Float64:
    """Return the pose of the odometry frame in map at each tilt cycle, (C, 4, 4)."""
    stamps = np.array([cycle.stamp_ns for cycle in outcome.cycles], np.int64)
    T_odom_base = np.array([cycle.T_odom_base for cycle in outcome.cycles]).reshape(-1, 4, 4)
    return outcome.solution.graph.T_map_base_at(stamps) @ inverse(T_odom_base)


def _copy_stamps(bags: Sequence[Path], folder: Path) -> None:
    """Copy the stamps of an imported log, which `tccm evaluate` needs to match references.

    The stamps belong to the scans of a single log, so those of several logs are not copied.
    """
    stamps = bags[0] / "stamps.csv"
    if len(bags) == 1 and stamps.is_file():
        shutil.copyfile(stamps, folder / stamps.name)


def _summary(outcome: ReplayOutcome) -> SummaryFile:
    slam, solution = outcome.slam, outcome.solution
    cycles = outcome.cycles
    surfaces = count_surfaces(solution.surfaces)
    accepted = sum(loop.accepted for loop in solution.graph.loops)
    return SummaryFile(
        versions=software_versions(),
        bag_duration=round(outcome.bag_duration, 6),
        session=SessionEntry(SessionKind.NEW if outcome.continues_map else SessionKind.FIRST),
        counts=CountsEntry(
            messages=dict(sorted(outcome.messages.items())),
            scans_used=ScansUsedEntry(
                tilt=outcome.tccm.counts["scans used"], level=slam.counts["level scans"]
            ),
            dropped=dict(sorted(outcome.dropped.items())),
            cycles=len(cycles),
            planes=len({p.id for cycle in cycles for p in cycle.planes}),
            keyframes=len(solution.graph.keyframes),
            walls=len(solution.graph.walls),
            loops_accepted=accepted,
            loops_rejected=len(solution.graph.loops) - accepted,
            surfaces=surfaces.counted,
            small_surfaces=surfaces.small,
            objects=len(solution.objects),
            failed_stages=dict(sorted(solution.stages.failed.items())),
            unjoined_trajectories=slam.wall_slam.unjoined_trajectories,
        ),
        config=outcome.config.model_dump(mode="json"),
    )


def software_versions() -> dict[str, str]:
    """Return the versions of the package, Python and the libraries that compute results."""
    found = {"tccm_ros": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # apt installs some libraries without metadata
            found[name] = "unknown"
    return found


def _real_time_factor(outcome: ReplayOutcome, clock: Stopwatch) -> float:
    seconds = sum(clock.seconds.get(stage, 0.0) for stage in PROCESSING)
    return outcome.bag_duration / seconds if seconds else 0.0


def report_of(target: Path | str, config: Config, bars: Bars | None) -> Path:
    """Return a folder with the report of a result folder, a saved map or a bag.

    A map or a bag is processed first, into a folder of the working directory named after it.

    Parameters
    ----------
    target
        A result folder, a saved map or a bag.
    config
        Configuration for a map or a bag.
    bars
        Progress bars.

    Raises
    ------
    TccmError
        If the target is missing, of another kind, or damaged.
    """
    target = Path(target)
    if (target / "surfaces.json").exists():
        return target
    if not target.exists():
        raise MapError(f"{target}: no such result folder, map or bag")
    out = Path(f"{target.stem}_report")
    if target.is_file() and is_map(target):
        from tccm_ros.report.viewing import report_map

        report_map(target, out, config)
    else:
        replay(target, out, config, bars=bars)
    return out
