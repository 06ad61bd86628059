"""The base of a running approach_node for language agents."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.task import Future
from tccm_interfaces.msg import SurfaceFilter

from tccm_ros.agents.facts import ApproachFacts
from tccm_ros.errors import RequestError
from tccm_ros.nodes.clients.map_client import SurfaceMapClient
from tccm_ros.nodes.clients.requests import done_event

LOOK_S = 1.0
"""Period of the check whether approach_node still runs, s."""

STOP_S = 5.0
"""Longest wait for the end of a cancelled drive, s: it takes two steps of 0.05 s and a response."""

DISCOVERY_S = 5.0
"""Longest wait for the discovery of approach_node, s: the time in which DDS finds a new process."""


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
