"""Alignment of a new session with a saved map, without a level laser.

The free space of views ends at walls and furniture. The first columns behind free space, the
*frontier* of a view, are a level scan: the views of the session are matched with those of the map
over all yaws and translations in the plane, as a keyframe with a submap, and must pass the gates of
a loop closure (`loops.matching.propose`). The floor gives z, roll and pitch. Ambiguous matches are
rejected, as a session at a wrong pose would corrupt the map permanently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import KEY_STEP
from tccm_ros.geometry import compose2, inverse2, planar, pose, spatial, transform
from tccm_ros.robust import MAJORITY
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.loops.matching import Window, propose
from tccm_ros.slam.loops.submaps import make_submap, merge_scans
from tccm_ros.slam.matching.level_scan import LevelScan, thin_with_normals
from tccm_ros.surfaces.merging.patch_planes import fit_plane
from tccm_ros.surfaces.views.views import View

BAND = (0.3, 1.6)
"""Range of heights above the floor in which an open column is free, m; chosen."""

MIN_FRONTIER = 30
"""Min number of frontier columns for a match; chosen."""


class AlignmentResult(StrEnum):
    """Result of the search for a session in a map; values are sources or reasons of failure."""

    FOUND = "structure and floor"
    TOO_FEW_ENDS = "too little structure"
    NO_MATCH = "no place fits"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True, slots=True, eq=False)
class SessionAlignment:
    """The result of the alignment of a session with a map.

    Attributes
    ----------
    result
        Success, or the reason of the failure.
    T_map_session
        float64 (4, 4); identity if the session was not found.
    """

    result: AlignmentResult
    T_map_session: Float64

    @property
    def found(self) -> bool:
        """Whether the session was found in the map."""
        return self.result is AlignmentResult.FOUND


def _open_cells(view: View, floor_z: float) -> Int64:
    """Return the open columns (N, 2): free in at least `MAJORITY` of the band."""
    low, high = floor_z + BAND[0], floor_z + BAND[1]
    free = np.clip(np.minimum(view.free.high, high) - np.maximum(view.free.low, low), 0.0, None)
    keys, group = np.unique(view.free.keys, return_inverse=True)
    keys = keys[np.bincount(group, free, len(keys)) >= MAJORITY * (high - low)]
    x = (keys + KEY_STEP // 2) // KEY_STEP
    return np.stack([x, keys - x * KEY_STEP], axis=1)


def _frontier(cells: Int64, size: float) -> Int64:
    """Return the first columns (N, 2) behind open ones, seen from the base.

    The lateral borders of the field of view are not included: the column behind a column there,
    seen from the base, is open too.
    """
    middle = (cells + 0.5) * size
    direction = middle / np.linalg.norm(middle, axis=1)[:, None]
    behind = np.unique(np.floor((middle + direction * size) / size).astype(np.int64), axis=0)
    # A view covers a square around the base: free space is cropped at its border.
    behind = behind[np.abs((behind + 0.5) * size).max(axis=1) < np.abs(middle).max()]
    known = set(map(tuple, cells.tolist()))
    return np.array([c for c in behind.tolist() if tuple(c) not in known], np.int64).reshape(-1, 2)


def _keyframes(views: Sequence[View], T_map_view: Float64, floor_z: float) -> list[GraphKeyframe]:
    """Return the views with free space as keyframes, whose scans are their frontiers."""
    keyframes: list[GraphKeyframe] = []
    for view, T in zip(views, T_map_view):
        cells, size = _open_cells(view, floor_z - T[2, 3]), view.free.cell_size
        frontier = _frontier(cells, size) if len(cells) else cells
        if len(frontier):
            middles = np.asarray((frontier + 0.5) * size, np.float64)
            scan, number = _level_scan(middles, size), len(keyframes)
            keyframes.append(GraphKeyframe(number, scan, planar(T), np.zeros(3), np.zeros((3, 3))))
    return keyframes


def _level_scan(frontier: Float64, size: float) -> LevelScan:
    """Return the middles of frontier columns (N, 2) of an edge (m) as a scan from the base."""
    beams = frontier[np.argsort(np.arctan2(frontier[:, 1], frontier[:, 0]), kind="stable")]
    step = size / float(np.median(np.hypot(beams[:, 0], beams[:, 1])))
    base = np.zeros(2)
    return LevelScan(0, np.zeros(3), beams, base, *thin_with_normals(beams, base, step))


def align_session(
    old: list[View], T_map_old: Float64, new: list[View], T_session_new: Float64, config: Config
) -> SessionAlignment:
    """Find the pose of a session's views in a map.

    Parameters
    ----------
    old, new
        Views of the map and of the session.
    T_map_old, T_session_new
        float64 (V, 4, 4), poses of these views.
    config
        Groups ``loops``, ``matching`` and ``surfaces``.
    """
    floors = _floor_frame(old, T_map_old, config), _floor_frame(new, T_session_new, config)
    heights = [0.0 if floor is None else float(floor[2, 3]) for floor in floors]
    in_map = _keyframes(old, T_map_old, heights[0])
    in_session = _keyframes(new, T_session_new, heights[1])
    if min(sum(len(k.scan.beams) for k in x) for x in (in_map, in_session)) < MIN_FRONTIER:
        return SessionAlignment(AlignmentResult.TOO_FEW_ENDS, np.eye(4))
    submap = make_submap(in_map, len(in_map) // 2, len(in_map))
    merged = merge_scans(in_session, len(in_session) // 2, len(in_session))
    low, high = submap.lines.points.min(axis=0), submap.lines.points.max(axis=0)
    # The centre of the session may be beside the map, by the range of its views.
    far = float(np.hypot(*merged.points.T).max()) + 0.5 * float((high - low).max())
    window = Window(np.array([*(0.5 * (low + high)), 0.0]), far, np.pi)
    found = propose(submap, merged, window, config)
    if found is None or found.reason:
        is_ambiguous = found is not None and found.is_ambiguous
        result = AlignmentResult.AMBIGUOUS if is_ambiguous else AlignmentResult.NO_MATCH
        return SessionAlignment(result, np.eye(4))
    placed = compose2(in_map[found.a].pose, found.delta)
    T = spatial(compose2(placed, inverse2(in_session[found.b].pose)))
    if floors[0] is not None and floors[1] is not None:
        T = _align_floors(floors[0], floors[1], T)
    return SessionAlignment(AlignmentResult.FOUND, T)


def _floor_frame(views: list[View], T_map_view: Float64, config: Config) -> Float64 | None:
    """Return a frame on the largest patch of the floor, float64 (4, 4), z up; None: no floor."""
    best: tuple[float, Float64] | None = None
    for view, T in zip(views, T_map_view):
        for patch in view.patches:
            low = transform(T, patch.mean[None])[0]
            area = patch.outline.area
            if low[2] <= config.surfaces.max_floor_height and (best is None or area > best[0]):
                normal = T[:3, :3] @ fit_plane(patch.cov)[0]
                best = area, pose(_rotation_to(normal), low)
    return None if best is None else best[1]


def _rotation_to(normal: Float64) -> Float64:
    """Return the rotation with z axis `normal` and zero yaw."""
    x = np.array([1.0, 0.0, -normal[0] / normal[2]])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def _align_floors(floor_map: Float64, floor_session: Float64, T_map_session: Float64) -> Float64:
    """Correct z, roll and pitch of an aligned session so that its floor is that of the map."""
    floor = T_map_session @ floor_session
    R = _rotation_to(floor_map[:3, 2]) @ _rotation_to(floor[:3, 2]).T
    about = floor[:3, 3]
    T = pose(R, about - R @ about) @ T_map_session
    moved = transform(T, floor_session[:3, 3][None])[0]
    T[2, 3] += floor_map[:3, 2] @ (floor_map[:3, 3] - moved) / floor_map[2, 2]
    return T
