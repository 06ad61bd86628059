"""Alignment of a new session with a saved map, without a level laser.

The free space of views ends at walls and furniture. The first columns behind free space, its
*frontier*, are matched with those of the saved map over all yaws and translations in the plane. The
floor gives z, roll and pitch. Ambiguous matches are rejected, as a session at a wrong pose would
corrupt the map permanently.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import KEY_STEP
from tccm_ros.geometry import compose2, planar, pose, spatial, transform, transform2
from tccm_ros.surfaces.patch_planes import fit_plane
from tccm_ros.surfaces.views import View

BAND = (0.3, 1.6)
"""Range of heights above the floor in which an open column is free, m; chosen."""

MIN_FREE_FRACTION = 0.5
"""Min fraction of the band that is free in an open column; chosen."""

CELL = 0.1
"""Edge of a cell of the search, m; chosen: a column of a view by default."""

YAWS = 360
"""Number of yaws of the search: steps of one degree; chosen."""

SAME_POSE = (0.4, np.radians(10.0))
"""Max difference (m, rad) of two poses that count as the same; chosen."""

CONTRADICTION = 0.5
"""Penalty of a frontier cell in an open column of the map, as a fraction of the score of a match;
chosen."""

MAX_BLUR = 0.03
"""Max value of the blurred frontier in a cell that counts as open; chosen."""

BLUR = 0.7
"""Standard deviation of the blur of the frontier, cells; chosen."""

FULL_MATCH = 0.45
"""Value of the blurred frontier at which a cell matches fully; chosen."""

MIN_SCORE = 0.12
"""Min score of a match: fraction of the session's frontier cells that match, minus penalties;
chosen."""

AMBIGUOUS = 0.72
"""Max ratio of the second-best to the best score of an unambiguous match; chosen."""

MIN_FRONTIER = 30
"""Min number of frontier cells for a match; chosen."""

MATCH_DISTANCES = (0.3, 0.2, 0.15, 0.12, 0.12, 0.12, 0.12, 0.12)
"""Distances, m, beyond which a frontier cell is an outlier in each iteration of the refinement;
chosen."""

MIN_WEIGHT = 3.0
"""Min sum of weights in an iteration of the refinement; chosen."""


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


@dataclass(frozen=True, slots=True, eq=False)
class _FreeSpace:
    """The free space of views in the plane: centres of columns, m.

    `frontier` float64 (N, 2) are the first columns behind open ones, `open` float64 (M, 2) the open
    columns.
    """

    frontier: Float64
    open: Float64


def _free_space(views: list[View], T_map_view: Float64, floor_z: float) -> _FreeSpace:
    """Return the free space of views in their common frame."""
    frontier, open_ = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for view, T in zip(views, T_map_view):
        cells = _open_cells(view, floor_z - T[2, 3])
        if len(cells):
            size = view.free.cell_size
            open_.append(transform2(planar(T), (cells + 0.5) * size))
            frontier.append(transform2(planar(T), (_frontier(cells, size) + 0.5) * size))
    return _FreeSpace(np.concatenate(frontier), np.concatenate(open_))


def _open_cells(view: View, floor_z: float) -> Int64:
    """Return the open columns (N, 2): free in at least `MIN_FREE_FRACTION` of the band."""
    low, high = floor_z + BAND[0], floor_z + BAND[1]
    free = np.clip(np.minimum(view.free.high, high) - np.maximum(view.free.low, low), 0.0, None)
    keys, group = np.unique(view.free.keys, return_inverse=True)
    keys = keys[np.bincount(group, free, len(keys)) >= MIN_FREE_FRACTION * (high - low)]
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
        Uses the group ``surfaces``.
    """
    floors = _floor_frame(old, T_map_old, config), _floor_frame(new, T_session_new, config)
    heights = [0.0 if floor is None else float(floor[2, 3]) for floor in floors]
    in_map = _free_space(old, T_map_old, heights[0])
    in_session = _free_space(new, T_session_new, heights[1])
    if min(len(in_map.frontier), len(in_session.frontier)) < MIN_FRONTIER:
        return SessionAlignment(AlignmentResult.TOO_FEW_ENDS, np.eye(4))
    best, score, second = _search(in_map, in_session)
    if score < MIN_SCORE:
        return SessionAlignment(AlignmentResult.NO_MATCH, np.eye(4))
    if second > AMBIGUOUS * score:
        return SessionAlignment(AlignmentResult.AMBIGUOUS, np.eye(4))
    T = spatial(_refine(in_map, in_session, best))
    if floors[0] is not None and floors[1] is not None:
        T = _align_floors(floors[0], floors[1], T)
    return SessionAlignment(AlignmentResult.FOUND, T)


def _search(in_map: _FreeSpace, in_session: _FreeSpace) -> tuple[Float64, float, float]:
    """Return the best planar pose (3,) of the session, its score, and the second-best score.

    The scores of all translations at one yaw are a cross-correlation of rasters.
    """
    origin = in_map.open.min(axis=0) - 1.0
    farthest = max(np.abs(in_session.frontier).max(), np.abs(in_session.open).max())
    radius = farthest * np.sqrt(2.0) + 1.0
    extent = np.ceil((in_map.open.max(axis=0) + 1.0 - origin + 2.0 * radius) / CELL).astype(int)
    shape = tuple(next_fast_len(int(n), real=True) for n in extent)
    near = gaussian_filter(_raster(in_map.frontier, origin, shape).clip(max=1.0), BLUR)
    inside = _raster(in_map.open, origin, shape).clip(max=1.0) * (near < MAX_BLUR)
    gain = np.minimum(near / FULL_MATCH, 1.0) - CONTRADICTION * inside
    gains = rfft2(gain)
    corner = np.array([-radius, -radius])
    scores, poses = np.empty(YAWS), np.empty((YAWS, 3))
    for k, yaw in enumerate(np.arange(YAWS) * (2.0 * np.pi / YAWS)):
        rotated = transform2(np.array([0.0, 0.0, yaw]), in_session.frontier)
        frontier = rfft2(_raster(rotated, corner, shape).clip(max=1.0))
        matches = irfft2(gains * frontier.conj(), shape) / len(in_session.frontier)
        cell = np.array(np.unravel_index(int(np.argmax(matches)), shape))
        scores[k] = matches[tuple(cell)]
        cell -= np.array(shape) * (cell > np.array(shape) // 2)
        poses[k] = (*(origin + cell * CELL + radius), yaw)
    k = int(np.argmax(scores))  # of equal scores the first: the smallest yaw
    moved = poses - poses[k]
    yaw = np.abs((moved[:, 2] + np.pi) % (2.0 * np.pi) - np.pi)
    elsewhere = (np.hypot(moved[:, 0], moved[:, 1]) > SAME_POSE[0]) | (yaw > SAME_POSE[1])
    return poses[k], float(scores[k]), float(scores[elsewhere].max(initial=0.0))


def _raster(points: Float64, origin: Float64, shape: tuple[int, int]) -> Float64:
    """Count points in cells of CELL."""
    grid = np.zeros(shape)
    cells = np.floor((points - origin) / CELL).astype(np.int64)
    inside = np.all((cells >= 0) & (cells < np.array(shape)), axis=1)
    np.add.at(grid, (cells[inside, 0], cells[inside, 1]), 1.0)
    return grid


def _refine(in_map: _FreeSpace, in_session: _FreeSpace, start: Float64) -> Float64:
    """Refine the pose by point-to-point registration of the frontiers, robust to outliers."""
    tree, refined = cKDTree(in_map.frontier), start
    for max_distance in MATCH_DISTANCES:
        moved = transform2(refined, in_session.frontier)
        distance, near = tree.query(moved)
        weight = np.clip(1.0 - (distance / max_distance) ** 2, 0.0, None) ** 2
        if weight.sum() < MIN_WEIGHT:
            break
        refined = compose2(_fit(moved, in_map.frontier[near], weight), refined)
    return refined


def _fit(source: Float64, target: Float64, weight: Float64) -> Float64:
    """Return the weighted least-squares planar transform of source points (N, 2) to targets."""
    w = weight / weight.sum()
    a, b = w @ source, w @ target
    s, t = source - a, target - b
    yaw = np.arctan2(w @ (s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]), w @ np.sum(s * t, axis=1))
    rotated = transform2(np.array([0.0, 0.0, yaw]), a[None])[0]
    return np.array([*(b - rotated), yaw])


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
