"""The map and the measurements of running nodes in a running Rerun viewer, by a thread of its own.

The thread alone connects, writes and waits. While no viewer listens, it keeps nothing but the
newest state and the newest measurement of each sensor; a viewer that comes later receives them.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import rerun as rr

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.errors import ConfigError, one_line
from tccm_ros.geometry import spatial
from tccm_ros.outlines.triangulation import FilledOutline
from tccm_ros.records import Event, MapOdom, Posed
from tccm_ros.report import palette
from tccm_ros.view.live_state import LiveState
from tccm_ros.view.rerun_sensors import SensorLog
from tccm_ros.view.rerun_shapes import (
    BASE,
    ODOM,
    begin,
    blueprint,
    line_strips,
    log_heading,
    log_part,
    log_planes,
    log_pose,
    log_surface,
    set_stamp,
    sign_arrow,
    wall_face,
    with_first_point,
)

LIVE_BASE = "map/base"
"""Entity of the newest pose of the base in map, which is there without sensors, too."""

PERIOD_S = 0.2
"""Period of messages to the viewer, s, as on the live page; it bounds the rate of each sensor."""

RETRY_S = 2.0
"""Period of attempts to find a viewer, s."""

FLUSH_S = 5.0
"""Longest wait for a viewer that does not read, s; then the connection counts as lost."""

NO_LIMIT = 2**62
"""Bytes in a delta: the viewer is near, or the user chose so."""


Write = Callable[[SensorLog], object]
"""Logs one measurement to a connected viewer."""


class RerunStream:
    """Sends a `LiveState` and the newest measurements to a viewer, until it is closed.

    Parameters
    ----------
    url
        Address of the viewer, as ``rerun+http://127.0.0.1:9876/proxy``.
    config
        Configuration of the robot and its sensors.

    Raises
    ------
    ConfigError
        If the address is none of a viewer.
    """

    def __init__(self, url: str, config: Config | None = None):
        self._url, self._address = url, viewer_address(url)
        self._config = config or Config()
        self._state, self._lock = LiveState(), threading.Lock()
        self._newest: dict[str, tuple[int, Write]] = {}
        self._log: SensorLog | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rerun", daemon=True)
        self._thread.start()

    def update(self, change: Callable[[LiveState], object]) -> None:
        """Change the state; the viewer gets it later."""
        with self._lock:
            change(self._state)

    def add(self, event: Event) -> None:
        """Show a posed record, or the odometry frame in map; of each sensor the newest counts."""
        if isinstance(event, Posed):
            stamp_ns = int(event.pose_stamps_ns[0])
            self._put(event.role, stamp_ns, lambda log: _log_record(log, event))
        elif isinstance(event, MapOdom):
            T = event.T_map_odom
            self._put(ODOM, event.stamp_ns, lambda log: log_pose(log.stream, ODOM, T))

    def show_planes(self, stamp_ns: int, outlines: Mapping[int, Float64]) -> None:
        """Show the tracked planes of a tilt cycle, by id, as lines (N, 3) in odom, m."""
        self._put("planes", stamp_ns, lambda log: log_planes(log.stream, outlines))

    def show_part(self, stamp_ns: int, table: Int64, cell_size: float) -> None:
        """Show the part map of a tilt cycle: rows of `results.cycles_file.coarsen`."""
        self._put("part_map", stamp_ns, lambda log: log_part(log.stream, table, cell_size))

    def close(self) -> None:
        """Send the newest state and end the thread."""
        self._ended.set()
        self._thread.join()

    def _put(self, name: str, stamp_ns: int, write: Write) -> None:
        """Replace the unsent record of this name by one at a stamp, ns."""
        with self._lock:
            self._newest[name] = stamp_ns, write

    # --- in the thread ---

    def _run(self) -> None:
        while not self._ended.is_set():
            self._send()
            self._ended.wait(PERIOD_S if self._log else RETRY_S)
        self._send()
        if self._log is not None:
            self._log.stream.disconnect()

    def _send(self) -> None:
        if self._log is None and _listens(self._address):
            self._log = self._connect()
        if self._log is None:
            return
        with self._lock:
            delta, stamp_ns = self._state.delta(NO_LIMIT), self._state.stamp_ns
            ground = self._state.entities.get("world", {}).get("ground", 0.0)
            newest, self._newest = self._newest, {}
        write_delta(self._log.stream, delta, stamp_ns, ground)
        _write_all(self._log, newest.values())
        try:
            self._log.stream.flush(timeout_sec=FLUSH_S)
        except RuntimeError:
            self._log = None
            with self._lock:
                self._state.forget_sent()

    def _connect(self) -> SensorLog:
        stream = rr.RecordingStream("tccm_ros live")
        stream.connect_grpc(self._url, default_blueprint=blueprint(()))
        begin(stream)
        log_heading(stream, LIVE_BASE)
        return SensorLog(self._config, stream)


def _write_all(log: SensorLog, newest: Iterable[tuple[int, Write]]) -> None:
    """Log measurements at their stamps, ns; a new depth camera gets its place in the layout."""
    known = len(log.cameras)
    for stamp_ns, write in newest:
        set_stamp(log.stream, stamp_ns)
        write(log)
    if len(log.cameras) > known:
        log.stream.send_blueprint(blueprint(log.cameras))


def _log_record(log: SensorLog, event: Posed) -> None:
    log_pose(log.stream, BASE, event.T_odom_base[0])
    log.add(event)


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
    set_stamp(stream, stamp_ns)
    for name in delta.get("gone", ()):
        stream.log(_entity(name), rr.Clear(recursive=True))
    for name, value in delta.get("set", {}).items():
        write = WRITERS.get(name.partition("/")[0])
        if write is not None:
            write(stream, _entity(name), value, ground)
    if delta.get("pose"):
        log_pose(stream, LIVE_BASE, spatial(np.array(delta["pose"]), ground))
    for text in delta.get("events", ()):
        stream.log("events", rr.TextLog(text))


def _surface(stream: rr.RecordingStream, entity: str, value: Any, _: float) -> None:
    shape = value["shape"]
    points, triangles = np.reshape(shape["v"], (-1, 3)), np.reshape(shape["t"], (-1, 3))
    mesh = FilledOutline(points, triangles.astype(np.int64), tuple(shape["rings"]))
    name = "" if value["floor"] else f"{value['label']} {value['id']}, {value['height']:.2f} m"
    log_surface(stream, entity, mesh, value["color"], name, value["at"])


def _object(stream: rr.RecordingStream, entity: str, value: Any, _: float) -> None:
    corners, (low, high) = np.array(value["corners"]), (value["low"], value["high"])
    ends = np.array([with_first_point(np.column_stack([corners, [z] * 4])) for z in (low, high)])
    posts = [ends[:, k] for k in range(4)]
    stream.log(entity, line_strips([*ends, *posts], palette.OBJECT))


def _wall(stream: rr.RecordingStream, entity: str, value: Any, ground: float) -> None:
    stream.log(entity, line_strips([wall_face(value["ends"], ground)], palette.WALL))


def _sign(stream: rr.RecordingStream, entity: str, value: Any, _: float) -> None:
    stream.log(entity, sign_arrow(value["at"], value["normal"], value["text"]))


def _path(stream: rr.RecordingStream, entity: str, value: Any, ground: float) -> None:
    xy = np.reshape(value["xy"], (-1, 2))
    line = np.column_stack([xy, np.full(len(xy), ground)])
    stream.log(entity, line_strips([line], palette.PATH))


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
