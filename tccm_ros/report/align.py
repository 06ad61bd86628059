"""Pose of one map in another, and the results of a map in another frame.

The map frame of a recording is the first pose of its base. Two maps are matched as a session that
continues a map is: keyframes by the loop search, or, without a level laser, views by their free
space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import planar, spatial, transform, transform2, wrap_angle
from tccm_ros.mapping.saved_map import SavedMap, views_in_map
from tccm_ros.records import Wall
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import SurfaceEntry
from tccm_ros.results.trajectory import Trajectory
from tccm_ros.slam.map_matching import match_walls, median_pose
from tccm_ros.slam.saved_walls import unpack_walls
from tccm_ros.surfaces.registration.session_alignment import align_session


def find_alignment(before: SavedMap, after: SavedMap, config: Config) -> Float64 | None:
    """Find the planar pose of the second map's frame in the first's.

    Parameters
    ----------
    before, after
        The first and the second map, each in its own frame.
    config
        Groups ``loops``, ``matching`` and ``surfaces``.

    Returns
    -------
    float64 (3,) or None
        (x, y, yaw), m and rad; None if the second is not found in the first.

    Raises
    ------
    MapError
        If the saved walls of a map are damaged.
    """
    if before.keyframe_count and after.keyframe_count:
        one, other = unpack_walls(before.walls), unpack_walls(after.walls)
        loops = match_walls(one, other, config)
        return median_pose(loops, one.poses, other.poses) if loops else None
    old, new = views_in_map(before), views_in_map(after)
    T_map_old, T_map_new = (
        np.array([v.T_anchor_view for v in views]).reshape(-1, 4, 4) for views in (old, new)
    )
    found = align_session(
        [v.view for v in old], T_map_old, [v.view for v in new], T_map_new, config
    )
    return planar(found.T_map_session) if found.found else None


def moved_results(results: Results, pose: Float64) -> Results:
    """Return a map with surfaces, walls and trajectory transformed into another frame.

    Cuboids, cycles and planes are not transformed, as a comparison does not use them.

    Parameters
    ----------
    results
        The map.
    pose
        float64 (3,), planar pose (x, y, yaw) of its frame in the other frame, m and rad.
    """
    T = spatial(pose)
    trajectory = results.trajectory
    return replace(
        results,
        surfaces=tuple(_moved_surface(surface, T) for surface in results.surfaces),
        walls=tuple(_moved_wall(wall, pose) for wall in results.walls),
        trajectory=Trajectory(trajectory.stamps_ns, T @ trajectory.T_map_base),
    )


def _moved_surface(surface: SurfaceEntry, T: Float64) -> SurfaceEntry:
    def ring(points: Float64) -> Float64:
        return transform(T, points) if len(points) else points

    return replace(
        surface,
        normal=T[:3, :3] @ surface.normal,
        centroid=transform(T, surface.centroid[None])[0],
        boundary=ring(surface.boundary),
        holes=tuple(ring(hole) for hole in surface.holes),
        boundary_seen=ring(surface.boundary_seen),
        edges=tuple(
            replace(edge, start=ring(edge.start[None])[0], end=ring(edge.end[None])[0])
            for edge in surface.edges
        ),
    )


def _moved_wall(wall: Wall, pose: Float64) -> Wall:
    phi = wall.phi + pose[2]
    rho = wall.rho + float(np.array([np.cos(phi), np.sin(phi)]) @ pose[:2])
    if rho < 0.0:
        phi, rho = phi + np.pi, -rho
    ends = transform2(pose, wall.endpoints)
    return replace(wall, phi=float(wrap_angle(phi)), rho=rho, endpoints=ends)


def pose_text(pose: Sequence[float]) -> str:
    """Return a planar pose as text."""
    return f"{pose[0]:.2f} m, {pose[1]:.2f} m, {np.degrees(pose[2]):.1f} deg"
