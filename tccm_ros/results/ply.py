"""Binary PLY of surface points, a colour for each surface."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray

__all__ = ["surface_color", "surface_ply"]

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
GOLDEN_RATIO = 0.618033988749895
"""Steps of the hue: colours of neighbouring ids are far apart."""

PLY_TYPES = {"<f4": "float", "|u1": "uchar", "<u4": "uint"}


def surface_color(surface_id: int) -> tuple[int, int, int]:
    """Return the colour of a surface, RGB from 0 to 255."""
    hue = (surface_id * GOLDEN_RATIO) % 1.0
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.65, 0.9)
    return round(red * 255), round(green * 255), round(blue * 255)


def surface_ply(points: NDArray[np.float32], surface_id: NDArray[np.uint32]) -> bytes:
    """Return points (N, 3) with their surfaces (N,) as a binary little-endian PLY file.

    The properties are x y z float32, red green blue uint8, surface_id uint32.
    """
    rows = np.zeros(len(points), VERTEX)
    for k, axis in enumerate("xyz"):
        rows[axis] = np.round(points[:, k].astype(np.float64), 6) + 0.0
    rows["surface_id"] = surface_id
    ids, index = np.unique(surface_id, return_inverse=True)
    colors = np.array([surface_color(int(i)) for i in ids], np.uint8).reshape(-1, 3)
    for k, name in enumerate(("red", "green", "blue")):
        rows[name] = colors[index, k]
    properties = [f"property {PLY_TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    return "\n".join([*header, *properties, "end_header", ""]).encode() + rows.tobytes()
