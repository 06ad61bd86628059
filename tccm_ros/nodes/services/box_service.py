"""~/check_box of tccm_node: occupancy of a box, and the tilt cycle that observed it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.cuboids.queries import MapQuery
from tccm_ros.errors import FrameError, MessageError
from tccm_ros.mapping.tccm import TccmProcessor
from tccm_ros.nodes.interfaces import offer_service
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.services.known_frames import KnownFrames
from tccm_ros.records.building import pose_from_message
from tccm_ros.ros.types import stamp_message

STATES = {-1: 0, 0: 1, 1: 2}
"""Values of the state in CheckBox by `Occupancy`."""

MAX_VOLUME_M3 = 8.0
"""Maximum volume of a box, which is sampled in points. Chosen: 1 million points, 0.1 s."""


class BoxService:
    """Answers ~/check_box from the integration map after the newest tilt cycle.

    A response does not wait for the tilt cycle in progress. If there was a request since the last
    tilt cycle, the map after the next one is prepared at once; otherwise the next request waits for
    it.

    Parameters
    ----------
    node
        Node of the service; its worker owns the processor.
    processor
        Holds the map.
    """

    def __init__(self, node: SensorNode, processor: TccmProcessor):
        self._node, self._processor = node, processor
        self._frames = KnownFrames(node.robot, node.config)
        self._query: MapQuery | None = None
        self._prepared_changes = 0
        self._is_requested = False
        offer_service(node, "CheckBox", "~/check_box", self._check)

    async def _check(self, request: Any, response: Any) -> str:
        T, size = self._box(request)
        self._is_requested = True
        query = self._query or await self._node.worker.call(self._prepare, self._node)
        found = query.box(T, size)
        response.state = STATES[int(found.occupancy)]
        response.cycle = found.cycle
        response.stamp = stamp_message(self._node.types, max(found.stamp_ns, 0))
        return ""

    def _box(self, request: Any) -> tuple[Float64, Float64]:
        """Return pose (4, 4) in odom and edges (3,) of a box; raise TccmError if it is invalid."""
        size = np.array([request.size.x, request.size.y, request.size.z])
        if not (np.isfinite(size).all() and (size > 0.0).all()):
            raise MessageError(f"a box of {_text(size)} m; expected positive edges")
        if math.prod(size.tolist()) > MAX_VOLUME_M3 or size.max() > 10.0:
            raise MessageError(
                f"a box of {_text(size)} m; expected edges of at most 10 m and at most "
                f"{MAX_VOLUME_M3:g} m3"
            )
        T = pose_from_message(request.pose.pose, "the box")
        frame = request.pose.header.frame_id
        if not frame:
            raise FrameError("the box has no frame_id")
        return self._frames.T_odom_frame(frame) @ T, size

    def refresh(self) -> None:
        """Prepare the map if it has changed and there was a request (in the worker)."""
        if self._prepared_changes == self._changes:
            return
        is_wanted, self._is_requested = self._is_requested, False
        self._query = self._processor.query() if is_wanted else None
        self._prepared_changes = self._changes

    def _prepare(self) -> MapQuery:
        """Prepare the current map for requests and return it (in the worker)."""
        if not self._processor.counts["cycles"]:
            raise MessageError("no tilt cycle has been mapped yet")
        if self._query is None:
            self._query = self._processor.query()
        return self._query

    @property
    def _changes(self) -> int:
        """Number of changes of the map."""
        return self._processor.counts["cycles"] + self._processor.counts["resets"]


def _text(size: Float64) -> str:
    return " x ".join(f"{edge:g}" for edge in size.tolist())
