"""approach_node: drives the base to surfaces of the map, and back.

The control loop and the subscriptions to the base's sensors run in one thread, actions and the map
in the executor. The node sends commands only while a goal is active, and zero at its end.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid as GridMessage
from rclpy.action import ActionServer, CancelResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from tccm_ros.approach.approach import Approach
from tccm_ros.approach.detection import Detection
from tccm_ros.approach.drive import PERIOD_S
from tccm_ros.approach.missing_input import missing_input
from tccm_ros.approach.names import NamedSpot
from tccm_ros.approach.outcome import Outcome, Reason
from tccm_ros.approach.readings import Readings
from tccm_ros.approach.retreat import Retreat
from tccm_ros.approach.settings import Goal, RobotBase, Surroundings
from tccm_ros.approach.speeds import STOP, Speeds
from tccm_ros.arrays import Float64
from tccm_ros.errors import MissingExtraError, MotionError, RequestError, TccmError, one_line
from tccm_ros.geometry import spatial
from tccm_ros.nodes.approach.base_inputs import BaseInputs
from tccm_ros.nodes.approach.goals import (
    MAX_BACK_M,
    checked,
    goal_of,
    grid_of,
    robot_of,
    surroundings_of,
)
from tccm_ros.nodes.approach.names import NoSurfaceError, SpotNames, filter_of, place_on
from tccm_ros.nodes.approach.nav2_navigator import Nav2Navigator
from tccm_ros.nodes.clients.requests import stamped_point
from tccm_ros.nodes.clock import steady_timer
from tccm_ros.nodes.intake.refusals import Refusals
from tccm_ros.nodes.interfaces import missing_interfaces
from tccm_ros.nodes.params import GROUPS, declare_config, follow_changes
from tccm_ros.nodes.qos import latched_qos
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.run import run
from tccm_ros.records.building import frame_name
from tccm_ros.ros.map_records import MapSurface
from tccm_ros.ros.types import header_message, pose_message
from tccm_ros.slam.occupancy import OccupancyGrid

ZEROS = 2
"""Number of zero commands at the end of a goal: a best-effort subscriber may lose one."""

CATCH_UP_S = 0.3
"""Time after a step longer than the period in which the messages of that step are read, s: until
then the base waits if an input seems to be missing. As `missing_input.POSE_S`."""

PERIOD_NS = round(PERIOD_S * 1e9)
"""Period of the control loop, ns."""

MAX_ZEROS = 100
"""Maximum number of zero commands while Nav2 ends its drive, 5 s. Chosen."""

ANSWER_S = 5.0
"""Timeout of requests to the map's node, s. Chosen."""

FEEDBACK_STEPS = 10
"""Steps of the control loop between feedback messages: two per second."""


@dataclass(slots=True, eq=False)
class ActiveGoal:
    """An active goal.

    Attributes
    ----------
    machine
        Its state machine.
    robot
        The base, with the footprint of the goal.
    done
        Future of the outcome.
    handle
        Handle of the goal.
    publish
        Publishes feedback.
    is_stopped
        Whether a cancellation has stopped the base: only zero is sent from then on. The handle's
        own state changes too late, after the callback that stops the base.
    steps, zeros
        Numbers of steps, and of zero commands after the outcome.
    published_s
        Stamp of the newest published detection, s.
    failure
        Outcome if the steps failed, which replaces that of the machine; else None.
    """

    machine: Approach | Retreat | Detection
    robot: RobotBase
    done: Future
    handle: Any
    publish: Callable[[Readings], None]
    is_stopped: bool = False
    steps: int = 0
    zeros: int = 0
    published_s: float = -math.inf
    failure: Outcome | None = None

    @property
    def is_driving(self) -> bool:
        """Whether the goal moves the base."""
        return not isinstance(self.machine, Detection)


class ApproachNode(Node):
    """Offers ~/approach_surface, ~/retreat, ~/resolve_name, ~/set_name and ~/detected_dock_pose.

    Parameters
    ----------
    kwargs
        Those of `rclpy.node.Node`.

    Raises
    ------
    MissingExtraError
        Without tccm_interfaces.
    """

    def __init__(self, **kwargs: Any):
        super().__init__("approach", **kwargs)
        if missing_interfaces():
            raise MissingExtraError(f"approach_node: {missing_interfaces()}")
        from tccm_ros.nodes.clients.map_client import SurfaceMapClient

        self.config = declare_config(self, groups=GROUPS["approach"])
        follow_changes(self, self.config)
        robot_of(self.config)
        name = self.declare_parameter("map_node", "surface_slam").value
        self._types = RosidlMessages()
        self._refusals = Refusals(self.get_logger().error)
        self._client = SurfaceMapClient(self, name)
        self._grid: OccupancyGrid | None = None
        self._grid_problem = ""
        self.create_subscription(GridMessage, "map", self._take_grid, latched_qos())
        kind = TwistStamped if self.config.approach.stamped else Twist
        self._commands = self.create_publisher(kind, "cmd_vel", 1)
        self._dock_poses = self.create_publisher(PoseStamped, "~/detected_dock_pose", 1)
        self._navigator = self._find_navigator()
        self._lock = threading.Lock()
        self._drive: ActiveGoal | None = None
        self._is_taken = self._is_ending = False
        self._reading_until_s = -math.inf
        self.inputs = BaseInputs(
            self, self.config, lambda: self._client.localisation, self._refusals
        )
        self._start_loop()
        self._create_actions()
        self._names = SpotNames(
            self,
            self._types,
            lambda: Path(self.config.approach.names).expanduser(),
            self._surface,
            self._plan,
            self._in_map,
            self.config.frames.map_name,
        )
        self.inputs.intake.start()
        self.get_logger().info("ready; the base moves only while a goal is active")

    def _create_actions(self) -> None:
        actions = import_module("tccm_interfaces.action")
        self._approach, self._retreat = actions.ApproachSurface, actions.Retreat
        self._servers = [
            ActionServer(self, kind, name, execute, cancel_callback=self._take_cancel)
            for kind, name, execute in (
                (self._approach, "~/approach_surface", self._execute_approach),
                (self._retreat, "~/retreat", self._execute_retreat),
            )
        ]

    def _find_navigator(self) -> Nav2Navigator | None:
        """Return the client of Nav2's navigator; None without nav2_msgs or its name."""
        name = self.config.approach.navigator
        if name:
            with suppress(ImportError):
                return Nav2Navigator(self, self._types, name, self.config.frames.map_name)
        return None

    def _start_loop(self) -> None:
        """Start the timer of the control loop: on the node's clock in simulated time, else on a
        steady clock.
        """
        is_simulated = bool(self.get_parameter("use_sim_time").value)
        clock = self.get_clock() if is_simulated else Clock(clock_type=ClockType.STEADY_TIME)
        intake = self.inputs.intake
        timer = self.create_timer(PERIOD_S, self._step, callback_group=intake.group, clock=clock)
        intake.add_timer(timer)

    # --- the end ---

    def interrupt(self) -> None:
        """Stop the base when the process is interrupted; called in another thread."""
        self._is_ending = True
        with suppress(Exception):
            self._stop(self._drive)

    def close(self) -> None:
        """Stop the base and the subscriptions."""
        drive = self._drive
        self._is_ending = True
        self.inputs.intake.close()
        self._stop(drive)
        if self._navigator is not None:
            self._navigator.close()
        for server in self._servers:
            server.destroy()

    # --- the control loop, in the intake's thread ---

    def _step(self) -> None:
        drive = self._drive
        if drive is None:
            return
        start_s = time.monotonic()
        try:
            outcome = self._drive_on(drive)
        except Exception as error:
            self.get_logger().error(f"stopped: {one_line(error)}")
            outcome = drive.failure  # set: its zero commands failed as well
            why = f"stopped, as a step failed: {one_line(error)}"
            self._fail(drive, Outcome(Reason.BLOCKED, why))
        end_s = time.monotonic()
        if end_s - start_s > PERIOD_S:
            self._reading_until_s = end_s + CATCH_UP_S
        if outcome is not None:
            self._drive = None
            drive.done.set_result(outcome)
            if self.executor is not None:
                self.executor.wake()

    def _drive_on(self, drive: ActiveGoal) -> Outcome | None:
        """Send the command of this step; return the outcome once `ZEROS` zero commands are sent."""
        machine, patience_s = drive.machine, drive.robot.patience_s
        outcome = drive.failure or machine.outcome
        if outcome is not None:
            return self._finish_drive(drive, outcome)
        start_ns = self.get_clock().now().nanoseconds
        readings = self.inputs.newest(start_ns, drive.robot.footprint)
        if readings is None:
            self._fail(drive, Outcome(Reason.LOST_POSE, "no odometry has come"))
            return None
        if self._is_ending or drive.handle.is_cancel_requested:
            speeds = machine.cancel(readings)
        elif time.monotonic() < self._reading_until_s and missing_input(readings, patience_s):
            speeds = machine.wait(readings)
        else:
            speeds = machine.step(readings)
            end_ns = self.get_clock().now().nanoseconds
            if end_ns - start_ns > PERIOD_NS:
                # The base has moved on since: a command for its old place may touch something.
                speeds = None if speeds is None else machine.wait(readings)
        if speeds is not None:
            with self._lock:
                # A cancellation may have stopped the base during the step.
                self._send(STOP if drive.is_stopped else speeds)
        if isinstance(machine, Detection):
            self._publish_dock_pose(drive, machine)
        drive.steps += 1
        if drive.steps % FEEDBACK_STEPS == 1:
            drive.publish(readings)
        return None

    def _finish_drive(self, drive: ActiveGoal, outcome: Outcome) -> Outcome | None:
        """Send zero `ZEROS` times, and until Nav2 has ended; then return the outcome."""
        if not drive.is_driving:
            return outcome
        self._send(STOP)
        drive.zeros += 1
        is_stopping = self._navigator is not None and self._navigator.is_active
        is_over = drive.zeros >= (MAX_ZEROS if is_stopping else ZEROS)
        return outcome if is_over else None

    def _fail(self, drive: ActiveGoal, failure: Outcome) -> None:
        """Stop at once; the next steps finish the drive with this outcome."""
        drive.failure = failure
        self._stop(drive)

    def _stop(self, drive: ActiveGoal | None) -> None:
        """Stop the base and Nav2 at once, unless the goal does not move the base."""
        if drive is None or not drive.is_driving:
            return
        if self._navigator is not None:
            self._navigator.cancel()
        self._send(STOP)

    def _publish_dock_pose(self, drive: ActiveGoal, detection: Detection) -> None:
        """Publish the pose of the base at the surface, once for each tilt cycle that shows it."""
        if detection.pose is None or detection.stamp_s <= drive.published_s:
            return
        drive.published_s = detection.stamp_s
        header = header_message(self._types, round(detection.stamp_s * 1e9), self.inputs.odom_frame)
        pose = pose_message(self._types, spatial(self.inputs.in_odom(detection.pose)))
        self._dock_poses.publish(PoseStamped(header=header, pose=pose))

    def _send(self, speeds: Speeds) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = float(speeds.forward), float(speeds.yaw_rate)
        if self.config.approach.stamped:
            stamped = TwistStamped(twist=twist)
            stamped.header.stamp = self.get_clock().now().to_msg()
            stamped.header.frame_id = self.config.frames.base or "base_link"
            self._commands.publish(stamped)
        else:
            self._commands.publish(twist)

    # --- the map ---

    def _take_grid(self, message: Any) -> None:
        try:
            self._grid, self._grid_problem = grid_of(message), ""
        except MotionError as error:
            self._grid, self._grid_problem = None, str(error)
            self.get_logger().error(str(error))

    def _in_map(self, stamped: Any) -> Float64:
        """Return a geometry_msgs/PointStamped as (2,) in map.

        Raises
        ------
        MotionError
            If the frame is neither the map's nor the base's, or the point is not finite.
        """
        xy = np.array([stamped.point.x, stamped.point.y])
        if not np.isfinite(xy).all():
            raise MotionError("the spot is not finite")
        frame = frame_name(stamped.header.frame_id)
        if frame == self.config.frames.map_name:
            return xy
        known = self._client.localisation
        if frame in ("base_link", self.config.frames.base) and known is not None:
            T = known.T_map_base
            return np.asarray(T[:2, :2] @ xy + T[:2, 3])
        raise MotionError(
            f"the spot is in frame '{frame}'; give it in '{self.config.frames.map_name}'"
        )

    async def _surface(self, wanted: Any) -> Any:
        """Return the first surface that meets a filter.

        Raises
        ------
        TccmError
            If the map's node does not answer.
        NoSurfaceError
            If no surface meets the filter, or the first one is the floor.
        """
        if not wanted.near.header.frame_id:
            known = self._client.localisation
            if known is not None:
                wanted.near.header.frame_id = self.config.frames.map_name
                wanted.near.point.x, wanted.near.point.y = known.T_map_base[:2, 3].tolist()
        found = await self._answer(self._client.find_surfaces(wanted))
        if not found:
            raise NoSurfaceError(f"no surface of the map meets the conditions: {found.message}")
        if found[0].label == "floor":
            raise NoSurfaceError("the floor is no surface to approach")
        return found[0]

    def _plan(self, request: Any, surface: MapSurface) -> tuple[RobotBase, Goal, Surroundings]:
        """Return the base, the goal and the map around a surface, of a goal of ApproachSurface.

        Raises
        ------
        MotionError
            If a value is out of range, or without a usable grid.
        """
        if self._grid_problem:
            raise MotionError(self._grid_problem)
        robot = robot_of(self.config, request.footprint)
        goal = goal_of(request, surface, self.config, self._in_map)
        return robot, goal, surroundings_of(self._grid, self._client.surfaces, surface)

    def _take_spot(self, request: Any, named: NamedSpot, surface: MapSurface) -> None:
        """Give a goal the spot and the side of a name, unless it has its own."""
        if named.spot is not None and not request.spot.header.frame_id:
            request.spot = stamped_point(place_on(surface, named), self.config.frames.map_name)
        if named.side is not None and not request.has_side:
            request.has_side, request.side = True, named.side

    async def _answer(self, asked: Future) -> Any:
        """Return the response of the map's node; raise RequestError after `ANSWER_S`."""

        def give_up() -> None:
            if not asked.done():
                why = f"the map's node has not answered within {ANSWER_S:g} s"
                asked.set_exception(RequestError(why))

        timer = steady_timer(self, ANSWER_S, give_up)
        try:
            return await asked
        finally:
            self.destroy_timer(timer)

    # --- actions, in the executor ---

    def _take_cancel(self, handle: Any) -> CancelResponse:
        """Stop the base at once, also while a step of the control loop computes."""
        with self._lock:
            drive = self._drive
            if drive is not None and drive.handle is handle:
                drive.is_stopped = True
                self._stop(drive)
        return CancelResponse.ACCEPT

    async def _execute_approach(self, handle: Any) -> Any:
        result = self._approach.Result(
            surface_id=-1, gap=math.nan, yaw_error=math.nan, gap_sigma=math.nan, distance=math.nan
        )
        result.surface_pose.position.x = result.surface_pose.position.y = math.nan
        result.surface_pose.position.z = math.nan

        async def prepare() -> tuple[Approach | Detection, Any]:
            request = handle.request
            named = self._names.spot(request.name) if request.name else None
            if named is not None:
                request.filter = filter_of(named)
            surface = await self._surface(request.filter)
            result.surface_id = surface.id
            if named is not None:
                self._take_spot(request, named, surface)
            robot, goal, around = self._plan(request, surface)
            if request.detect_only:
                return Detection(robot, goal, around), robot
            navigator = self._navigator
            if navigator is not None and not navigator.is_ready:
                navigator = None
            return Approach(robot, goal, around, navigator), robot

        def publish(machine: Any, readings: Readings) -> None:
            gap = machine.gap(readings.pose)
            handle.publish_feedback(
                self._approach.Feedback(phase=int(machine.phase), gap=float(gap))
            )

        outcome = await self._run(handle, prepare, publish)
        result.gap, result.yaw_error = float(outcome.gap), float(outcome.yaw_error)
        result.gap_sigma, result.distance = float(outcome.sigma), float(outcome.distance)
        result.has_moved = bool(outcome.has_moved)
        if outcome.surface is not None:
            T = spatial(outcome.surface, outcome.height)
            result.surface_pose = pose_message(self._types, T)
        return self._finish(handle, result, outcome)

    async def _execute_retreat(self, handle: Any) -> Any:
        async def prepare() -> tuple[Retreat, Any]:
            default = self.config.approach.staging_distance
            distance = checked("distance", handle.request.distance, default, 0.01, MAX_BACK_M)
            robot = robot_of(self.config)
            return Retreat(robot, distance), robot

        def publish(machine: Any, readings: Readings) -> None:
            handle.publish_feedback(
                self._retreat.Feedback(distance=float(machine.way(readings.pose)))
            )

        outcome = await self._run(handle, prepare, publish)
        result = self._retreat.Result(distance=float(np.nan_to_num(outcome.distance)))
        return self._finish(handle, result, outcome)

    async def _run(
        self, handle: Any, prepare: Callable[[], Any], publish: Callable[[Any, Readings], None]
    ) -> Outcome:
        """Drive a goal to its end; return the outcome."""
        with self._lock:
            if self._is_taken:
                return Outcome(Reason.BUSY, "another goal runs; wait for its result, or cancel it")
            self._is_taken = True
        try:
            machine, robot = await prepare()
            done: Future = Future(executor=self.executor)
            self._drive = ActiveGoal(machine, robot, done, handle, partial(publish, machine))
            outcome: Outcome = await done
            return outcome
        except NoSurfaceError as error:
            return Outcome(Reason.NO_SURFACE, one_line(error))
        except TccmError as error:
            return Outcome(Reason.BAD_GOAL, one_line(error))
        finally:
            self._is_taken = False

    def _finish(self, handle: Any, result: Any, outcome: Outcome) -> Any:
        """Set the fields common to the results of both actions, and end the goal."""
        result.message, result.reason = outcome.message, int(outcome.reason)
        result.success = outcome.reason == Reason.NONE
        if result.success:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result


def main() -> None:
    """Run the node until it is interrupted."""
    run(ApproachNode)


if __name__ == "__main__":
    main()
