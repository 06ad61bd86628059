"""Requests to approach_node: the part of `SurfaceMapClient` that moves the base."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from tccm_interfaces.action import ApproachSurface, Retreat
from tccm_interfaces.srv import ResolveName, SetName

from tccm_ros.errors import RequestError
from tccm_ros.nodes.clients.requests import ask, set_outcome


class ApproachClient:
    """Clients of the actions and services of approach_node.

    Each request returns a future, as of `set_outcome`.

    Parameters
    ----------
    node
        Node whose executor runs the callbacks.
    name
        Name of the node that drives.
    """

    def __init__(self, node: Node, name: str):
        self._actions = {
            ApproachSurface: ActionClient(node, ApproachSurface, f"{name}/approach_surface"),
            Retreat: ActionClient(node, Retreat, f"{name}/retreat"),
        }
        self._services = {
            ResolveName: node.create_client(ResolveName, f"{name}/resolve_name"),
            SetName: node.create_client(SetName, f"{name}/set_name"),
        }
        self._sent: list[Future] = []

    @property
    def is_ready(self) -> bool:
        """Whether both actions are available."""
        return all(client.server_is_ready() for client in self._actions.values())

    def ask(self, kind: type, request: Any, read: Callable[[Any], object]) -> Future:
        """Call a service; arguments as of `requests.ask`."""
        return ask(self._services[kind], request, read)

    def drive(self, kind: type, goal: Any, read: Callable[[Any], object]) -> Future:
        """Send a goal to an action; the future has the converted result.

        Parameters
        ----------
        kind
            ApproachSurface or Retreat.
        goal
            Goal, sent at once.
        read
            As in `set_outcome`.
        """
        client, future = self._actions[kind], Future()
        if not client.server_is_ready():
            future.set_exception(RequestError("nobody offers this action: is approach_node there?"))
            return future

        def ended(answered: Future) -> None:
            self._sent.remove(sent)
            set_outcome(future, answered.result().result, read)

        def taken(answered: Future) -> None:
            handle: Any = answered.result()
            handle.get_result_async().add_done_callback(ended)

        sent = client.send_goal_async(goal)
        self._sent.append(sent)
        sent.add_done_callback(taken)
        return future

    def cancel(self) -> None:
        """Cancel all goals, including one that is not accepted yet; the base stops."""
        for sent in self._sent:
            sent.add_done_callback(lambda answered: answered.result().cancel_goal_async())

    def close(self) -> None:
        """Destroy the action clients."""
        for client in self._actions.values():
            client.destroy()
