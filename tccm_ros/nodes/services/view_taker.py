"""Taking a view: wait for the base to stop, move the tilt joint, return the measured surfaces.

A view consists of the measurements made while the tilt joint moves from one end of its range to the
other, once for each pan angle. tccm_node builds the tilt cycles, and the surface map names the
surfaces measured in them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.errors import MotionError
from tccm_ros.nodes.intake.shared_robot import SharedRobot
from tccm_ros.nodes.services.joint_mover import JointMover
from tccm_ros.nodes.services.known_frames import KnownFrames, is_near
from tccm_ros.nodes.services.surface_services import SurfaceServices
from tccm_ros.nodes.solver.schedule import MESSAGES

WAITING, MOVING, MAPPING = range(3)
"""Values of the phases in action/ScanHere."""

MOVED_PROGRESS = 0.8
"""Progress of a view after the joints have moved. Chosen."""

PATIENCE_S = 10.0
"""Time to wait for the base to stop if the goal does not specify one, s (action/ScanHere)."""

VIEW_S = 20.0
"""Timeout for a tilt cycle after the joint has stopped, s. Chosen."""

LAST_VIEW_NS = 1_500_000_000
"""Time to wait for a camera's cycle that began during the movement, ns of message time. Chosen:
longer than `cycle.period`."""

SOLUTION_S = 60.0
"""Timeout for a solution with the view, s. Chosen: the longest time of a large map."""

MAX_VIEWS = 1000
"""Maximum number of views remembered. Chosen: an hour of tilt cycles."""

POLL_S = 0.05
"""Polling period of wait conditions, s."""


AT_END_RAD = 0.02
"""Tolerance for a joint at an end of its range, rad: less than any tilt cycle. Chosen."""


def movement_ends(now: float, low: float, high: float) -> tuple[float, float]:
    """Return start and end angle of a joint movement that is one complete tilt cycle.

    The joint reverses at the start angle, or already stands there. Moving on in the same direction
    would join the approach and the range in one cycle. All angles in rad.
    """
    is_nearer_low = abs(now - low) <= abs(now - high)
    is_outside = not low - AT_END_RAD <= now <= high + AT_END_RAD
    return (low, high) if is_nearer_low != is_outside else (high, low)


class CancelledError(Exception):
    """The client has cancelled the view."""


class ViewTaker:
    """Takes one view at a time, in a thread that may block.

    Parameters
    ----------
    config
        Groups `frames` and `scan_here`.
    robot, frames, mover
        The robot, the poses of its frames, and the controller of its joints.
    surfaces
        Queries of the surface map.
    """

    def __init__(
        self,
        config: Config,
        robot: SharedRobot,
        frames: KnownFrames,
        mover: JointMover,
        surfaces: SurfaceServices,
    ):
        self._config, self._settings = config, config.scan_here
        self._robot, self._frames, self._mover, self._surfaces = robot, frames, mover, surfaces
        self._solutions: dict[int, list[int]] = {}
        self._is_closed = threading.Event()
        self._goal: Any = None
        self._start: Float64 | None = None

    def note_message(self, stamp_ns: int, number: int) -> None:
        """Note a message of a view, and the number of the first solution that contains it."""
        self._solutions.setdefault(stamp_ns, []).append(number)
        while len(self._solutions) > MAX_VIEWS:
            del self._solutions[next(iter(self._solutions))]

    def close(self) -> None:
        """Cancel the view in progress."""
        self._is_closed.set()

    def take(self, goal: Any, feedback: Callable[..., Any], result: Any) -> str:
        """Take a view and return a sentence about it.

        Parameters
        ----------
        goal
            Goal handle of action/ScanHere.
        feedback
            Creates the feedback message of the action.
        result
            Result of the action; its surfaces and objects are filled in.

        Raises
        ------
        TccmError, CancelledError
            If the view was not taken; the message gives the reason.
        """
        self._goal, self._start = goal, None

        def report(phase: int, progress: float) -> None:
            goal.publish_feedback(feedback(phase=phase, progress=progress))

        patience = goal.request.patience
        patience_s = patience.sec + patience.nanosec * 1e-9 or PATIENCE_S
        report(WAITING, 0.0)
        late = f"the base has not stood still within {patience_s:g} s"
        try:
            self._wait(self._frames.is_base_standing, patience_s, late)
        except MotionError:
            self._frames.base_pose()  # raises the more specific error if the pose is unknown
            raise
        self._start = self._frames.base_pose()
        spans = self._move(goal.request, lambda fraction: report(MOVING, MOVED_PROGRESS * fraction))
        report(MAPPING, MOVED_PROGRESS)
        views_ns = self._wait_for_map(spans)
        return self._surfaces.fill_view(result, views_ns)

    def _move(self, request: Any, report: Callable[[float], None]) -> list[tuple[int, int]]:
        """Move the joints; return the start and end time of each tilt movement, ns."""
        low, high = request.min_tilt, request.max_tilt
        if low == high == 0.0:
            low, high = self._settings.tilt_range
        velocity = request.max_velocity or self._settings.velocity
        tilt, pan = self._config.frames.tilt_joint, self._settings.pan_joint
        targets = [{pan: angle} for angle in request.pan_angles] or [{}]
        spans = []
        for k, target in enumerate(targets):
            report(k / len(targets))
            first, last = movement_ends(self._angle(tilt), low, high)
            start = {**target, tilt: first}
            self._send(start, {joint: self._angle(joint) for joint in start}, velocity)
            begin_ns = self._message_time_ns()
            # The last joint states may be delayed: rely on the controller's report of the start.
            self._send({**target, tilt: last}, start, velocity)
            spans.append((begin_ns, self._message_time_ns()))
        return spans

    def _send(self, target: dict[str, float], start: dict[str, float], velocity: float) -> None:
        way = max(abs(start[joint] - angle) for joint, angle in target.items())
        self._mover.move(target, way / velocity, self._wait)

    def _wait_for_map(self, spans: list[tuple[int, int]]) -> list[int]:
        """Return the stamps of the views within time spans, once all are in the map."""

        def views(begin_ns: int, end_ns: int) -> list[int]:
            known = dict(self._solutions)
            return [s for s, n in known.items() if begin_ns <= s <= end_ns and len(n) >= MESSAGES]

        end_ns = spans[-1][1]

        def is_complete() -> bool:
            is_over = self._message_time_ns() - end_ns > LAST_VIEW_NS
            return is_over and all(views(*span) for span in spans)

        self._wait(
            is_complete, VIEW_S,
            "no tilt cycle came of the movement; is tccm_node running, does its sensor move "
            "with the joint, and by cycle.min_sweep or more?",
        )  # fmt: skip
        found = [ns for span in spans for ns in views(*span)]
        number = max(max(self._solutions[stamp_ns]) for stamp_ns in found)
        self._wait(
            lambda: self._surfaces.number >= number, SOLUTION_S,
            "the view was taken, but no solution has it yet; ask ~/find_surfaces later",
        )  # fmt: skip
        return found

    def _wait(self, is_met: Callable[[], bool], timeout_s: float, failure: str) -> None:
        """Return when a condition is met.

        Raises
        ------
        MotionError
            With the text `failure` after the timeout; if the base moves; if the node ends.
        CancelledError
            If the goal is cancelled.
        """
        end_s = time.monotonic() + timeout_s
        while not is_met():
            if self._goal.is_cancel_requested:
                raise CancelledError
            self._check_base()
            if time.monotonic() > end_s:
                raise MotionError(failure)
            if self._is_closed.wait(POLL_S):
                raise MotionError("the node ends")
        self._check_base()

    def _check_base(self) -> None:
        if self._start is not None and not is_near(self._frames.base_pose(), self._start):
            raise MotionError("the robot has moved while the view was taken")

    def _message_time_ns(self) -> int:
        return self._robot.robot.message_time_ns or 0

    def _angle(self, joint: str) -> float:
        """Return the newest position of a joint, rad.

        Raises
        ------
        MotionError
            If no position has been received.
        """
        with self._robot.lock:
            track = self._robot.robot.joints.of(joint)
            if not len(track):
                heard = ", ".join(self._robot.robot.joints.heard()) or "none"
                raise MotionError(f"nothing was heard of joint '{joint}'; joints heard: {heard}")
            return float(track.values[-1, 0])
