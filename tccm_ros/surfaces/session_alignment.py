"""The pose of a new session in a saved map, when no level laser tells: by structure and planes.

What a view looked through ends at walls and furniture. These ends, in columns seen from above, are
matched over all yaws and shifts; the floor gives height, roll and pitch. A match that another pose
nearly reaches is refused: a wrong session spoils a map for good.
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
from tccm_ros.geometry import compose2, planar, pose, spatial, transform, transform2
from tccm_ros.surfaces.patch_planes import fit_plane
from tccm_ros.surfaces.views import KEY_STEP, View

__all__ = ["AlignmentResult", "SessionAlignment", "Structure", "align_session", "structure"]


BAND = (0.3, 1.6)
"""Heights above the floor, m, in which a column must be free to count as open."""

MIN_FREE_FRACTION = 0.5
"""Of the band."""

CELL = 0.1
"""Cell of the search, m."""

YAWS = 360
"""Yaws that are searched: a degree apart."""

SAME_POSE = (0.4, np.radians(10.0))
"""Poses further apart than this (m, rad) are different ones."""

CONTRADICTION = 0.5
"""What an end costs that lies where the other side looked through, of what a match earns."""

MAX_BLUR = 0.03
"""Where less than this of the blurred ends is left, the open is away from any end."""

MIN_SCORE = 0.12
"""Fraction of the new ends that must lie on old ends, less those that lie in the open."""

AMBIGUOUS = 0.72
"""A second pose with this fraction of the best one's score makes the match ambiguous."""

MIN_ENDS = 30
"""Fewer ends than this tell no pose."""


class AlignmentResult(StrEnum):
    """Why a session was found in a map, or was not."""

    FOUND = "structure and floor"
    TOO_FEW_ENDS = "too little structure"
    NO_MATCH = "no place fits"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True, slots=True, eq=False)
class SessionAlignment:
    """How a session was aligned with a map.

    Attributes
    ----------
    result
        Whether it is part of the map, and why not.
    T_map_session
        float64 (4, 4); identity where it was not found.
    """

    result: AlignmentResult
    T_map_session: Float64

    @property
    def found(self) -> bool:
        """Whether the session is part of the map."""
        return self.result is AlignmentResult.FOUND


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """What views show from above: ends float64 (N, 2) of what was looked through, and what was
    open float64 (M, 2), m.
    """

    ends: Float64
    open: Float64


def structure(views: list[View], T_map_view: Float64, floor_z: float) -> Structure:
    """Return the structure that views show, in their common frame."""
    ends, open_ = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for view, T in zip(views, T_map_view):
        cells = _open_cells(view, floor_z - T[2, 3])
        if len(cells):
            size = view.free.cell_size
            open_.append(transform2(planar(T), (cells + 0.5) * size))
            ends.append(transform2(planar(T), (_end_cells(cells, size) + 0.5) * size))
    return Structure(np.concatenate(ends), np.concatenate(open_))


def _open_cells(view: View, floor_z: float) -> Int64:
    """Return the columns (N, 2) that are free over most of the band."""
    low, high = floor_z + BAND[0], floor_z + BAND[1]
    free = np.clip(np.minimum(view.free.high, high) - np.maximum(view.free.low, low), 0.0, None)
    keys, group = np.unique(view.free.keys, return_inverse=True)
    keys = keys[np.bincount(group, free, len(keys)) >= MIN_FREE_FRACTION * (high - low)]
    x = (keys + KEY_STEP // 2) // KEY_STEP
    return np.stack([x, keys - x * KEY_STEP], axis=1)


def _end_cells(cells: Int64, size: float) -> Int64:
    """Return the first columns (N, 2) behind open ones, seen from the base.

    The sides of what the laser swept are not ends: what lies behind them, seen from the base, is
    open too.
    """
    middle = (cells + 0.5) * size
    ahead = middle / np.linalg.norm(middle, axis=1)[:, None]
    behind = np.unique(np.floor((middle + ahead * size) / size).astype(np.int64), axis=0)
    # A view covers a square around the base: what reaches its border was cut there, not stopped.
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
        float64 (V, 4, 4) of each.
    config
        Uses the group ``surfaces``.
    """
    floors = _floor(old, T_map_old, config), _floor(new, T_session_new, config)
    heights = [0.0 if floor is None else float(floor[2, 3]) for floor in floors]
    here = structure(old, T_map_old, heights[0])
    there = structure(new, T_session_new, heights[1])
    if min(len(here.ends), len(there.ends)) < MIN_ENDS:
        return SessionAlignment(AlignmentResult.TOO_FEW_ENDS, np.eye(4))
    best, score, second = _search(here, there)
    if score < MIN_SCORE:
        return SessionAlignment(AlignmentResult.NO_MATCH, np.eye(4))
    if second > AMBIGUOUS * score:
        return SessionAlignment(AlignmentResult.AMBIGUOUS, np.eye(4))
    T = spatial(_refine(here, there, best))
    if floors[0] is not None and floors[1] is not None:
        T = _align_floors(floors[0], floors[1], T)
    return SessionAlignment(AlignmentResult.FOUND, T)


def _search(here: Structure, there: Structure) -> tuple[Float64, float, float]:
    """Return the best planar pose (3,) of the new structure, its score, and the second best."""
    origin = here.open.min(axis=0) - 1.0
    radius = max(np.abs(there.ends).max(), np.abs(there.open).max()) * np.sqrt(2.0) + 1.0
    extent = np.ceil((here.open.max(axis=0) + 1.0 - origin + 2.0 * radius) / CELL).astype(int)
    shape = tuple(next_fast_len(int(n), real=True) for n in extent)
    near = gaussian_filter(_raster(here.ends, origin, shape).clip(max=1.0), 0.7)
    inside = _raster(here.open, origin, shape).clip(max=1.0) * (near < MAX_BLUR)
    gain = np.minimum(near / 0.45, 1.0) - CONTRADICTION * inside
    gains = rfft2(gain)
    corner = np.array([-radius, -radius])
    scores, poses = np.empty(YAWS), np.empty((YAWS, 3))
    for k, yaw in enumerate(np.arange(YAWS) * (2.0 * np.pi / YAWS)):
        turned = transform2(np.array([0.0, 0.0, yaw]), there.ends)
        ends = rfft2(_raster(turned, corner, shape).clip(max=1.0))
        matches = irfft2(gains * ends.conj(), shape) / len(there.ends)
        cell = np.array(np.unravel_index(int(np.argmax(matches)), shape))
        scores[k] = matches[tuple(cell)]
        cell -= np.array(shape) * (cell > np.array(shape) // 2)
        poses[k] = (*(origin + cell * CELL + radius), yaw)
    k = int(np.argmax(scores))  # of equal ones the first: the least yaw
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


def _refine(here: Structure, there: Structure, start: Float64) -> Float64:
    """Move the ends onto each other: point to point, with a weight that forgets outliers."""
    tree, refined = cKDTree(here.ends), start
    for max_distance in (0.3, 0.2, 0.15, 0.12, 0.12, 0.12, 0.12, 0.12):
        moved = transform2(refined, there.ends)
        distance, near = tree.query(moved)
        weight = np.clip(1.0 - (distance / max_distance) ** 2, 0.0, None) ** 2
        if weight.sum() < 3.0:
            break
        refined = compose2(_fit(moved, here.ends[near], weight), refined)
    return refined


def _fit(source: Float64, target: Float64, weight: Float64) -> Float64:
    """Return the planar pose that moves source points (N, 2) onto target points."""
    w = weight / weight.sum()
    a, b = w @ source, w @ target
    s, t = source - a, target - b
    yaw = np.arctan2(w @ (s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]), w @ np.sum(s * t, axis=1))
    turned = transform2(np.array([0.0, 0.0, yaw]), a[None])[0]
    return np.array([*(b - turned), yaw])


def _floor(views: list[View], T_map_view: Float64, config: Config) -> Float64 | None:
    """Return a frame on the floor that the views saw, float64 (4, 4): z up from it."""
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
    """Return the rotation whose z axis is `normal`, by roll and pitch alone."""
    x = np.array([1.0, 0.0, -normal[0] / normal[2]])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def _align_floors(floor_map: Float64, floor_session: Float64, T_map_session: Float64) -> Float64:
    """Correct height, roll and pitch of a placed session so that its floor lies on the map's."""
    floor = T_map_session @ floor_session
    R = _rotation_to(floor_map[:3, 2]) @ _rotation_to(floor[:3, 2]).T
    about = floor[:3, 3]
    T = pose(R, about - R @ about) @ T_map_session
    moved = transform(T, floor_session[:3, 3][None])[0]
    T[2, 3] += floor_map[:3, 2] @ (floor_map[:3, 3] - moved) / floor_map[2, 2]
    return T
