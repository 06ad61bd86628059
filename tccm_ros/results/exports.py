"""The result files: every number of DESIGN section 5 in one place, byte-identical on every run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, Cuboids
from tccm_ros.errors import OutputError, one_line
from tccm_ros.geometry import quaternion, spatial
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.planes.horizontal_clusters import label_horizontal
from tccm_ros.records import Keyframe, Landmark, Loop, PlaneRecord, Surface, Wall
from tccm_ros.results.geojson import feature_collection
from tccm_ros.results.numbers import Stamp, array_archive, json_text, rounded
from tccm_ros.results.planning import scene_text
from tccm_ros.results.ply import surface_ply
from tccm_ros.surfaces.scene_objects import SceneObject
from tccm_ros.surfaces.surface_slam import SurfaceSolution

__all__ = [
    "cuboids_archive",
    "graph_table",
    "objects_table",
    "planes_table",
    "surfaces_table",
    "trajectory_text",
    "walls_table",
    "write_results",
    "write_solution",
]


def write_results(
    folder: Path,
    solution: SurfaceSolution,
    cycles: Sequence[CycleResult],
    cuboids: Cuboids | None,
    config: Config,
    *,
    scene: tuple[Sequence[SceneObject], Mapping[int, Any]],
    summary: Mapping[str, Any],
    timing: Mapping[str, Any],
) -> None:
    """Write the data files of a run into a folder that is made ready (see `output_folder`).

    Parameters
    ----------
    folder
        Exists; the files are written under their final names.
    solution
        Trajectory, walls and surfaces.
    cycles
        Every tilt cycle, in order.
    cuboids
        The final integration map; None where there was no tilting laser.
    config
        Group ``frames``.
    scene
        Objects and free places: what `scene_objects` gives.
    summary, timing
        What summary.json and timing.json hold.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    write_solution(folder, solution, config)
    odom = cycles[-1].frame_id if cycles else config.frames.odom_name
    tables = {
        "objects.json": objects_table(scene),
        "planes.json": planes_table(cycles),
        "summary.json": summary,
        "timing.json": timing,
    }
    files: dict[str, bytes] = {name: json_text(table).encode() for name, table in tables.items()}
    files["cuboids.npz"] = cuboids_archive(cuboids, config, odom)
    _write(folder, files)


def write_solution(folder: Path, solution: SurfaceSolution, config: Config) -> None:
    """Write what a solution gives: surfaces, walls, graph and trajectory (see `write_results`)."""
    map_frame = config.frames.map_name
    tables = {
        "surfaces.json": surfaces_table(solution.surfaces, solution.floor_z, map_frame),
        "walls.json": walls_table(solution.slam.walls),
        "graph.json": graph_table(
            solution.slam.keyframes, solution.slam.loops, solution.slam.landmarks
        ),
        "surfaces.geojson": feature_collection(solution.surfaces, solution.slam.walls, map_frame),
    }
    files: dict[str, bytes] = {name: json_text(table).encode() for name, table in tables.items()}
    files["surfaces.scene"] = scene_text(solution.surfaces).encode()
    files["surfaces.ply"] = surface_ply(solution.mapped.points, solution.mapped.surface_id)
    files["trajectory.tum"] = trajectory_text(solution.trajectory_ns, solution.trajectory).encode()
    _write(folder, files)


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        try:
            (folder / name).write_bytes(content)
        except OSError as error:
            raise OutputError(f"{folder / name}: cannot be written ({one_line(error)})") from None


def surfaces_table(
    surfaces: Sequence[Surface], floor_z: float | None, frame_id: str
) -> dict[str, Any]:
    """Return what surfaces.json holds."""
    return {
        "format": "tccm_ros/surfaces",
        "version": 1,
        "frame_id": frame_id,
        "floor_z": floor_z,
        "surfaces": [_surface_entry(surface) for surface in surfaces],
    }


def _surface_entry(surface: Surface) -> dict[str, Any]:
    return {
        "id": surface.id,
        "label": surface.label,
        "confidence": surface.confidence,
        "height": surface.height,
        "normal": surface.normal,
        "offset": surface.offset,
        "area": surface.area,
        "centroid": surface.centroid,
        "boundary": surface.boundary,
        "holes": list(surface.holes),
        "points": surface.points,
        "height_std": surface.height_std,
        "first_seen": Stamp(surface.first_seen_ns),
        "last_seen": Stamp(surface.last_seen_ns),
        "views": [
            {"stamp": Stamp(v.stamp_ns), "keyframe": v.keyframe, "points": v.points}
            for v in surface.views
        ],
        "took": list(surface.took),
    }


def objects_table(scene: tuple[Sequence[SceneObject], Mapping[int, Any]]) -> dict[str, Any]:
    """Return what objects.json holds, in map."""
    objects, free = scene
    return {
        "objects": [
            {
                "id": o.id,
                "surface": o.surface,
                "center": o.center,
                "size": o.size,
                "yaw": o.yaw,
            }
            for o in objects
        ],
        "free": [{"surface": s, "polygons": list(rings)} for s, rings in sorted(free.items())],
    }


def walls_table(walls: Sequence[Wall]) -> dict[str, Any]:
    """Return what walls.json holds."""
    return {
        "walls": [
            {
                "id": wall.id,
                "phi": wall.phi,
                "rho": wall.rho,
                "endpoints": wall.endpoints,
                "observations": wall.observations,
                "covariance": wall.covariance,
                "corners": list(wall.corners),
            }
            for wall in walls
        ]
    }


def graph_table(
    keyframes: Sequence[Keyframe], loops: Sequence[Loop], landmarks: Sequence[Landmark]
) -> dict[str, Any]:
    """Return what graph.json holds."""
    return {
        "keyframes": [{"id": k.id, "stamp": Stamp(k.stamp_ns), "pose": k.pose} for k in keyframes],
        "loops": [
            {
                "from": loop.from_id,
                "to": loop.to_id,
                "delta": loop.delta,
                "accepted": loop.accepted,
                "reason": loop.reason,
            }
            for loop in loops
        ],
        "landmarks": [
            {
                "kind": landmark.kind,
                "id": landmark.id,
                "position": landmark.position,
                "covariance": landmark.covariance,
                "observations": landmark.observations,
            }
            for landmark in landmarks
        ],
    }


def planes_table(cycles: Sequence[CycleResult]) -> dict[str, Any]:
    """Return what planes.json holds: the tracked planes of every cycle, in the odometry frame."""
    return {
        "cycles": [
            {
                "cycle": cycle.cycle,
                "stamp": Stamp(cycle.stamp_ns),
                "frame_id": cycle.frame_id,
                "planes": [_plane_entry(plane) for plane in cycle.planes],
            }
            for cycle in cycles
        ]
    }


def _plane_entry(plane: PlaneRecord) -> dict[str, Any]:
    return {
        "id": plane.id,
        "kind": plane.kind,
        "normal": plane.normal,
        "offset": plane.offset,
        "covariance": plane.covariance,
        "support": plane.support,
        "area": plane.area,
        "quality": plane.quality,
        "boundary": plane.boundary,
        "holes": list(plane.holes),
        "rms": plane.rms,
    }


def trajectory_text(stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]) -> str:
    """Return trajectory.tum: ``stamp x y z qx qy qz qw`` of base in map, a line for each pose.

    Parameters
    ----------
    stamps_ns
        int64 (N,).
    poses
        float64 (N, 3), planar.
    """
    if len(stamps_ns) == 0:
        return ""
    T = spatial(poses)
    rows = np.concatenate([T[:, :3, 3], quaternion(T)], axis=1)
    return "".join(
        f"{Stamp(int(stamp))} " + " ".join(f"{rounded(v):.6f}" for v in row) + "\n"
        for stamp, row in zip(stamps_ns, rows)
    )


def cuboids_archive(cuboids: Cuboids | None, config: Config, frame_id: str) -> bytes:
    """Return cuboids.npz: the integration map in m; empty arrays where there is none."""
    if cuboids is None:
        cuboids = _no_cuboids(config.map.cell_size)
    return array_archive(
        {
            "ix": cuboids.ix,
            "iy": cuboids.iy,
            "top": cuboids.top * TICK,
            "bottom": cuboids.bottom * TICK,
            "count": cuboids.count,
            "cls": label_horizontal(cuboids, config.planes.height_threshold),
            "mean": cuboids.mean(),
            "cov": cuboids.cov(),
            "cycles": cuboids.cycles,
            "cycle_offsets": cuboids.cycle_offsets,
            "cell_size": np.array(cuboids.cell_size),
            "frame_id": np.array(frame_id),
        }
    )


def _no_cuboids(cell_size: float) -> Cuboids:
    none = np.zeros(0, np.int32)
    return Cuboids(
        cell_size=cell_size,
        ix=none,
        iy=none,
        bottom=none,
        top=none,
        count=np.zeros(0),
        s=np.zeros((0, 3)),
        S=np.zeros((0, 6)),
        cycles=none,
        cycle_offsets=np.zeros(1, np.int64),
    )
