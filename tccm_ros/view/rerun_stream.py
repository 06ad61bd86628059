"""The map of running nodes in a running Rerun viewer, by a thread of its own.

The thread alone connects, writes and waits. While no viewer listens, it keeps nothing but the
newest state, and a viewer that comes later receives all of it.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tccm_ros.errors import ConfigError, one_line
from tccm_ros.report import palette
from tccm_ros.view.live_state import LiveState
from tccm_ros.view.rerun_log import (
    AXIS_M,
    RADIUS_M,
    STAMP,
    WALL_HEIGHT_M,
    rgb,
    sign_arrow,
    with_first_point,
)

BASE = "map/base"
"""Entity of the base's frame."""

PERIOD_S = 0.2
"""Period of messages to the viewer, s, as on the live page."""

RETRY_S = 2.0
"""Period of attempts to find a viewer, s."""

FLUSH_S = 5.0
"""Longest wait for a viewer that does not read, s; then the connection counts as lost."""

NO_LIMIT = 2**62
"""Bytes in a delta: the viewer is near, or the user chose so."""


class RerunStream:
    """Sends a `LiveState` to a viewer, until it is closed.

    Parameters
    ----------
    url
        Address of the viewer, as ``rerun+http://127.0.0.1:9876/proxy``.

    Raises
    ------
    ConfigError
        If the address is none of a viewer.
    """

    def __init__(self, url: str):
        self._url, self._address = url, viewer_address(url)
        self._state, self._lock = LiveState(), threading.Lock()
        self._stream: rr.RecordingStream | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rerun", daemon=True)
        self._thread.start()

    def update(self, change: Callable[[LiveState], object]) -> None:
        """Change the state; the viewer gets it later."""
        with self._lock:
            change(self._state)

    def close(self) -> None:
        """Send the newest state and end the thread."""
        self._ended.set()
        self._thread.join()

    # --- in the thread ---

    def _run(self) -> None:
        while not self._ended.is_set():
            self._send()
            self._ended.wait(PERIOD_S if self._stream else RETRY_S)
        self._send()
        if self._stream is not None:
            self._stream.disconnect()

    def _send(self) -> None:
        if self._stream is None and _listens(self._address):
            self._stream = self._connect()
        if self._stream is None:
            return
        with self._lock:
            delta, stamp_ns = self._state.delta(NO_LIMIT), self._state.stamp_ns
            ground = self._state.entities.get("world", {}).get("ground", 0.0)
        write_delta(self._stream, delta, stamp_ns, ground)
        try:
            self._stream.flush(timeout_sec=FLUSH_S)
        except RuntimeError:
            self._stream = None
            with self._lock:
                self._state.forget_sent()

    def _connect(self) -> rr.RecordingStream:
        stream = rr.RecordingStream("tccm_ros live")
        stream.set_log_tick_enabled(False)
        stream.set_log_time_enabled(False)
        stream.connect_grpc(self._url, default_blueprint=_blueprint())
        stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        arrow = rr.Arrows3D(vectors=[[AXIS_M, 0.0, 0.0]], colors=rgb(palette.VIEW), radii=0.03)
        stream.log(f"{BASE}/heading", arrow, static=True)
        return stream


def viewer_address(url: str) -> tuple[str, int]:
    """Return host and port of a viewer's address.

    Raises
    ------
    ConfigError
        If it is no such address.
    """
    try:
        parts = urlsplit(url)
        known = parts.scheme in ("rerun", "rerun+http", "rerun+https") and parts.path == "/proxy"
        if known and parts.hostname and parts.port:
            return parts.hostname, parts.port
    except ValueError:  # of the port
        pass
    raise ConfigError(
        f"view.rerun is {one_line(ValueError(url))}; expected rerun+http://HOST:PORT/proxy"
    )


def write_delta(
    stream: rr.RecordingStream, delta: Mapping[str, Any], stamp_ns: int, ground: float
) -> None:
    """Log a delta of a `LiveState` at a stamp, ns, with the height of the floor in map, m."""
    stream.set_time(STAMP, timestamp=np.datetime64(stamp_ns, "ns"))
    for name in delta.get("gone", ()):
        stream.log(_entity(name), rr.Clear(recursive=True))
    for name, value in delta.get("set", {}).items():
        write = WRITERS.get(name.partition("/")[0])
        if write is not None:
            write(stream, _entity(name), value, ground)
    if delta.get("pose"):
        x, y, yaw = delta["pose"]
        rotation = rr.RotationAxisAngle([0, 0, 1], radians=yaw)
        stream.log(BASE, rr.Transform3D(translation=[x, y, ground], rotation_axis_angle=rotation))
    for text in delta.get("events", ()):
        stream.log("events", rr.TextLog(text))


def _surface(stream: rr.RecordingStream, entity: str, value: Any, _: float) -> None:
    color = rgb(value["color"])
    points = np.reshape(value["shape"]["v"], (-1, 3))
    alpha = 60 if value["floor"] else 180
    if value["shape"]["t"]:
        faces = rr.Mesh3D(
            vertex_positions=points, triangle_indices=np.reshape(value["shape"]["t"], (-1, 3)),
            vertex_colors=np.tile([*color, alpha], (len(points), 1)),
        )  # fmt: skip
        stream.log(entity, faces)
    rings = np.split(points, np.cumsum(value["shape"]["rings"])[:-1])
    lines = rr.LineStrips3D([with_first_point(r) for r in rings], colors=color, radii=RADIUS_M)
    stream.log(f"{entity}/outline", lines)
    if not value["floor"]:
        name = f"{value['label']} {value['id']}, {value['height']:.2f} m"
        label = rr.Points3D([value["at"]], labels=[name], colors=color, radii=0.01)
        stream.log(f"{entity}/name", label)


def _object(stream: rr.RecordingStream, entity: str, value: Any, _: float) -> None:
    corners, (low, high) = np.array(value["corners"]), (value["low"], value["high"])
    ends = np.array([with_first_point(np.column_stack([corners, [z] * 4])) for z in (low, high)])
    posts = [ends[:, k] for k in range(4)]
    lines = rr.LineStrips3D([*ends, *posts], colors=rgb(palette.OBJECT), radii=RADIUS_M)
    stream.log(entity, lines)


def _wall(stream: rr.RecordingStream, entity: str, value: Any, ground: float) -> None:
    low = np.column_stack([value["ends"], [ground, ground]])
    high = np.add(low, [0.0, 0.0, WALL_HEIGHT_M])
    face = with_first_point(np.vstack([low, high[::-1]]))
    stream.log(entity, rr.LineStrips3D([face], colors=rgb(palette.WALL), radii=RADIUS_M))


def _sign(stream: rr.RecordingStream, entity: str, value: Any, _: float) -> None:
    stream.log(entity, sign_arrow(value["at"], value["normal"], value["text"]))


def _path(stream: rr.RecordingStream, entity: str, value: Any, ground: float) -> None:
    xy = np.reshape(value["xy"], (-1, 2))
    line = np.column_stack([xy, np.full(len(xy), ground)])
    stream.log(entity, rr.LineStrips3D([line], colors=rgb(palette.PATH), radii=RADIUS_M))


WRITERS = {"surface": _surface, "object": _object, "sign": _sign, "wall": _wall, "path": _path}
"""By kind of the entity on the live page."""

NAMES = {"surface": "surfaces", "object": "objects", "sign": "signs", "wall": "walls"}
"""Where a recording of a replay has such entities, too."""


def _entity(name: str) -> str:
    kind, _, number = name.partition("/")
    return f"map/{NAMES.get(kind, kind)}/{number}".rstrip("/")


def _listens(address: tuple[str, int]) -> bool:
    """Return whether a server accepts connections at an address."""
    try:
        socket.create_connection(address, timeout=RETRY_S).close()
    except OSError:
        return False
    return True


def _blueprint() -> rrb.Blueprint:
    """Return the layout: the map, and the events beside it."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="/map", name="Map"),
            rrb.TextLogView(origin="/events", name="Events"),
            column_shares=[3, 1],
        ),
        collapse_panels=True,
    )
