"""Data of the report's three-dimensional view, as JSON values and packed arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.outlines.triangulation import fill_outline
from tccm_ros.report import palette
from tccm_ros.report.array_pack import ArrayPack, differences
from tccm_ros.report.entities import (
    compartment_entity,
    object_entity,
    rounded,
    sign_entity,
    wall_entity,
)
from tccm_ros.report.label_layout import label_point
from tccm_ros.report.map_picture import box_corners, extent
from tccm_ros.results.cuboids_file import FinalCuboids
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import (
    CompartmentEntry,
    CycleEntry,
    ObjectEntry,
    PlaneEntry,
    SurfaceEntry,
)
from tccm_ros.tabletop.footprints import convex_hull, rectangle

DIGITS = 6
"""Decimals of numbers in the page; micrometres, as in the result files."""

MAX_CUBOIDS = 400_000
"""Maximum number of cuboids; the newest of a larger map are shown. Chosen: smooth in a browser."""

MIN_UNIT_M = 1e-3
"""Unit of the heights of cuboids and of center cores, m; chosen."""

MAX_UNITS = 32_000
"""Maximum number of units in an int16; the unit is larger for larger maps."""

MIN_CORE_POINTS = 3
"""Smallest number of points of a center core; chosen."""

HALF_LENGTH_PER_STD = 3.0**0.5
"""Half length of a uniformly covered line, in standard deviations of its points."""


def build_scene(results: Results, pack: ArrayPack) -> dict[str, Any]:
    """Return the values for the page's script; the arrays that they reference go into a pack."""
    return {
        "ground": _round(results.ground),
        "start": results.start,
        "extent": [rounded(corner, DIGITS) for corner in _extent(results)],
        "palette": list(palette.PALETTE),
        "colors": palette.WORLD,
        "surfaces": _surfaces(pack, results),
        "walls": [wall_entity(wall, DIGITS) for wall in results.walls],
        "objects": [_object(box, results) for box in results.objects],
        "surfaceIds": [surface.id for surface in results.above_floor],
        "free": list(_free(pack, results)),
        "signs": [sign_entity(sign, DIGITS) for sign in results.signs],
        "racks": [_compartment(space) for space in results.compartments],
        "path": _path(pack, results),
        "places": _views(results),
        "planes": [_plane_cycle(pack, cycle, results.ground) for cycle in results.planes],
        **_cuboids(pack, results),
        "cycles": _cycles(pack, results),
    }


def _extent(results: Results) -> tuple[Float64, Float64]:
    """Return the corners of the map, or of most cuboids if there is no map."""
    if results.surfaces or results.walls or results.cuboids is None or len(results.cuboids) == 0:
        return extent(results)
    low, high = np.percentile(results.cuboids.mean[:, :2], [2, 98], axis=0)
    return low - 0.5, high + 0.5


def _surfaces(pack: ArrayPack, results: Results) -> list[dict[str, Any]]:
    """Return the surfaces from low to high, the order in which transparent ones are painted."""
    colors = palette.surface_colors(results.surfaces)
    by_height = sorted(results.surfaces, key=lambda s: (s.height, s.id))
    return [_surface(pack, s, colors[s.id], results.ground) for s in by_height]


def _surface(pack: ArrayPack, surface: SurfaceEntry, color: str, ground: float) -> dict[str, Any]:
    hull = convex_hull(np.ascontiguousarray(surface.boundary[:, :2]))
    _, _, length, width, _ = rectangle(hull)
    return {
        "id": surface.id,
        "label": surface.label,
        "color": color,
        "floor": surface.is_floor,
        "height": _round(surface.height - ground),
        "area": _round(surface.area),
        "size": [_round(length), _round(width)],
        "room": surface.room,
        "views": len(surface.views),
        "points": surface.points,
        "std": surface.height_std,
        "first": surface.first_seen,
        "last": surface.last_seen,
        "at": rounded(label_point(surface), DIGITS),
        "shape": _shape(pack, surface.boundary, surface.holes, surface.normal),
    }


def _shape(
    pack: ArrayPack,
    boundary: Float64,
    holes: Sequence[Float64],
    normal: Float64,
) -> dict[str, Any]:
    mesh = fill_outline(boundary, holes, normal)
    return {
        "v": pack.add(mesh.points, "f4"),
        "t": pack.add(mesh.triangles, "u2"),
        "rings": list(mesh.rings),
    }


def _object(box: ObjectEntry, results: Results) -> dict[str, Any]:
    below = {s.id: s for s in results.surfaces}.get(box.surface)
    label = f"{below.label} (surface {below.id})" if below else None
    corners = box_corners(box)
    return object_entity(box.id, box.surface, label, box.center, box.size, corners, DIGITS)


def _free(pack: ArrayPack, results: Results) -> Iterator[dict[str, Any]]:
    """Yield the rings of the free places on surfaces other than the floor."""
    named = {s.id: f"{s.label} (surface {s.id})" for s in results.above_floor}
    for place in results.free:
        rings = [ring for ring in place.polygons if len(ring) > 2]
        if place.surface in named and rings:
            yield {
                "on": named[place.surface],
                "v": pack.add(np.concatenate(rings), "f4"),
                "rings": [len(ring) for ring in rings],
            }


def _compartment(space: CompartmentEntry) -> dict[str, Any]:
    lengths = space.width, space.depth, space.height
    faces = [face.value for face in (space.left, space.right, space.back, space.ceiling)]
    parts = [entry.part for entry in space.open_parts]
    return compartment_entity(
        space.board, space.front, space.insertion, lengths, faces, parts, DIGITS
    )


def _path(pack: ArrayPack, results: Results) -> dict[str, Any]:
    path = results.trajectory
    heading = np.arctan2(path.T_map_base[:, 1, 0], path.T_map_base[:, 0, 0])
    points = path.positions.copy()
    points[:, 2] = results.ground + 0.01
    return {
        "length": _round(path.length),
        "points": pack.add(points, "f4"),
        "stamps": pack.add(path.stamps, "f8"),
        "poses": pack.add(np.column_stack([points[:, :2], heading]), "f4"),
    }


def _views(results: Results) -> list[dict[str, Any]]:
    stamps = results.view_stamps()
    if len(results.trajectory.stamps) == 0:
        return []
    at = results.trajectory.positions[results.trajectory.nearest(stamps)]
    return [
        {
            "stamp": float(stamp),
            "at": rounded(position[:2], DIGITS),
            "surfaces": sum(any(v.stamp == stamp for v in s.views) for s in results.surfaces),
        }
        for stamp, position in zip(stamps, at, strict=True)
    ]


def _plane_cycle(pack: ArrayPack, cycle: CycleEntry, ground: float) -> dict[str, Any]:
    return {
        "cycle": cycle.cycle,
        "stamp": cycle.stamp,
        "in_map": cycle.frame_id == "map",
        "planes": [_plane(pack, plane, ground) for plane in cycle.planes],
    }


def _plane(pack: ArrayPack, plane: PlaneEntry, ground: float) -> dict[str, Any]:
    middle = plane.boundary[:, 2].mean() if len(plane.boundary) else 0.0
    return {
        "id": plane.id,
        "kind": plane.kind,
        "height": _round(middle - ground),
        "area": plane.area,
        "support": plane.support,
        "rms": plane.rms,
        "shape": _shape(pack, plane.boundary, plane.holes, plane.normal),
    }


def _cuboids(pack: ArrayPack, results: Results) -> dict[str, Any]:
    """Return the final cuboids in the frame of the last cycle, and their center cores."""
    if not results.cuboids:
        return {"final": None, "cores": None}
    cycles, cuboids = results.cycles, _newest(results.cuboids)
    frame = cycles.T_map_odom[-1] if cycles else np.eye(4)
    window = cycles.window if cycles else Config().map.window_cycles
    return {"final": _final(pack, cuboids, frame, window), "cores": _cores(pack, cuboids)}


def _newest(cuboids: FinalCuboids) -> FinalCuboids:
    """Return the newest cuboids, at most `MAX_CUBOIDS`, in the same order."""
    if len(cuboids) <= MAX_CUBOIDS:
        return cuboids
    kept = np.sort(np.argsort(-cuboids.newest, kind="stable")[:MAX_CUBOIDS])
    columns = ("ix", "iy", "bottom", "top", "count", "mean", "cov", "newest")
    return FinalCuboids(cuboids.cell_size, *(getattr(cuboids, name)[kept] for name in columns))


def _final(pack: ArrayPack, cuboids: FinalCuboids, frame: Float64, window: int) -> dict[str, Any]:
    unit = _unit(np.append(cuboids.bottom, cuboids.top))
    bottom, top = np.rint(cuboids.bottom / unit), np.rint(cuboids.top / unit)
    return {
        "cell": cuboids.cell_size,
        "unit": unit,
        "frame": rounded(frame.ravel(), DIGITS),
        "newest": int(cuboids.newest.max(initial=0)),
        "window": window,
        "points": pack.add(np.minimum(np.rint(cuboids.count), 65535), "u2"),
        "cycle": pack.add(cuboids.newest, "i2"),
        **_columns(pack, cuboids.ix, cuboids.iy, bottom, top),
    }


def _unit(lengths: Float64) -> float:
    """Return a unit, m, in which these lengths fit into int16."""
    return max(MIN_UNIT_M, float(np.abs(lengths).max(initial=0.0)) / MAX_UNITS)


def _columns(
    pack: ArrayPack,
    ix: NDArray[Any],
    iy: NDArray[Any],
    bottom: NDArray[Any],
    top: NDArray[Any],
) -> dict[str, Any]:
    thickness = np.asarray(top, np.int64) - np.asarray(bottom, np.int64)
    return {
        "ix": pack.add(differences(ix), "i2"),
        "iy": pack.add(differences(iy), "i2"),
        "bottom": pack.add(differences(bottom), "i2"),
        "thickness": pack.add(thickness, "i2"),
    }


def _cores(pack: ArrayPack, cuboids: FinalCuboids) -> dict[str, Any]:
    """Return the center cores: the longest eigenvector of each cuboid's P (paper IV.B)."""
    chosen = cuboids.count >= MIN_CORE_POINTS
    P = cuboids.cov[chosen][:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(P)
    half = (
        HALF_LENGTH_PER_STD * np.sqrt(np.maximum(values[:, -1], 0.0))[:, None] * vectors[:, :, -1]
    )
    # An eigenvector's sign is arbitrary: fix it, so that the same map gives the same page.
    largest = np.take_along_axis(half, np.argmax(np.abs(half), axis=1)[:, None], axis=1)
    half = np.where(largest < 0.0, -half, half)
    unit = _unit(cuboids.mean[chosen])
    mean = np.rint(cuboids.mean[chosen] / unit)
    steps = [pack.add(differences(column), "i2") for column in mean.T]
    spans = [pack.add(column, "i2") for column in np.rint(half / unit).T]
    return {"unit": unit, "columns": [*steps, *spans]}


def _cycles(pack: ArrayPack, results: Results) -> dict[str, Any] | None:
    cycles = results.cycles
    if cycles is None or len(cycles) == 0:
        return None
    return {
        "cell": cycles.cell_size,
        "window": cycles.window,
        "numbers": cycles.cycles.tolist(),
        "stamps": (cycles.stamps_ns * 1e-9).tolist(),
        "offsets": cycles.offsets.tolist(),
        "frames": [rounded(T.ravel(), DIGITS) for T in cycles.T_map_odom],
        **_columns(pack, cycles.ix, cycles.iy, cycles.bottom, cycles.top),
    }


def _round(value: float) -> float:
    return round(float(value), DIGITS)
