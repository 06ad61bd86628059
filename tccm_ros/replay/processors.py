"""The intake of sensor records and the two processors, connected as in the live nodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.mapping.saved_map import SavedMap
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.mapping.tccm import CyclePlanes, CycleResult, TccmProcessor
from tccm_ros.records import Event
from tccm_ros.results.cycles_file import CycleHistory
from tccm_ros.robot import Robot, Stream
from tccm_ros.scene.changes import Change
from tccm_ros.scene.session_changes import SessionChanges
from tccm_ros.sensors.level_projection import LevelProjector
from tccm_ros.sensors.registry import default_streams
from tccm_ros.signs.processor import SignProcessor
from tccm_ros.stages import OptionalStages
from tccm_ros.stopwatch import Stopwatch

OnCycle = Callable[[CycleResult, Cuboids], object]
"""Called with each complete tilt cycle and the integration map after it."""

OnEvent = Callable[[Event], object]
"""Called with each event of the intake, in order."""


class Pipeline:
    """The intake and both processors of a replay, given one record at a time.

    Parameters
    ----------
    config
        The configuration.
    streams
        Streams of the sensors; those of the configuration by default.
    expects_odometry
        Whether there is an odometry topic (`Robot`).
    saved
        A saved map to continue.
    events
        Whether to solve the map after each view to find changes.
    on_cycle
        Called with each complete tilt cycle and the integration map after it.
    on_event
        Called with each event of the intake, in order; None if not needed.
    clock
        Measures the time of each stage.

    Attributes
    ----------
    robot, tccm, signs, slam
        The intake and the processors.
    cycles
        Tilt cycles, without their points.
    history
        Coarsened part maps of all tilt cycles, for the report.
    changes
        Changes, with the stamps of the views that revealed them, ns; empty unless requested.
    stages
        Runs optional stages after the map, and counts failures.
    """

    def __init__(
        self,
        config: Config,
        *,
        streams: Sequence[Stream] | None = None,
        expects_odometry: bool,
        saved: SavedMap | None = None,
        events: bool = False,
        on_cycle: OnCycle = lambda cycle, cuboids: None,
        on_event: OnEvent | None = None,
        clock: Stopwatch | None = None,
    ):
        self.config = config
        self._on_cycle, self._on_event = on_cycle, on_event
        self._maps: list[Cuboids] = []
        self.clock, self.stages = clock or Stopwatch(), OptionalStages()
        streams = default_streams(config) if streams is None else streams
        self._mapped = frozenset(stream.role for stream in streams if stream.processor == "tccm")
        self.robot = Robot(config, streams, expects_odometry=expects_odometry)
        self.tccm = TccmProcessor(config)
        self.signs = SignProcessor(config)
        self._level = LevelProjector(config)
        self.slam = SurfaceSlam(config) if saved is None else SurfaceSlam.from_saved(config, saved)
        self.changes: list[tuple[int, Change]] = []
        self._session_changes = (
            SessionChanges(self.slam, is_map_loaded=saved is not None) if events else None
        )
        self.cycles: list[CycleResult] = []
        self.history = CycleHistory(config.map.window_cycles)

    @property
    def dropped(self) -> Counter[str]:
        """Counts of records not used, by reason; for records of no sensor also by role."""
        dropped = self.robot.dropped + self.robot.refused
        return dropped + self.tccm.dropped + self.signs.dropped

    def add(self, role: str, record: Any) -> list[CycleResult]:
        """Process one record and return the tilt cycles that it completes."""
        with self.clock.stage("pose"):
            events = self.robot.add(role, record)
        if role in self._mapped:
            self.slam.add_pose_stamp(record.stamp_ns)
        return self._process(events) if events else []

    def finish(self) -> list[CycleResult]:
        """Process the end of the input and return the last tilt cycles."""
        results = self._process(self.robot.flush())
        if self._level.is_on:  # the last records have given level scans
            results += self._process(self.robot.flush())
        with self.clock.stage("tccm"):
            last = self.tccm.finish(self._store_map)
        self._add_cycles(last)
        return results + last

    def solve(self) -> SurfaceSolution:
        """Optimise the graph and build the surface map."""
        with self.clock.stage("solve"):
            return self.slam.solve(stages=self.stages)

    def _store_map(self, _: CyclePlanes) -> None:
        """Store the integration map after a tilt cycle; one event may complete several cycles."""
        self._maps.append(self.tccm.map.cuboids())

    def _process(self, events: Sequence[Event]) -> list[CycleResult]:
        """Process events with both processors, and pass surface messages from one to the other."""
        results: list[CycleResult] = []
        if self._on_event is not None:
            with self.clock.stage("watch"):
                for event in events:
                    self.stages.run("watch", partial(self._on_event, event))
        with self.clock.stage("tccm"):
            for event in events:
                results += self.tccm.add(event, self._store_map)
        with self.clock.stage("signs"):
            measured = [sign for event in events for sign in self.signs.add(event)]
        with self.clock.stage("slam"):
            for event in events:
                self.slam.add(event)
            for sign in measured:
                self.slam.add(sign)
        self._add_cycles(results)
        return results + self._add_level_scans(events) if self._level.is_on else results

    def _add_level_scans(self, events: Iterable[Event]) -> list[CycleResult]:
        """Project sensor data of events to level scans, and process these."""
        results: list[CycleResult] = []
        with self.clock.stage("tccm"):
            scans = [scan for scan in map(self._level.project, events) if scan is not None]
        for scan in scans:
            results += self.add("scan", scan)
        return results

    def _add_cycles(self, results: Iterable[CycleResult]) -> None:
        for result, cuboids in zip(results, self._maps, strict=True):
            with self.clock.stage("slam"):
                self.slam.add(result.surfaces)
                self.slam.add(result.view)
                self.slam.add(result.boxes)
            if self._session_changes is not None:
                with self.clock.stage("events"):
                    found = self.stages.run("events", self._session_changes.solve) or []
                self.changes += [(result.stamp_ns, change) for change in found]
            with self.clock.stage("history"):
                self.history.add(result.cycle, result.stamp_ns, result.part.cuboids())
            with self.clock.stage("write"):
                self.stages.run(
                    "messages of a tilt cycle", partial(self._on_cycle, result, cuboids)
                )
            self.cycles.append(_without_points(result))
        self._maps.clear()


def _without_points(cycle: CycleResult) -> CycleResult:
    """Return a tilt cycle with only its planes and objects; points and cuboids are large."""
    return replace(
        cycle,
        part=cycle.part.without_points().without_cuboids(),
        surfaces=replace(
            cycle.surfaces, points=cycle.surfaces.points[:0], surface=cycle.surfaces.surface[:0]
        ),
        view=replace(cycle.view, intervals=cycle.view.intervals[:0], hits=cycle.view.hits[:0]),
    )
