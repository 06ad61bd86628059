"""MoveIt planning scene as text, for "Import" in RViz."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from tccm_ros.geometry import quaternion
from tccm_ros.results.numbers import rounded
from tccm_ros.scene.planning_shapes import Box, Mesh

TITLE = "tccm_ros"
"""Name of the scene."""


def scene_text(shapes: Mapping[str, Box | Mesh]) -> str:
    """Return shapes (`scene_shapes`) as a MoveIt planning scene (``.scene``).

    The format is the older of two, which all versions of MoveIt read: for each object its shapes,
    for each shape its pose (x y z, then the quaternion x y z w) and its colour.
    """
    lines = [TITLE]
    for name, shape in shapes.items():
        lines += [f"* {name}", "1"]
        T = np.eye(4)
        if isinstance(shape, Box):
            T = shape.T_map_box
            x, _, z = shape.size.tolist()
            kind, lengths = ("cylinder", [0.5 * x, z]) if shape.is_round else ("box", shape.size)
            lines += [kind, _numbers(lengths)]
        else:
            lines += ["mesh", f"{len(shape.vertices)} {len(shape.triangles)}"]
            lines += [_numbers(vertex) for vertex in shape.vertices]
            lines += [" ".join(map(str, triangle)) for triangle in shape.triangles.tolist()]
        lines += [_numbers(T[:3, 3]), _numbers(quaternion(T[None])[0]), "0 0 0 0"]
    return "\n".join([*lines, ".", ""])


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{rounded(v):.6f}" for v in values)
