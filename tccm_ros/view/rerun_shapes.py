"""Shapes, names and layout that recordings and running Rerun viewers have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64
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
    lines = rr.LineStrips3D([with_first_point(r) for r in rings], colors=rgb(color), radii=RADIUS_M)
    stream.log(f"{entity}/outline", lines)
    if name:
        label = rr.Points3D([at], labels=[name], colors=rgb(color), radii=0.01)
        stream.log(f"{entity}/name", label)


def log_planes(stream: rr.RecordingStream, outlines: Sequence[Float64], ids: Sequence[int]) -> None:
    """Log the outlines (N, 3) of tracked planes in odom, m, with the ids that colour them."""
    colors = [rgb(palette.color_by_id(i)) for i in ids]
    stream.log(f"{ODOM}/planes", rr.LineStrips3D(outlines, colors=colors, radii=RADIUS_M))


def log_part(
    stream: rr.RecordingStream,
    ix: ArrayLike,
    iy: ArrayLike,
    bottom: ArrayLike,
    top: ArrayLike,
    cell_size: float,
) -> None:
    """Log a coarse part map as boxes (N,): cells of an edge length, m, and heights, cm, in odom."""
    low, high = np.asarray(bottom) * 0.01, np.asarray(top) * 0.01
    xy = (np.stack([ix, iy], axis=1) + 0.5) * cell_size
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
