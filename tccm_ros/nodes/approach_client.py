"""Asks approach_node to drive: the part of `SurfaceMapClient` that moves the base."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from geometry_msgs.msg import PointStamped
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from tccm_interfaces.action import ApproachSurface, Retreat
from tccm_interfaces.msg import SurfaceFilter
from tccm_interfaces.srv import ResolveName, SetName

from tccm_ros.errors import RequestError
from tccm_ros.nodes.asking import ask
from tccm_ros.nodes.map_records import MapApproach, MapSpot


class ApproachClient:
    """Sends goals to approach_node.

    Each returns a future at once; it has the result, or `RequestError` with the sentence why the
    base did not get there.

    Parameters
    ----------
    node
        Node whose executor runs the callbacks.
    name
        Of the node that drives.
    """

    def __init__(self, node: Node, name: str):
        self._approach = ActionClient(node, ApproachSurface, f"{name}/approach_surface")
        self._retreat = ActionClient(node, Retreat, f"{name}/retreat")
        self._resolve = node.create_client(ResolveName, f"{name}/resolve_name")
        self._set = node.create_client(SetName, f"{name}/set_name")
        self._sent: list[Future] = []

    @property
    def is_ready(self) -> bool:
        """Whether both actions are there."""
        return bool(self._approach.server_is_ready() and self._retreat.server_is_ready())

    def approach(
        self,
        name: str,
        filter: SurfaceFilter,
        spot: Sequence[float] | None,
        frame: str,
        side: float | None,
        gap: float,
        max_distance: float,
    ) -> Future:
        """Ask for an approach, as `SurfaceMapClient.approach`."""
        goal = ApproachSurface.Goal(
            name=name, filter=filter, gap=float(gap), reach=float(max_distance)
        )
        if spot is not None:
            goal.spot = _point(spot, frame)
        if side is not None:
            goal.has_side, goal.side = True, float(side)
        return self._send(self._approach, goal, MapApproach.of)

    def retreat(self, distance: float) -> Future:
        """Ask for a retreat, as `SurfaceMapClient.retreat`."""
        goal = Retreat.Goal(distance=float(distance))
        return self._send(self._retreat, goal, lambda result: float(result.distance))

    def resolve_name(self, name: str) -> Future:
        """Resolve a name, as `SurfaceMapClient.resolve_name`."""
        return ask(self._resolve, ResolveName.Request(name=name), MapSpot.of)

    def set_name(
        self,
        name: str,
        filter: SurfaceFilter,
        spot: Sequence[float] | None,
        frame: str,
        side: float | None,
    ) -> Future:
        """Give a spot a name, as `SurfaceMapClient.set_name`."""
        request = SetName.Request(name=name, filter=filter)
        if spot is not None:
            request.spot = _point(spot, frame)
        if side is not None:
            request.has_side, request.side = True, float(side)
        return ask(self._set, request, lambda answer: str(answer.message))

    def forget_name(self, name: str) -> Future:
        """Remove a name, as `SurfaceMapClient.forget_name`."""
        request = SetName.Request(name=name, forget=True)
        return ask(self._set, request, lambda answer: str(answer.message))

    def cancel(self) -> None:
        """Cancel all goals, including one that is not accepted yet; the base stops."""
        for sent in self._sent:
            sent.add_done_callback(lambda answered: answered.result().cancel_goal_async())

    def close(self) -> None:
        """Destroy the action clients."""
        self._approach.destroy()
        self._retreat.destroy()

    def _send(self, client: Any, goal: Any, read: Callable[[Any], object]) -> Future:
        future = Future()
        if not client.server_is_ready():
            future.set_exception(RequestError("nobody offers this action: is approach_node there?"))
            return future

        def ended(answered: Future) -> None:
            self._sent.remove(sent)
            result: Any = answered.result()
            if result.result.success:
                future.set_result(read(result.result))
            else:
                future.set_exception(RequestError(result.result.message))

        def taken(answered: Future) -> None:
            handle: Any = answered.result()
            handle.get_result_async().add_done_callback(ended)

        sent = client.send_goal_async(goal)
        self._sent.append(sent)
        sent.add_done_callback(taken)
        return future


def _point(xy: Sequence[float], frame: str) -> PointStamped:
    message = PointStamped()
    message.header.frame_id = frame
    message.point.x, message.point.y = (float(value) for value in xy[:2])
    return message
