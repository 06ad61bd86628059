"""The map and the base of running nodes for language agents."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from tccm_interfaces.msg import SurfaceFilter
from tccm_interfaces.srv import FindPlacements

from tccm_ros.agents.facts import ApproachFacts, PlacementQuery
from tccm_ros.errors import MapError, RequestError
from tccm_ros.nodes.clients.map_client import SurfaceMapClient
from tccm_ros.nodes.clients.requests import done_event
from tccm_ros.ros.map_records import Found, MapEvent, MapObject, MapPlacement, MapSurface

MAX_CHANGES = 1000
"""Changes that are kept, the newest. Chosen: days of a home; some 200 kB."""

TIMEOUT_S = 30.0
"""Longest wait for an answer of the node, s. Chosen: placements on all surfaces of a flat take less
than 1 s on a busy machine; agents give up after about a minute."""

LOOK_S = 1.0
"""Period of the check whether approach_node still runs, s."""

STOP_S = 5.0
"""Longest wait for the end of a cancelled drive, s: it takes two steps of 0.05 s and a response."""

DISCOVERY_S = 5.0
"""Longest wait for the discovery of approach_node, s: the time in which DDS finds a new process."""


class LiveMapSource:
    """The newest map of a node, its changes since the start, and placements on it; see `MapSource`.

    Methods are called from any thread but that of the node's executor.

    Parameters
    ----------
    client
        Of the node that has the map.
    name
        Of that node, for messages.
    """

    changes_note = "moved, merged, split and gone are known since tccm mcp was started"

    def __init__(self, client: SurfaceMapClient, name: str):
        self._name, self._client = name, client
        self._events: deque[MapEvent] = deque(maxlen=MAX_CHANGES)
        self._client.on_event(self._events.append)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the newest map, ns.

        Raises
        ------
        MapError
            Before the first map.
        """
        if self._client.stamp_ns is None:
            raise MapError(
                f"no map has come from {self._name} yet: is slam_node running under this name, in "
                "the same ROS_DOMAIN_ID, and has it solved a map?"
            )
        return self._client.stamp_ns

    @property
    def surfaces(self) -> Sequence[MapSurface]:
        """The surfaces, by id."""
        return self._client.surfaces

    @property
    def objects(self) -> Sequence[MapObject]:
        """The objects on surfaces."""
        return self._client.objects

    @property
    def rooms(self) -> Sequence[str]:
        """The names of the rooms in which surfaces are."""
        return sorted({s.room for s in self._client.surfaces if s.room})

    def placements(self, query: PlacementQuery) -> tuple[Sequence[MapPlacement], str]:
        """Return placements, the best first, and a sentence.

        Raises
        ------
        RequestError
            If the node refuses the query, or does not answer in time.
        """
        kinds = FindPlacements.Request
        found: Found[MapPlacement] = _result(
            self._client.find_placements(
                query.size_m,
                SurfaceFilter(ids=list(query.surface_ids)),
                clearance=query.clearance_m,
                base=kinds.BASE_FIND if query.reach_m > 0.0 else kinds.BASE_ANYWHERE,
                reach=query.reach_m,
                robot_radius=query.robot_radius_m,
                max_count=query.limit,
            )
        )
        return found, found.message

    def changes(self) -> Sequence[MapEvent]:
        """Return the changes since the start, also of surfaces that have left the map again."""
        return tuple(self._events)


class LiveMotion:
    """Drives by approach_node; see `Motion`.

    Methods are called from any thread but that of the node's executor.

    Parameters
    ----------
    client
        Of the nodes; it is spun in another thread, later.
    """

    def __init__(self, client: SurfaceMapClient):
        self._client = client
        self._drives: set[Future] = set()
        self._client.can_approach  # noqa: B018  makes the clients of the actions before the spinning

    def approach(self, surface_id: int, spot: str, gap_m: float) -> ApproachFacts:
        """Drive to a surface, or to a spot unless its name is empty; gap 0 for the default.

        Raises
        ------
        RequestError
            With the reason why the base did not get there.
        """
        self._find_node()
        wanted = SurfaceFilter() if spot else SurfaceFilter(ids=[surface_id])
        found = self._await(self._client.approach(wanted, name=spot, gap=gap_m))
        return ApproachFacts(
            found.surface_id, round(found.gap, 3), round(found.yaw_error, 3), found.has_moved
        )

    def retreat(self, distance_m: float) -> float:
        """Drive straight back; return the distance driven, m.

        Raises
        ------
        RequestError
            With the reason why the base did not get there.
        """
        self._find_node()
        return round(float(self._await(self._client.retreat(distance_m))), 3)

    def stop(self) -> None:
        """Cancel the drive in progress, and wait for its end."""
        self._client.cancel()
        for drive in tuple(self._drives):
            done_event(drive).wait(STOP_S)

    def _find_node(self) -> None:
        """Wait for the discovery of approach_node."""
        waited = threading.Event()
        for _ in range(round(DISCOVERY_S / 0.1)):
            if self._client.can_approach:
                return
            waited.wait(0.1)

    def _await(self, drive: Future) -> Any:
        self._drives.add(drive)
        drive.add_done_callback(self._drives.discard)
        ended = done_event(drive)
        while not ended.wait(LOOK_S):
            if not self._client.can_approach:
                raise RequestError("approach_node ended while the base drove")
        return drive.result()


@contextmanager
def live_robot(
    name: str, approach_name: str = ""
) -> Iterator[tuple[LiveMapSource, LiveMotion | None]]:
    """Open the map and the base of running nodes; a node of its own is spun in a thread meanwhile.

    Parameters
    ----------
    name
        Of the node that has the map, with its namespace.
    approach_name
        Of the node that drives; empty for none.

    Yields
    ------
    tuple of LiveMapSource and LiveMotion
        The second is None without a node that drives.
    """
    context = Context()
    rclpy.init(context=context)
    node = Node("tccm_mcp", context=context)
    client = SurfaceMapClient(node, name, approach_name=approach_name)
    source = LiveMapSource(client, name)
    motion = LiveMotion(client) if approach_name else None
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, name="tccm_mcp", daemon=True)
    thread.start()
    try:
        yield source, motion
    finally:
        executor.shutdown()
        thread.join()
        client.close()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def _result(future: Future) -> Any:
    """Return the result of a future that the executor of another thread completes.

    Raises
    ------
    RequestError
        If there is an error, or no answer in time.
    """
    if not done_event(future).wait(TIMEOUT_S):
        raise RequestError(f"no answer within {TIMEOUT_S:g} s: is the node still running?")
    return future.result()
