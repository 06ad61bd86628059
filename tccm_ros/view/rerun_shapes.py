"""Shapes, names and layout that recordings and running Rerun viewers have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int64
from tccm_ros.outlines.triangulation import FilledOutline
from tccm_ros.report import palette

STAMP = "stamp"
"""Name of the timeline, which has message stamps."""

ODOM = "map/odom"
BASE = "map/odom/base"
"""Entities of the frames; their children move with them."""

WALL_HEIGHT_M = 0.9
"""Drawn height of walls, as in the report."""

AXIS_M = 0.3
"""Drawn length of the base's arrow, m."""

RADIUS_M = 0.008
"""Drawn radius of points and lines, m."""


def set_stamp(stream: rr.RecordingStream, stamp_ns: int) -> None:
    """Log what follows at a stamp, ns."""
    stream.set_time(STAMP, timestamp=np.datetime64(stamp_ns, "ns"))


def begin(stream: rr.RecordingStream) -> None:
    """Set up a new stream: message stamps alone, z up."""
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)


def log_pose(stream: rr.RecordingStream, entity: str, T: Float64) -> None:
    """Log the pose float64 (4, 4) of a frame in that of its parent."""
    stream.log(entity, rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))


def line_strips(strips: Sequence[ArrayLike], color: str) -> rr.LineStrips3D:
    """Return lines, (N, 3) each, m, in a colour ``#rrggbb``."""
    return rr.LineStrips3D(strips, colors=rgb(color), radii=RADIUS_M)


def log_heading(stream: rr.RecordingStream, base: str) -> None:
    """Log the arrow ahead of the base at all times."""
    arrow = rr.Arrows3D(vectors=[[AXIS_M, 0.0, 0.0]], colors=rgb(palette.VIEW), radii=0.03)
    stream.log(f"{base}/heading", arrow, static=True)


def log_surface(
    stream: rr.RecordingStream,
    entity: str,
    mesh: FilledOutline,
    color: str,
    name: str,
    at: ArrayLike,
) -> None:
    """Log filling, outline and name of a surface.

    Parameters
    ----------
    stream, entity
        Stream with its time set, and the entity of the surface.
    mesh
        The filled outline, holes included, in map, m.
    color
        ``#rrggbb``.
    name
        Text of its label; empty for the floor, which is drawn pale.
    at
        (x, y, z), position of the label, m.
    """
    if len(mesh.triangles):
        alpha = 180 if name else 60
        faces = rr.Mesh3D(
            vertex_positions=mesh.points, triangle_indices=mesh.triangles,
            vertex_colors=np.tile([*rgb(color), alpha], (len(mesh.points), 1)),
        )  # fmt: skip
        stream.log(entity, faces)
    ends = np.cumsum(mesh.rings, dtype=int)
    rings = np.split(mesh.points, ends)[: len(ends)]
    stream.log(f"{entity}/outline", line_strips([with_first_point(r) for r in rings], color))
    if name:
        label = rr.Points3D([at], labels=[name], colors=rgb(color), radii=0.01)
        stream.log(f"{entity}/name", label)


def log_planes(stream: rr.RecordingStream, outlines: Mapping[int, Float64]) -> None:
    """Log the outlines of tracked planes, lines (N, 3) in odom, m, by id."""
    colors = [rgb(palette.color_by_id(i)) for i in outlines]
    lines = rr.LineStrips3D([*outlines.values()], colors=colors, radii=RADIUS_M)
    stream.log(f"{ODOM}/planes", lines)


def log_part(stream: rr.RecordingStream, table: Int64, cell_size: float) -> None:
    """Log a coarse part map as boxes in odom.

    Parameters
    ----------
    stream
        Stream with its time set.
    table
        int64 (4, N), rows of `results.cycles_file.coarsen`.
    cell_size
        Edge length of its cells, m.
    """
    low, high = 0.01 * table[2:]
    xy = (table[:2].T + 0.5) * cell_size
    half = np.full((len(low), 3), 0.5 * cell_size)
    half[:, 2] = 0.5 * (high - low)
    centers = np.column_stack([xy, 0.5 * (low + high)]).astype(np.float32)
    boxes = rr.Boxes3D(
        centers=centers, half_sizes=half.astype(np.float32), fill_mode="solid",
        colors=rgb("#9fb3c8"),
    )  # fmt: skip
    stream.log(f"{ODOM}/part_map", boxes)


def sign_arrow(position: ArrayLike, normal: ArrayLike, text: str) -> rr.Arrows3D:
    """Return a door sign as an arrow along its normal, with its text."""
    along = AXIS_M * np.asarray(normal)
    color = rgb(palette.LANDMARK)
    return rr.Arrows3D(origins=[position], vectors=[along], labels=[text], colors=color)


def wall_face(endpoints: ArrayLike, floor: float) -> Float64:
    """Return the closed outline (5, 3) of a wall between two points (x, y), m."""
    low = np.column_stack([endpoints, np.full(2, floor)])
    high = low + np.array([0.0, 0.0, WALL_HEIGHT_M])
    return with_first_point(np.vstack([low, high[::-1]]))


def with_first_point(ring: Float64) -> Float64:
    """Return a ring (N, 3) as a closed line (N + 1, 3)."""
    return np.concatenate([ring, ring[:1]])


def rgb(color: str) -> list[int]:
    """Return a colour ``#rrggbb`` as three numbers."""
    return [int(color[k : k + 2], 16) for k in (1, 3, 5)]


def blueprint(cameras: Sequence[str]) -> rrb.Blueprint:
    """Return the layout: the map in 3D, with depth cameras, by role, and events beside it."""
    hidden = [f"- /{ODOM}/{name}/**" for name in ("part_map", "planes")]
    hidden.append("- /map/rejected_loops/**")
    space = rrb.Spatial3DView(origin="/map", contents=["+ /map/**", *hidden], name="Map")
    beside: list[rrb.View] = [
        rrb.Spatial2DView(origin=f"/{BASE}/{role}", name=role) for role in cameras
    ]
    parts = rrb.Spatial3DView(
        origin="/map", contents=[f"+ /{ODOM}/**", "+ /map/walls/**"], name="Newest tilt cycle"
    )
    events = rrb.TextLogView(origin="/events", name="Events")
    column = rrb.Vertical(*beside, parts, events)
    return rrb.Blueprint(
        rrb.Horizontal(space, column, column_shares=[3, 1]),
        rrb.TimePanel(state="collapsed", timeline=STAMP),
        collapse_panels=True,
    )
