"""~/scan_here of slam_node: the action that takes a view from the robot's current pose."""

from __future__ import annotations

import math
from functools import partial
from importlib import import_module
from typing import Any

from rclpy.action import ActionServer, CancelResponse

from tccm_ros.errors import MotionError, TccmError, one_line
from tccm_ros.nodes.process.worker import Worker
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.services.joint_mover import JointMover, has_controllers
from tccm_ros.nodes.services.known_frames import KnownFrames
from tccm_ros.nodes.services.surface_services import SurfaceServices
from tccm_ros.nodes.services.view_taker import CancelledError, ViewTaker


def offer_scan_here(
    node: SensorNode, frames: KnownFrames, surfaces: SurfaceServices
) -> ViewAction | None:
    """Create the action, or log that control_msgs is not installed."""
    if has_controllers():
        return ViewAction(node, frames, surfaces)
    node.get_logger().info("control_msgs is not installed: ~/scan_here is not offered")
    return None


class ViewAction:
    """Action server of ~/scan_here.

    Parameters
    ----------
    node, frames, surfaces
        The node, the frames of its robot, and the queries of the surface map.
    """

    def __init__(self, node: SensorNode, frames: KnownFrames, surfaces: SurfaceServices):
        self._node = node
        self._kind = import_module("tccm_interfaces.action").ScanHere
        self._worker = Worker("scan_here", partial(node.refuse, "scan_here"))
        self._mover = JointMover(node, node.config.scan_here.controller)
        self._views = ViewTaker(node.config, node.robot, frames, self._mover, surfaces)
        self._is_busy = False
        self._server = ActionServer(
            node, self._kind, "~/scan_here", self._execute,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def note_view_message(self, stamp_ns: int, number: int) -> None:
        """Note a message of a view, and the number of the first solution that contains it."""
        self._views.note_message(stamp_ns, number)

    def close(self) -> None:
        """Cancel the view and destroy the server and the client, which rclpy would leave alive."""
        self._views.close()
        self._worker.close()
        self._server.destroy()
        self._mover.close()

    async def _execute(self, goal: Any) -> Any:
        result = self._kind.Result()
        try:
            result.message = await self._take(goal, result)
        except CancelledError:
            result.message = "cancelled"
            goal.canceled()
        except TccmError as error:
            result.message = one_line(error)
            goal.abort()
        else:
            result.success = True
            goal.succeed()
        return result

    async def _take(self, goal: Any, result: Any) -> str:
        if self._is_busy:
            raise MotionError("another view is being taken; wait for its result, or cancel it")
        self._check(goal.request)
        self._is_busy = True
        try:
            sentence: str = await self._worker.call(
                lambda: self._views.take(goal, self._kind.Feedback, result), self._node
            )
        finally:
            self._is_busy = False
        return sentence

    def _check(self, request: Any) -> None:
        """Raise MotionError if a goal cannot be executed."""
        if not self._node.is_active:
            raise MotionError(f"{self._node.get_name()} is not active; have it activated")
        if not self._node.config.frames.tilt_joint:
            raise MotionError("which joint tilts is not known; set frames.tilt_joint")
        if request.pan_angles and not self._node.config.scan_here.pan_joint:
            raise MotionError("pan_angles are given, but scan_here.pan_joint is not set")
        for name in ("min_tilt", "max_tilt", "max_velocity"):
            if not math.isfinite(getattr(request, name)):
                raise MotionError(f"{name} is {getattr(request, name)}; expected a finite number")
        if not all(map(math.isfinite, request.pan_angles)):
            raise MotionError("pan_angles are not finite")
        if request.max_velocity < 0.0:
            raise MotionError(f"max_velocity is {request.max_velocity:g}; expected 0 or more")
        if request.min_tilt > request.max_tilt:
            raise MotionError(
                f"min_tilt is {request.min_tilt:g}, above max_tilt, {request.max_tilt:g}"
            )
