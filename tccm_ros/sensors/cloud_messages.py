"""Convert sensor_msgs/PointCloud2 of any layout to point cloud records."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Bool, Float32, Int64
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.errors import MessageError, suggest
from tccm_ros.records import PointCloud
from tccm_ros.records.building import MAX_SCAN_S, frame_name, stamp_ns_from_message
from tccm_ros.sensors.byte_order import SWAPPED, is_swapped

MAX_POINTS = 4_000_000
"""Maximum number of points of a cloud; the largest lidars have some 500,000."""

MIN_RANGE = 0.05
"""Range below which a point means "no return", m."""

TIME_FIELDS = ("t", "time", "timestamp", "offset_time")
"""Names of the per-point time field in various drivers."""

ABSOLUTE_S = 1.0e6
"""Times larger than this, s, are absolute; smaller ones are relative to the stamp."""

ABSOLUTE_NS = 1.0e14
"""Absolute floating-point times larger than this are in ns: in s they would be in the year
3,000,000 or later, in ns they are on the second day of the clock or later. Livox writes ns as
float64, Hesai and RoboSense write s."""

NOT_FINITE = "times of points are ignored: they are not finite"
TOO_FAR_FROM_STAMP = f"times of points are ignored: more than {MAX_SCAN_S:g} s from the stamp"
"""Remarks on clouds of which all points are taken to be at the stamp."""

_MAX_FIELDS = 1000
_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def point_cloud_from_message(message: Any) -> PointCloud:
    """Return the points of a sensor_msgs/PointCloud2, with per-point times where present.

    Raises
    ------
    MessageError
        For missing fields x, y and z, inconsistent sizes, and too many points.
    """
    width, height = int(message.width), int(message.height)
    stamp_ns = stamp_ns_from_message(message.header.stamp)
    if width * height > MAX_POINTS:
        raise MessageError(
            f"point cloud has {width * height} points, at most {MAX_POINTS} are read"
        )
    fields = {field.name: field for field in message.fields[:_MAX_FIELDS]}
    time = next((name for name in TIME_FIELDS if name in fields), None)
    names = ["x", "y", "z", *([time] if time else [])]
    rows = _rows(message, _layout(message, fields, names), width, height)
    if any(rows.dtype[name].kind != "f" for name in "xyz"):
        raise MessageError("point cloud has x, y, z that are not float32 or float64")
    remarks, xyz = [], _coordinates(rows)
    if is_swapped(xyz):
        rows = rows.view(rows.dtype.newbyteorder())
        remarks, xyz = [SWAPPED], _coordinates(rows)
    points = xyz.astype(np.float32, copy=False)
    frame = frame_name(message.header.frame_id)
    since_ns = None
    if time is not None:
        since_ns, fault = _since_stamp(rows[time], stamp_ns, points)
        remarks += [fault] if fault else []
    return PointCloud(stamp_ns, frame, points, since_ns, "; ".join(remarks))


def _layout(message: Any, fields: dict[str, Any], names: list[str]) -> np.dtype[Any]:
    """Return the numpy dtype of a point with the named fields."""
    step = int(message.point_step)
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [], []
    for name in names:
        if name not in fields:
            raise MessageError(f"point cloud has no field '{name}'" + suggest(name, fields))
        kind = _KINDS.get(int(fields[name].datatype))
        if kind is None:
            raise MessageError(
                f"point cloud field '{name}' has datatype {fields[name].datatype}, expected 1 to 8"
            )
        formats.append(order + kind)
        offsets.append(int(fields[name].offset))
    needed = max(offset + np.dtype(form).itemsize for offset, form in zip(offsets, formats))
    if needed > step:
        raise MessageError(f"point cloud has points of {step} bytes, its fields need {needed}")
    size = int(message.width) * int(message.height)
    if size and step > len(message.data):  # numpy has no points of 2 GB
        raise MessageError(f"point cloud has {len(message.data)} bytes, one point needs {step}")
    itemsize = step if size else needed
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": itemsize})


def _rows(message: Any, layout: np.dtype[Any], width: int, height: int) -> NDArray[Any]:
    """Return the points as a structured array (N,), row by row."""
    if width == 0 or height == 0:
        return np.zeros(0, layout)
    data = np.frombuffer(message.data, np.uint8)
    step, line = layout.itemsize, int(message.row_step)
    if height == 1:
        line = width * step  # some drivers leave row_step 0 in clouds of one line
    if line < width * step or len(data) < line * (height - 1) + width * step:
        raise MessageError(
            f"point cloud of {width} x {height} points of {step} bytes has {len(data)} bytes in "
            f"lines of {line}, expected {height} lines of {width * step}"
        )
    if line == width * step:
        return np.frombuffer(data, layout, width * height)
    return np.concatenate([np.frombuffer(data, layout, width, k * line) for k in range(height)])


def _coordinates(rows: NDArray[Any]) -> NDArray[Any]:
    """Return x, y and z, (N, 3), in the byte order of this machine."""
    return np.stack([rows[name].astype(rows.dtype[name].newbyteorder("=")) for name in "xyz"], 1)


def _since_stamp(
    times: NDArray[Any], stamp_ns: int, points: NDArray[Any]
) -> tuple[Int64 | None, str]:
    """Return the times of points relative to the stamp, ns, or None and why they are ignored.

    The time of a point without a return is undefined in messages; here it is 0.
    """
    known = has_returned(points)
    if not np.isfinite(times[known]).all():
        return None, NOT_FINITE
    since = np.zeros(len(times), np.int64)
    since[known] = _ns_since(times[known], stamp_ns)
    if len(since) and int(np.abs(since).max()) > MAX_SCAN_S * 1e9:
        return None, TOO_FAR_FROM_STAMP
    return since, ""


def has_returned(points: Float32) -> Bool:
    """Return a mask (N,) of the points (N, 3) that are returns: finite, and not near the origin."""
    square = np.einsum("ij,ij->i", points, points)
    return np.asarray((square >= MIN_RANGE**2) & (square < np.inf))


def _ns_since(times: NDArray[Any], stamp_ns: int) -> Int64:
    """Return times relative to the stamp, ns: integers are in ns, floats in s or, if large, ns."""
    largest = float(np.abs(times.astype(np.float64)).max(initial=0.0))
    if times.dtype.kind != "f":
        whole = times.astype(np.int64)
        return whole - stamp_ns if largest > ABSOLUTE_S * 1e9 else whole
    if largest > ABSOLUTE_NS:
        return np.clip(times, -9e18, 9e18).astype(np.int64) - stamp_ns
    if largest <= ABSOLUTE_S:
        return np.rint(times.astype(np.float64) * 1e9).astype(np.int64)
    seconds = times.astype(np.float64) - stamp_ns // 1_000_000_000
    since = np.rint(np.clip(seconds, -1e9, 1e9) * 1e9).astype(np.int64)
    return since - stamp_ns % 1_000_000_000


CLOUD_READER = MessageReader(
    "sensor_msgs/msg/PointCloud2", lambda message: (point_cloud_from_message(message),)
)
