"""Convert sensor_msgs/PointCloud2 to structured arrays and back without loss.

The points of a cloud have a NumPy structured dtype with the message's field names. Messages are
built and read by duck typing, as everywhere in this package.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.errors import MessageError, suggest
from tccm_ros.ros.types import MessageTypes, header_message

SURFACE_ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("surface", "<u4")])
"""A row of ~/surfaces, the surface message."""

VIEWPOINT_ROW = np.dtype(
    [*SURFACE_ROW.descr, *((name, "<f4") for name in ("vp_x", "vp_y", "vp_z")), ("sensor", "<u4")]
)
"""A row of ~/surfaces with the sensor's position, named as in PCL, and its `SensorKind`."""

VIEW_ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z_low", "<f4"), ("z_high", "<f4")])
"""A row of ~/view."""

HIT_ROW = np.dtype([*VIEW_ROW.descr, ("is_hit", "<u4")])
"""A row of ~/view with hits of beams (is_hit = 1) and free intervals (0)."""

CORNER_ROW = np.dtype(
    [(name, "<f8") for name in ("x", "y", "z", "z_high")] + [("points", "<u4"), ("object", "<u4")]
)
"""A row of ~/object_boxes: a corner of the footprint of an object."""

MAP_ROW = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("depth", "<f4"), ("count", "<u4"), ("cycle", "<u4")]
)
"""A row of ~/map_cloud, a cuboid."""

POINT_ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
"""A row of ~/obstacles."""

SURFACE_MAP_ROW = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("id", "<u4"), ("rgb", "<u4")]
)
"""A row of ~/surface_cloud; rgb is 0x00RRGGBB in a float32 field, as viewers expect."""

_CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
_NAMES = {code: name for name, code in _CODES.items()}
_MAX_FIELDS = 1000


def cloud_message(types: MessageTypes, stamp_ns: int, frame_id: str, rows: NDArray[Any]) -> Any:
    """Return a sensor_msgs/PointCloud2 with one point per row.

    Parameters
    ----------
    types
        Message classes.
    stamp_ns, frame_id
        Header.
    rows
        Structured array (N,), packed, little-endian; may be empty.
    """
    offsets: Mapping[str, Any] = rows.dtype.fields or {}
    fields = [
        types.make(
            "sensor_msgs/msg/PointField",
            name=name,
            offset=int(offsets[name][1]),
            datatype=_CODES["f4" if name == "rgb" else rows.dtype[name].str[1:]],
            count=1,
        )
        for name in rows.dtype.names or ()
    ]
    return types.make(
        "sensor_msgs/msg/PointCloud2",
        header=header_message(types, stamp_ns, frame_id),
        height=1,
        width=len(rows),
        fields=fields,
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * len(rows),
        data=types.array("u1", np.ascontiguousarray(rows).view(np.uint8)),
        is_dense=True,
    )


def cloud_rows(message: Any, row: np.dtype[Any]) -> NDArray[Any]:
    """Return the points of a sensor_msgs/PointCloud2 as a structured array (N,) of dtype `row`.

    The message may have further fields, any offsets, padding, several rows and either byte order.

    Raises
    ------
    MessageError
        If a field is missing or has another type, or if sizes are inconsistent.
    """
    formats, offsets = _layout(message, row)
    data = np.frombuffer(message.data, np.uint8)
    width, height = int(message.width), int(message.height)
    step, line = int(message.point_step), int(message.row_step)
    if width == 0 or height == 0:
        return np.zeros(0, row)
    if line < width * step or len(data) < line * (height - 1) + width * step:
        raise MessageError(
            f"point cloud of {width} x {height} points has {len(data)} bytes, "
            f"expected {height} lines of {width * step}"
        )
    layout: np.dtype[Any] = np.dtype(
        {"names": row.names, "formats": formats, "offsets": offsets, "itemsize": step}  # type: ignore[call-overload]
    )
    lines = [np.frombuffer(data, layout, width, k * line) for k in range(height)]
    points = lines[0] if height == 1 else np.concatenate(lines)
    if layout == row:
        return points
    rows = np.zeros(len(points), row)
    for name in row.names or ():
        rows[name] = points[name]
    return rows


def _layout(message: Any, row: np.dtype[Any]) -> tuple[list[str], list[int]]:
    """Return format and offset of each field of `row`, as declared by the message."""
    step = int(message.point_step)
    found = {field.name: field for field in message.fields[:_MAX_FIELDS]}
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [], []
    for name in row.names or ():
        if name not in found:
            raise MessageError(f"point cloud has no field '{name}'" + suggest(name, found))
        expected = "f4" if name == "rgb" else row[name].str[1:]
        kind = _NAMES.get(int(found[name].datatype), "?")
        if kind != expected:
            raise MessageError(f"point cloud field '{name}' is {kind}, expected {expected}")
        offsets.append(int(found[name].offset))
        formats.append(order + row[name].str[1:])
    ends = [offset + np.dtype(form).itemsize for offset, form in zip(offsets, formats)]
    if max(ends, default=0) > step:
        raise MessageError(f"point cloud has points of {step} bytes, its fields need {max(ends)}")
    return formats, offsets
