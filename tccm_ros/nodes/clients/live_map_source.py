"""The map of a running slam_node for language agents."""

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

from tccm_ros.agents.facts import (
    BasePoseFacts,
    ChangeFacts,
    ObjectFacts,
    PlacementFacts,
    PlacementQuery,
    SurfaceFacts,
    appearances,
    newest_first,
    rounded,
    seconds,
)
from tccm_ros.arrays import Float64
from tccm_ros.errors import MapError, RequestError
from tccm_ros.geometry import planar
from tccm_ros.nodes.clients.live_motion import LiveMotion
from tccm_ros.nodes.clients.map_client import SurfaceMapClient
from tccm_ros.nodes.clients.map_records import (
    MapEvent,
    MapObject,
    MapPlacement,
    MapSurface,
)
from tccm_ros.nodes.clients.requests import done_event
from tccm_ros.records.building import stamp_ns_from_message

MAX_CHANGES = 1000
"""Changes that are kept, the newest. Chosen: days of a home; some 200 kB."""

TIMEOUT_S = 30.0
"""Longest wait for an answer of the node, s. Chosen: placements on all surfaces of a flat take less
than 1 s on a busy machine; agents give up after about a minute."""


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

    def __init__(self, client: SurfaceMapClient, name: str):
        self._name, self._client = name, client
        self._events: deque[MapEvent] = deque(maxlen=MAX_CHANGES)
        self._client.on_event(self._events.append)

    def stamp_s(self) -> float:
        """Return the stamp of the newest map, s.

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
        return seconds(self._client.stamp_ns)

    def surfaces(self) -> Sequence[SurfaceFacts]:
        """Return the surfaces but the floor, by id."""
        return [_surface(s) for s in self._client.surfaces if s.label != "floor"]

    def objects(self) -> Sequence[ObjectFacts]:
        """Return the objects on surfaces."""
        return [_object(item) for item in self._client.objects]

    def rooms(self) -> Sequence[str]:
        """Return the names of the rooms in which surfaces are."""
        return sorted({s.room for s in self._client.surfaces if s.room})

    def placements(self, query: PlacementQuery) -> tuple[list[PlacementFacts], str]:
        """Return placements, the best first, and a sentence.

        Raises
        ------
        RequestError
            If the node refuses the query, or does not answer in time.
        """
        with_base = query.reach_m > 0.0
        found = _result(
            self._client.find_placements(
                query.size_m,
                SurfaceFilter(ids=list(query.surface_ids)),
                clearance=query.clearance_m,
                base=FindPlacements.Request.BASE_FIND
                if with_base
                else FindPlacements.Request.BASE_ANYWHERE,
                reach=query.reach_m,
                robot_radius=query.robot_radius_m,
                max_count=query.limit,
            )
        )
        return [_placement(item) for item in found], found.message

    def changes(self) -> tuple[list[ChangeFacts], str]:
        """Return the changes that are known, the newest first."""
        found = appearances(self.surfaces(), self.objects())
        known = {(change.kind, *change.surface_ids, change.object_id) for change in found}
        # Some of these have left the map again, or were merged since.
        heard = map(_change, tuple(self._events))
        found += [c for c in heard if (c.kind, *c.surface_ids, c.object_id) not in known]
        note = "moved, merged, split and gone are known since tccm mcp was started"
        return newest_first(found), note


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


def _surface(surface: MapSurface) -> SurfaceFacts:
    message = surface.message
    return SurfaceFacts(
        surface.id,
        surface.label,
        surface.room,
        list(surface.near_signs),
        round(surface.height, 3),
        round(float(surface.size[0]), 3),
        round(float(surface.size[1]), 3),
        round(surface.area, 3),
        _position(surface.T_map_surface),
        seconds(stamp_ns_from_message(message.first_seen)),
        seconds(stamp_ns_from_message(message.last_seen)),
    )


def _object(item: MapObject) -> ObjectFacts:
    return ObjectFacts(
        item.id,
        item.label,
        item.surface_id,
        _position(item.T_map_object),
        rounded(item.size),
        seconds(stamp_ns_from_message(item.message.first_seen)),
        seconds(stamp_ns_from_message(item.message.last_seen)),
    )


def _placement(item: MapPlacement) -> PlacementFacts:
    bases = [BasePoseFacts(*rounded(pose)) for pose in planar(item.T_map_bases)]
    T = item.T_map_object
    yaw = round(float(planar(T)[2]), 3)
    return PlacementFacts(item.surface_id, _position(T), yaw, round(item.clearance, 3), bases)


def _change(event: MapEvent) -> ChangeFacts:
    ids = event.ids_after or event.ids_before
    return ChangeFacts(event.kind, seconds(event.stamp_ns), list(ids), event.object_id, event.label)


def _position(T: Float64) -> list[float]:
    return rounded(T[:3, 3])
