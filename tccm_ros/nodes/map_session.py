"""The map of slam_node: gives events to the tracker and the solver, and publishes their results.

Everything here runs in the node's worker.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.nodes.publishing.live_pose import LivePosePublisher
from tccm_ros.nodes.publishing.localisation import (
    BY_REQUEST,
    BY_SCAN,
    NO_MAP,
    LocalisationPublisher,
)
from tccm_ros.nodes.publishing.outputs import SolutionOutputs
from tccm_ros.nodes.saving.solution_saver import Session, Wanted
from tccm_ros.nodes.services.client_api import ClientApi
from tccm_ros.nodes.solver.channel import Localised, PoseStamp, Solved
from tccm_ros.nodes.solver.schedule import SolveSchedule, ViewMessage
from tccm_ros.nodes.solver.solver import Solver
from tccm_ros.records import (
    LabelCorrection,
    Odometry,
    PosedScan,
    PoseGuess,
)
from tccm_ros.results.labels_file import MAP_FILE
from tccm_ros.scene.live_objects import LiveObjects
from tccm_ros.sensors.detections import PosedDetections
from tccm_ros.slam.tracking import LocalisationState, SolvedMap, Tracker


class MapSession:
    """Gives events to the tracker and the solver, and publishes their results.

    Parameters
    ----------
    config
        Parameters of the node.
    solver
        Solves the map in another process.
    live, localisation, outputs, client_api
        Publishers of the pose, its state and the topics of a solution, and the services and topics
        for clients.
    on_forget
        Called when the map begins anew.
    is_running
        Whether the node may publish.

    Attributes
    ----------
    tracker
        Tracks the base.
    newest_ns
        Stamp of the newest event, ns.
    """

    def __init__(
        self,
        config: Config,
        solver: Solver,
        live: LivePosePublisher,
        localisation: LocalisationPublisher,
        outputs: SolutionOutputs,
        client_api: ClientApi,
        on_forget: Callable[[], None],
        is_running: Callable[[], bool],
    ):
        self._config, self._solver = config, solver
        self._live, self._localisation = live, localisation
        self._outputs, self._client_api = outputs, client_api
        self._on_forget, self._is_running = on_forget, is_running
        self.tracker = Tracker(config)
        self._objects = LiveObjects(config)
        self.newest_ns = 0
        self._schedule = SolveSchedule(time.monotonic())
        self._complete_from = 0
        self._shown_ns = -1
        self._scans_before = 0
        self._saved_keyframes = 0
        self._has_tilt_scan = self._is_pose_given = False

    @property
    def scans(self) -> int:
        """Level scans that were matched since the start."""
        return self._scans_before + self.tracker.counts["level scans"]

    @property
    def input(self) -> Wanted:
        """All input so far."""
        return Wanted(self.newest_ns, self._complete_from)

    @property
    def state(self) -> Session:
        """State with which a solution must agree."""
        counts = self.tracker.counts
        return Session(counts["resets"], counts["keyframes"], self._waits_for_scan)

    # --- events ---

    def track(self, event: Any) -> None:
        """Give an event to the tracker and the solver, and publish the pose."""
        self.newest_ns = max(self.newest_ns, getattr(event, "stamp_ns", 0))
        before = Counter(self.tracker.counts)
        self.add(event)
        if isinstance(event, ViewMessage):
            self._client_api.note_view_message(event.stamp_ns, self._solver.next_number)
            if self._objects.add(event):
                self._show_objects()
        if not isinstance(event, PosedDetections):
            self.tracker.add(event)
        if self.tracker.counts["resets"] != before["resets"]:
            self._forget(is_localised=self.tracker.is_localised)
        self._schedule.note_mapped(before, self.tracker.counts)
        self._show_pose()

    def add(self, event: Any) -> None:
        """Give an event to the solver alone."""
        self._schedule.note(event, time.monotonic())
        if type(event) is not Odometry:
            self._complete_from = self._solver.next_number
        self._solver.add(event)
        is_scan = isinstance(event, PosedScan)
        if is_scan and (self._is_pose_given or not self.tracker.is_localised):
            self._solver.flush()  # each scan may localise the robot

    def add_tilt_scan(self, stamp_ns: int) -> None:
        """Extend the trajectory to the stamp of a scan, ns, where there is no level laser."""
        self._has_tilt_scan = True
        self.add(PoseStamp(stamp_ns))

    def take_config(self) -> None:
        """Give changed parameters to the solver."""
        self._solver.add(self._config.model_copy(deep=True))

    def take_guess(self, guess: PoseGuess) -> str:
        """Look for the robot around a user-supplied pose, from the next scan on.

        Raises
        ------
        MapError
            Where there is no map yet.
        """
        if not (self.tracker.counts["keyframes"] or self._saved_keyframes):
            raise MapError(NO_MAP)
        guess = replace(guess, stamp_ns=guess.stamp_ns or self.newest_ns)
        self._localisation.note_search("the given pose is compared with scans", BY_REQUEST)
        self._is_pose_given = True
        self.tracker.add(guess)
        self.add(guess)
        self._schedule.request()
        return ""

    def correct_label(self, correction: LabelCorrection) -> None:
        """Correct the label of a surface, and ask for a solution with it."""
        self.add(correction)
        self.ask_solution()

    # --- solutions ---

    def solve_if_due(self) -> None:
        """Ask for a solution if something new is worth one."""
        if self._schedule.is_due(time.monotonic()):
            self._solve()

    def solve_when_quiet(self) -> None:
        """Ask for a solution if one is due; once input stops, for a final one of everything."""
        self.solve_if_due()
        if self._schedule.is_final_due(time.monotonic(), is_batch=self._solver.is_batch):
            self._solve(is_final=True)

    def ask_solution(self, *, is_final: bool = False) -> int:
        """Ask for a solution with all that has come; return its number."""
        self._schedule.note_asked(time.monotonic())
        name = self._localisation.map_name
        return self._solver.solve(self._outputs.listened, is_final=is_final, map_name=name)

    def take_solved(self, solved: Solved) -> None:
        """Take over and publish a solution, unless it is from before a reset."""
        self._schedule.note_solved(solved.duration_s, time.monotonic())
        if self._is_current(solved):
            self._take_map(solved.map)
            self._outputs.publish_solution(solved.messages)
            self._client_api.show(solved.number, self._objects.take)

    def _show_objects(self) -> None:
        """Publish the objects after the newest view without waiting for a solution."""
        if self._client_api.has_scene_listeners:
            scene = self._objects.scene()
            if scene is not None:
                self._client_api.show_objects(scene)

    def take_localised(self, localised: Localised) -> None:
        """Take over the pose found by a search, or the reason why it continues."""
        if not self._is_current(localised):
            return
        self._localisation.note_wait(localised.waits_for)
        if localised.map is None:
            return
        self._schedule.request()
        was_given, self._is_pose_given = self._is_pose_given, False
        self._take_map(localised.map)
        if was_given and not localised.map.is_unjoined:
            self._localisation.note_given_pose(self.tracker, is_taken=localised.is_at_given_pose)

    def _solve(self, *, is_final: bool = False) -> None:
        if not self._waits_for_scan and not self._solver.is_solving and self._is_running():
            self.ask_solution(is_final=is_final)

    def _is_current(self, answer: Solved | Localised) -> bool:
        resets = self.tracker.counts["resets"]
        return self._solver.is_of_session(answer) and answer.resets == resets

    def _take_map(self, solved: SolvedMap) -> None:
        """Correct the live pose by a solution."""
        self._objects.correct(self.tracker.take(solved))
        if not self._is_tracking:
            self._objects.drop_views()
        self._live.is_localised = self.tracker.is_localised
        if self._shown_ns >= 0:
            self._live.correct(self.tracker.current_pose())
            self._localisation.show(self.tracker)

    def _show_pose(self) -> None:
        live = self.tracker.current_pose()
        has_scan = self.tracker.counts["level scans"] or self._has_tilt_scan
        if has_scan and live.stamp_ns > self._shown_ns and self._is_running():
            self._shown_ns = live.stamp_ns
            if self._is_tracking:
                self._objects.add_pose(live.stamp_ns, live.pose)
            else:
                self._objects.drop_views()
            self._live.is_localised = self.tracker.is_localised
            self._live.odom_frame = self.tracker.odom_frame
            self._live.show(live, self.tracker.current_covariance())
            self._localisation.show(self.tracker)

    # --- maps ---

    def load(self, folder: Path, name: str) -> None:
        """Go on with a saved map and its name; the present map is dropped.

        Raises
        ------
        MapError, OutputError
            Where the map cannot be read; the session continues.
        """
        first = self._solver.begin(folder / MAP_FILE)
        self._track_with(Tracker(self._config, first, is_localised=False))
        self._saved_keyframes = first[0]
        self._forget(is_localised=False)
        self._localisation.note_search("no scan has fitted one place of the map alone yet", BY_SCAN)
        self._localisation.name_map(name)
        self.ask_solution()

    def begin(self) -> None:
        """Begin an empty map."""
        self._solver.begin()
        self._track_with(Tracker(self._config))
        self._saved_keyframes = 0
        self._forget(is_localised=True)

    @property
    def _is_tracking(self) -> bool:
        """Whether the live pose is one in the map of the solutions."""
        return self.tracker.state is LocalisationState.TRACKING

    @property
    def _waits_for_scan(self) -> bool:
        """Whether this session is not localised in the loaded map and cannot be before a scan."""
        return self._saved_keyframes > 0 and not self.tracker.counts["level scans"]

    def _track_with(self, tracker: Tracker) -> None:
        """Go on with another tracker, which counts from 0 for its own map."""
        self._scans_before += self.tracker.counts["level scans"]
        self.tracker = tracker

    def _forget(self, *, is_localised: bool) -> None:
        self._live.forget(is_localised=is_localised)
        self._outputs.forget()
        self._objects.forget()
        self._client_api.forget(is_map_loaded=not is_localised)
        self._localisation.name_map("")
        self._on_forget()
        self._shown_ns = -1
        self._has_tilt_scan = self._is_pose_given = False
        self.newest_ns = self._complete_from = 0
        self._schedule.forget()
