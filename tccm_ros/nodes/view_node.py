"""view_node: the live page, in a separate process so that it does not delay scans.

It reads the map as every client does, by `SurfaceMapClient`, and serves it to browsers and, with
the measurements of the sensors, to a running Rerun viewer.
"""

from __future__ import annotations

import asyncio
import queue
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.task import Future

from tccm_ros.config import Config
from tccm_ros.errors import MissingExtraError, RequestError, one_line
from tccm_ros.extras import check_extra
from tccm_ros.nodes.interfaces import missing_interfaces
from tccm_ros.nodes.params import GROUPS, declare_config, follow_changes
from tccm_ros.nodes.qos import EVENTS_DEPTH, latched_qos
from tccm_ros.nodes.run import run
from tccm_ros.records.building import stamp_ns_from_message
from tccm_ros.view.live_state import LiveState

if TYPE_CHECKING:
    from tccm_ros.nodes.rerun_feed import RerunFeed
    from tccm_ros.view.rerun_stream import RerunStream

LOOK_S = 0.5
"""Period of the check for slam_node's services, s."""

PARAMETERS = {
    "view.host": ("127.0.0.1", "address to listen at; any other lets the network see the map"),
    "view.port": (8095, "port to listen at; 0 takes a free one"),
    "view.rerun": ("", "address of a Rerun viewer, rerun+http://HOST:PORT/proxy; empty for none"),
    "map_node": ("surface_slam", "node that has the map"),
    "approach_node": ("approach", "node that knows the names of spots"),
    "tccm_node": ("tccm", "node of the tilt cycles, which a Rerun viewer shows"),
}

INT32_MAX = 2**31 - 1

LEVELS = {
    DiagnosticStatus.OK: "OK",
    DiagnosticStatus.WARN: "warning",
    DiagnosticStatus.ERROR: "error",
    DiagnosticStatus.STALE: "stale",
}


class ViewNode(Node):
    """Serves the live page of one slam_node.

    Parameters
    ----------
    kwargs
        Arguments of `rclpy.node.Node`.

    Attributes
    ----------
    page
        The server; its `url` contains the token.

    Raises
    ------
    MissingExtraError
        Without the extra `view` or tccm_interfaces.
    OutputError
        If the address cannot be bound.
    """

    def __init__(self, **kwargs: Any):
        super().__init__("view", **kwargs)
        check_extra("view", "aiohttp")
        if missing_interfaces():
            raise MissingExtraError(f"the live page: {missing_interfaces()}")
        from tccm_ros.nodes.clients.live_entities import entities_of, event_text
        from tccm_ros.nodes.clients.map_client import SurfaceMapClient
        from tccm_ros.view.live_page import LivePage

        host, port, viewer, name, approach_name, tccm_name = (
            self.declare_parameter(key, default, ParameterDescriptor(description=meaning)).value
            for key, (default, meaning) in PARAMETERS.items()
        )
        self.config = declare_config(self, groups=GROUPS["view"])
        follow_changes(self, self.config)
        self._entities_of = entities_of
        self._requests = {
            "rename": self._rename,
            "placements": self._find_placements,
            "name": self._name_spot,
            "save": self._save,
        }
        self._pending: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._wake = self.create_guard_condition(self._handle_requests)
        self.page = LivePage(self._ask, frozenset(self._requests), host, port)
        self._rerun = _rerun_stream(viewer, self.config)
        self._client = SurfaceMapClient(self, name, approach_name=approach_name)
        self._map_frame = "map"
        self._client.on_event(lambda e: self._update(lambda s: s.add_event(event_text(e))))
        for kind, topic, take, qos in (
            (_surface_map(), f"{name}/surface_map", self._take_map, latched_qos()),
            (Path, f"{name}/path", self._take_path, latched_qos()),
            (PoseWithCovarianceStamped, "pose", self._take_pose, EVENTS_DEPTH),
            (DiagnosticArray, "/diagnostics", self._take_diagnostics, EVENTS_DEPTH),
        ):
            self.create_subscription(kind, topic, take, qos)
        self._feed = self._rerun and self._feed_of(self._rerun, name, tccm_name)
        self.create_timer(LOOK_S, self._look)
        self.get_logger().info(f"live page: {self.page.url}")

    def close(self) -> None:
        """End the server and notify its pages."""
        self.page.close()
        if self._feed is not None:
            self._feed.close()
        if self._rerun is not None:
            self._rerun.close()
        self._client.close()

    def _feed_of(self, viewer: RerunStream, name: str, tccm_name: str) -> RerunFeed:
        """Return the feed of measurements to a viewer."""
        from tccm_ros.nodes.rerun_feed import RerunFeed

        return RerunFeed(self, self.config, name, tccm_name, viewer)

    def _update(self, change: Callable[[LiveState], object]) -> None:
        """Change what the page and the viewer show."""
        self.page.update(change)
        if self._rerun is not None:
            self._rerun.update(change)

    # --- subscriptions ---

    def _take_map(self, message: Any) -> None:
        found = self._entities_of(message)
        self._map_frame = message.header.frame_id
        stamp_ns = stamp_ns_from_message(message.header.stamp)

        def change(state: LiveState) -> None:
            path = state.entities.get("path")
            state.entities = {**found, **({} if path is None else {"path": path})}
            state.stamp_ns = max(state.stamp_ns, stamp_ns)

        self._update(change)

    def _take_path(self, message: Any) -> None:
        from tccm_ros.view.live_state import path_entity

        xy = np.array([(p.pose.position.x, p.pose.position.y) for p in message.poses])
        if len(xy):
            path = path_entity(xy)
            self._update(lambda state: state.entities.update(path=path))

    def _take_pose(self, message: Any) -> None:
        from tccm_ros.nodes.clients.live_entities import xy_yaw

        pose, stamp_ns = xy_yaw(message.pose.pose), stamp_ns_from_message(message.header.stamp)

        def change(state: LiveState) -> None:
            state.pose, state.stamp_ns = pose, max(state.stamp_ns, stamp_ns)

        self._update(change)

    def _take_diagnostics(self, message: Any) -> None:
        found = {s.name: f"{LEVELS.get(s.level, '?')}: {s.message}" for s in message.status}

        def change(state: LiveState) -> None:
            state.status = {**state.status, "nodes": {**state.status.get("nodes", {}), **found}}

        self._update(change)

    def _look(self) -> None:
        ready, known = self._client.has_services, self._client.localisation
        text = "no pose yet" if known is None else f"{known.state} {known.reason}".strip()
        answer = {"ready": ready, "localisation": text, "can_name": self._client.can_approach}
        self._update(lambda state: setattr(state, "status", {**state.status, **answer}))

    # --- requests of pages ---

    async def _ask(self, name: str, values: Mapping[str, Any]) -> Any:
        """Send a page's request in the executor's thread (called in the server's thread)."""
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[Any] = loop.create_future()

        def resolve(answer: Any, error: Exception | None) -> None:
            if answered.done():
                return
            if error is None:
                answered.set_result(answer)
            else:
                answered.set_exception(RequestError(one_line(error)))

        def begin() -> None:
            try:
                future, read = self._requests[name](values)
            except Exception as error:
                loop.call_soon_threadsafe(resolve, None, _named(error))
                return
            future.add_done_callback(partial(self._finish, loop, resolve, read))

        self._pending.put(begin)
        self._wake.trigger()
        return await answered

    @staticmethod
    def _finish(loop: Any, resolve: Any, read: Callable[[Any], Any], future: Future) -> None:
        try:
            answer, error = read(future.result()), None
        except Exception as raised:
            answer, error = None, raised
        loop.call_soon_threadsafe(resolve, answer, error)

    def _handle_requests(self) -> None:
        while not self._pending.empty():
            self._pending.get()()

    def _rename(self, values: Mapping[str, Any]) -> tuple[Future, Callable[[Any], Any]]:
        surface, label = _identity(values), _text(values, "label")
        return self._client.set_label(surface, label), lambda message: {"message": message}

    def _find_placements(self, values: Mapping[str, Any]) -> tuple[Future, Callable[[Any], Any]]:
        from tccm_interfaces.msg import SurfaceFilter

        size = [float(value) for value in values["size"]]
        wanted = SurfaceFilter(ids=[_identity(values)])

        def read(found: Any) -> dict[str, Any]:
            answer = [
                {
                    "surface_id": place.surface_id,
                    "position": [round(float(v), 3) for v in place.T_map_object[:3, 3]],
                    "clearance": round(float(place.clearance), 3),
                }
                for place in found
            ]
            return {"placements": answer, "message": found.message}

        return self._client.find_placements(size, wanted, max_count=1), read

    def _name_spot(self, values: Mapping[str, Any]) -> tuple[Future, Callable[[Any], Any]]:
        from tccm_interfaces.msg import SurfaceFilter

        surface, name, spot = _identity(values), _text(values, "name"), values.get("spot")
        if spot is not None and not (isinstance(spot, list) and len(spot) == 2):
            raise RequestError(f"spot is {one_line(ValueError(spot))}; expected (x, y), m")
        spot = None if spot is None else [float(value) for value in spot]
        wanted = SurfaceFilter(ids=[surface])
        future = self._client.set_name(name, wanted, spot=spot, frame=self._map_frame)
        return future, lambda message: {"message": message}

    def _save(self, values: Mapping[str, Any]) -> tuple[Future, Callable[[Any], Any]]:
        future = self._client.save_named_map(_text(values, "name"))
        return future, lambda saved: {"message": f"saved as {saved.name}"}


def _rerun_stream(url: str, config: Config) -> RerunStream | None:
    """Return the connection to a viewer; None without an address.

    Raises
    ------
    MissingExtraError, ConfigError
        Without rerun-sdk, and for another kind of address.
    """
    if not url:
        return None
    check_extra("view", "rerun")
    from tccm_ros.view.rerun_stream import RerunStream

    return RerunStream(url, config)


def _surface_map() -> type:
    from tccm_interfaces.msg import SurfaceMap

    return SurfaceMap


def _identity(values: Mapping[str, Any]) -> int:
    """Return the surface id of a page's request."""
    value = values["surface_id"]
    if type(value) is not int or not 0 <= value <= INT32_MAX:
        raise RequestError(f"surface_id is {one_line(ValueError(value))}; expected an id")
    return value


def _text(values: Mapping[str, Any], key: str) -> str:
    """Return a string of a page's request."""
    if not isinstance(values[key], str):
        raise RequestError(f"{key} must be a string")
    return str(values[key])


def _named(error: Exception) -> Exception:
    return RequestError(f"{error.args[0]} is missing") if isinstance(error, KeyError) else error


def main() -> None:
    """Serve the page until the node is asked to stop."""
    run(ViewNode)


if __name__ == "__main__":
    main()
