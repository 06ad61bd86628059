"""Localisation state of the robot: ``~/localisation``, ``/initialpose`` and ``~/set_pose``."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Any

import numpy as np
from rclpy.node import Node

from tccm_ros.arrays import Float64
from tccm_ros.errors import FrameError
from tccm_ros.geometry import planar, pose_from_quaternion
from tccm_ros.nodes.qos import latched_qos
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.records import PoseGuess
from tccm_ros.records.building import frame_name, stamp_ns_from_message
from tccm_ros.ros.output_messages import pose_covariance_message
from tccm_ros.ros.types import MessageTypes, header_message, stamp_message
from tccm_ros.slam.tracking import LocalisationState, Tracker

LOCALISATION = "tccm_interfaces/msg/Localisation"

PERIOD_NS = 1_000_000_000
"""Maximum period of ``~/localisation`` while scans arrive; each change is published at once."""

ROUGH_GUESS = np.diag([0.5**2, 0.5**2, np.radians(15.0) ** 2])
"""Covariance of a user-supplied pose without one (srv/SetPose)."""

BY_START, BY_REQUEST, BY_SCAN, BY_LOOP, BY_SIGN = range(5)
"""Values of `placed_by` in msg/Localisation: the source of the robot's pose."""

REASONS = {
    LocalisationState.UNKNOWN: "there has been no level scan yet",
    LocalisationState.TRACKING: "",
    LocalisationState.LOST: (
        "level scans contradict the map at the known pose, or match nothing: the robot was "
        "carried, or odometry is missing"
    ),
}
"""Reason by state; that of a search depends on the request."""

NO_MAP = "there is no map yet in which a pose could be set"


class LocalisationPublisher:
    """Publishes ``~/localisation`` if tccm_interfaces is installed.

    Parameters
    ----------
    node, types
        The node and its message classes.
    map_frame
        Name of the map's frame.
    on_guess
        Called with each user-supplied pose; returns a future of a sentence, or raises FrameError.

    Attributes
    ----------
    map_name
        Name under which the map was saved or loaded; empty if it has none.
    """

    def __init__(
        self,
        node: Node,
        types: MessageTypes,
        map_frame: str,
        on_guess: Callable[[PoseGuess], Any],
    ):
        self._types, self._map_frame, self._on_guess = types, map_frame, on_guess
        self._logger = node.get_logger()
        self._state, self._since_ns, self._shown_ns = LocalisationState.UNKNOWN, 0, -1
        self._searching = self.map_name = ""
        self._placed_by, self._next_by, self._placed_ns, self._keyframe = BY_START, BY_START, 0, -1
        self._sign = -1
        self._publisher = None
        self._newest: Any = None
        with suppress(ImportError):
            self._publisher = node.create_publisher(
                message_class(LOCALISATION), "~/localisation", latched_qos()
            )
        self._subscription: Any = None

    def listen(self, node: Node) -> None:
        """Subscribe to ``initialpose``."""
        self._subscription = node.create_subscription(
            message_class("geometry_msgs/msg/PoseWithCovarianceStamped"),
            "initialpose",
            self._take_guess,
            1,
        )

    def unsubscribe(self, node: Node) -> None:
        """Destroy the subscription of ``initialpose``."""
        if self._subscription is not None:
            node.destroy_subscription(self._subscription)
            self._subscription = None

    def offer_service(self, node: Node, answer: Callable[[Any, Any], Any]) -> None:
        """Create ``~/set_pose`` if tccm_interfaces is installed.

        Parameters
        ----------
        node
            Node of the service.
        answer
            Fills a response with the result of a future, or with the reason for its failure.
        """

        async def set_pose(request: Any, response: Any) -> Any:
            try:
                job = self._on_guess(guess_of(request.pose, self._map_frame))
            except FrameError as error:
                response.success, response.message = False, str(error)
                return response
            if self._newest is not None:
                response.localisation = self._newest
            return await answer(job, response)

        with suppress(ImportError):
            node.create_service(
                import_module("tccm_interfaces.srv").SetPose, "~/set_pose", set_pose
            )

    def _take_guess(self, message: Any) -> None:
        try:
            self._on_guess(guess_of(message, self._map_frame))
        except FrameError as error:
            self._logger.error(f"initialpose: {error}")

    def name_map(self, name: str) -> None:
        """Set the name of the map; empty for a new map."""
        self.map_name = name

    def note_search(self, reason: str, placed_by: int) -> None:
        """Note why the session's pose is searched for, and the source of the pose to be found."""
        self._searching, self._next_by = reason, placed_by

    def note_wait(self, reason: str) -> None:
        """Note the condition that the search waits for."""
        if reason and reason != self._searching:
            self._searching, self._shown_ns = reason, -1
            if self._state == LocalisationState.SEARCHING:
                self._logger.info(f"searching: {reason}")

    def note_given_pose(self, tracker: Tracker, *, is_taken: bool) -> None:
        """Note whether the user-supplied pose was accepted or the known one fits better."""
        if is_taken:
            self._place(BY_REQUEST, tracker.current_pose().stamp_ns, tracker)
            self._logger.info("the given pose is accepted: it agrees with the scans")
        else:
            self._logger.warning("the given pose fits worse than the known one and is not used")
        self._shown_ns = -1
        self.show(tracker)

    def show(self, tracker: Tracker) -> None:
        """Publish the state at the newest scan if it changed or was published a second ago."""
        state, live = tracker.state, tracker.current_pose()
        if state != self._state:
            self._note(state, live.stamp_ns, tracker)
        elif 0 <= live.stamp_ns - self._shown_ns < PERIOD_NS:
            return
        self._shown_ns = live.stamp_ns
        if self._publisher is not None:
            self._newest = self._message(tracker, live.stamp_ns, live.T_map_base)
            self._publisher.publish(self._newest)

    def _note(self, state: LocalisationState, stamp_ns: int, tracker: Tracker) -> None:
        if state == LocalisationState.LOST:
            self.note_search("the robot was carried, and its place is looked for", BY_LOOP)
        if state == LocalisationState.TRACKING and self._state != LocalisationState.LOST:
            self._sign = tracker.placed_by_sign
            self._place(self._next_by if self._sign < 0 else BY_SIGN, stamp_ns, tracker)
        self._state, self._since_ns = state, stamp_ns
        reason = self.reason
        if state in (LocalisationState.LOST, LocalisationState.SEARCHING):
            self._logger.warning(f"{state.name.lower()}: {reason}")
        elif state == LocalisationState.TRACKING:
            is_new = self._placed_by == BY_START
            place = "the map begins where the robot is" if is_new else "found in the map"
            self._logger.info(f"tracking: {place}")

    def _place(self, placed_by: int, stamp_ns: int, tracker: Tracker) -> None:
        self._placed_by, self._placed_ns = placed_by, stamp_ns
        self._keyframe = tracker.solved_keyframe

    @property
    def reason(self) -> str:
        """Reason for a state other than tracking; empty while tracking."""
        return REASONS.get(self._state, self._searching)

    def _message(self, tracker: Tracker, stamp_ns: int, T_map_base: Float64) -> Any:
        is_known = self._state == LocalisationState.TRACKING
        cov = tracker.current_covariance() if is_known else np.full((6, 6), np.nan)
        stamped = pose_covariance_message(self._types, stamp_ns, self._map_frame, T_map_base, cov)
        return self._types.make(
            LOCALISATION,
            header=header_message(self._types, stamp_ns, self._map_frame),
            state=int(self._state),
            reason=self.reason,
            since=stamp_message(self._types, self._since_ns),
            pose=stamped.pose,
            placed_by=self._placed_by,
            placed_at=stamp_message(self._types, self._placed_ns),
            sign_id=self._sign,
            keyframe=self._keyframe if self._placed_by in (BY_SCAN, BY_LOOP) else -1,
            map_name=self.map_name,
        )


def guess_of(message: Any, map_frame: str) -> PoseGuess:
    """Return the pose of a geometry_msgs/PoseWithCovarianceStamped.

    Raises
    ------
    FrameError
        If it is not in the map's frame, or not a valid pose.
    """
    frame = frame_name(message.header.frame_id)
    if frame not in ("", map_frame):
        raise FrameError(f"a pose in frame '{frame}' is not taken; give it in '{map_frame}'")
    p, q = message.pose.pose.position, message.pose.pose.orientation
    numbers = np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
    if not np.isfinite(numbers).all() or not numbers[3:].any():
        raise FrameError("the pose is not finite, or its quaternion is zero")
    cov = np.array(message.pose.covariance, float).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
    if not np.isfinite(cov).all() or not (np.diag(cov) > 0.0).all():
        cov = ROUGH_GUESS
    stamp_ns = stamp_ns_from_message(message.header.stamp)
    return PoseGuess(stamp_ns, planar(pose_from_quaternion(numbers[:3], numbers[3:])), cov)
