"""State of the live page, and its changes between two moments.

The map is a dictionary of entities, each a JSON value under a name such as ``surface/3``, in the
format of the report's viewer. A page receives all of them once, then only those that changed.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.outlines.triangulation import fill_outline
from tccm_ros.report import palette
from tccm_ros.report.entities import rounded

MAX_EVENTS = 100
"""Maximum number of events on a page, the queue depth of the topic."""

MAX_PATH_POINTS = 500
"""Maximum number of points of the path. Chosen: segments of a few pixels."""

MARGIN_M = 0.5
"""Margin around the map in the first view, m."""

Entities = dict[str, Any]


class LiveState:
    """The newest state; it must be written and read by the same thread.

    Attributes
    ----------
    entities
        Entities of the map, by name.
    pose
        (x, y, yaw) of the base in map, m and rad; None before the first.
    status
        State of the nodes: JSON values by name.
    events
        The newest events as lines, the oldest first.
    stamp_ns
        Stamp of the newest map or pose, ns.
    """

    def __init__(self) -> None:
        self.entities: Entities = {}
        self.pose: list[float] | None = None
        self.status: dict[str, Any] = {}
        self.events: deque[str] = deque(maxlen=MAX_EVENTS)
        self.stamp_ns = 0
        self._seen: Entities = {}
        self._sent: dict[str, str] = {}
        self._sent_pose: list[float] | None = None
        self._sent_status = ""
        self._new_events: list[str] = []

    def add_event(self, text: str) -> None:
        """Append an event."""
        self.events.append(text)
        self._new_events = [*self._new_events, text][-MAX_EVENTS:]

    def snapshot(self) -> dict[str, Any]:
        """Return everything sent so far, for a new page."""
        return {
            "set": {name: json.loads(text) for name, text in self._sent.items()},
            "pose": self._sent_pose,
            "status": json.loads(self._sent_status or "{}"),
            "events": list(self.events)[: len(self.events) - len(self._new_events)],
        }

    def forget_sent(self) -> None:
        """Make the next delta contain everything."""
        self._seen, self._sent, self._sent_pose, self._sent_status = {}, {}, None, ""
        self._new_events = list(self.events)

    def delta(self, budget: int) -> dict[str, Any]:
        """Return the changes since the last delta; empty if there are none.

        Parameters
        ----------
        budget
            Maximum size of entities, bytes; the rest is sent later. At least one is always sent.
        """
        changed: dict[str, Any] = {}
        if self.pose != self._sent_pose:
            changed["pose"] = self._sent_pose = self.pose
        status = json.dumps(self.status)
        if status != self._sent_status:
            changed["status"], self._sent_status = self.status, status
        if self._new_events:
            changed["events"], self._new_events = self._new_events, []
        gone = [name for name in self._sent if name not in self.entities]
        for name in gone:
            del self._sent[name]
            self._seen.pop(name, None)
        if gone:
            changed["gone"] = gone
        some: Entities = {}
        for name, value in self.entities.items():
            if value is self._seen.get(name):
                continue
            text = json.dumps(value)
            if text == self._sent.get(name):
                self._seen[name] = value
                continue
            if some and len(text) > budget:
                break
            budget -= len(text)
            some[name], self._seen[name], self._sent[name] = value, value, text
        if some:
            changed["set"] = some
        return changed


def surface_entity(
    surface: Mapping[str, Any],
    boundary: Float64,
    holes: Sequence[Float64],
    normal: Float64,
    middle: Sequence[float],
) -> dict[str, Any]:
    """Return a surface in the viewer's format.

    Parameters
    ----------
    surface
        ``id``, ``label``, ``height``, ``area`` and further values for the page.
    boundary, holes, normal
        float64 (N, 3) rings in map, m, and the unit normal.
    middle
        (x, y, z), position of its label.
    """
    mesh = fill_outline(boundary, holes, normal)
    return {
        **surface,
        "color": palette.color_by_id(surface["id"], surface["label"]),
        "floor": surface["label"] == "floor",
        "at": rounded(middle),
        "shape": {
            "v": rounded(mesh.points.ravel()),
            "t": mesh.triangles.ravel().tolist(),
            "rings": list(mesh.rings),
        },
    }


def free_entity(name: str, rings: Sequence[Float64]) -> dict[str, Any]:
    """Return the free places of a surface in the viewer's format; rings are (N, 3), m."""
    points = np.concatenate(rings).ravel() if rings else np.zeros(0)
    return {"on": name, "v": rounded(points), "rings": [len(ring) for ring in rings]}


def path_entity(positions: Float64) -> dict[str, Any]:
    """Return a thinned path (N, 2), m, with its length."""
    step = -(-len(positions) // MAX_PATH_POINTS) or 1
    length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    kept = np.concatenate([positions[::step], positions[-1:]])
    return {"length": round(length, 2), "xy": rounded(kept.ravel())}
