"""Write the points of surfaces as binary PLY, with a colour per surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float32
from tccm_ros.ros.marker_parts import identity_color

VERTEX = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("red", "u1"),
        ("green", "u1"),
        ("blue", "u1"),
        ("surface_id", "<u4"),
    ]
)
PLY_TYPES = {"<f4": "float", "|u1": "uchar", "<u4": "uint"}


def surface_ply(points: Float32, surface_id: NDArray[np.uint32]) -> bytes:
    """Return points (N, 3) with their surface ids (N,) as a binary little-endian PLY file.

    The properties are x y z float32, red green blue uint8, surface_id uint32.
    """
    rows = np.zeros(len(points), VERTEX)
    for k, axis in enumerate("xyz"):
        rows[axis] = np.round(points[:, k].astype(np.float64), 6) + 0.0
    rows["surface_id"] = surface_id
    ids, index = np.unique(surface_id, return_inverse=True)
    colors = np.reshape([identity_color(int(i), brightness=0.9) for i in ids], (-1, 3))
    for k, name in enumerate(("red", "green", "blue")):
        rows[name] = np.rint(255 * colors[index, k])
    properties = [f"property {PLY_TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    return "\n".join([*header, *properties, "end_header", ""]).encode() + rows.tobytes()
