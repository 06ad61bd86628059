"""Faces of a compartment, as fractions of the area on which beams ended or which they passed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.geometry import inverse, transform
from tccm_ros.racks.compartment import FaceState, SeenView
from tccm_ros.racks.hits import Hits
from tccm_ros.racks.seen_space import mark_cells

CELL = 0.05
"""Edge of a cell of a face, m; chosen: a little more than a cube of hits."""

ON_FACE = 0.06
"""Maximum distance of hits on a face from it, m; chosen: the error of a board's edge is 2 cm, and
a back may be offset by the rest."""

PASSED = 0.06
"""A beam passed a face if it ended at least this far beyond it, m: further than any fitting on it.
"""

STATE_FRACTION = 0.5
"""Minimum fraction of a face that is measured, or passed, for its state; chosen: most of it."""

MIN_COSINE = 0.3
"""Minimum cosine between a beam and a face's normal; chosen: 17 degrees of grazing angle."""


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A vertical rectangle at a side of a compartment.

    Attributes
    ----------
    T_map_face
        float64 (4, 4): the middle of its lower edge; x is its outward normal, z is up.
    width, height
        Along y and z, m.
    """

    T_map_face: Float64
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class SeenFace:
    """Measurements of a face.

    Attributes
    ----------
    measured, passed
        Fractions of its area, below a bar, on which beams ended, and which beams passed without an
        end on it.
    offset
        Median offset of hits along its outward normal, m; 0 if no beam ended on it.
    bar
        Lower end of the lowest bar across it, as of a board's front, over its lower edge, m; inf
        without one. A bar is measured, the face is open below it.
    """

    measured: float
    passed: float
    offset: float
    bar: float

    @property
    def state(self) -> FaceState:
        """Observation state of the face."""
        return _state(self.measured, self.passed)


def _state(measured: float, passed: float) -> FaceState:
    """Return the state of a face, or of a row of its cells, by the fractions of `SeenFace`."""
    is_closed = measured > STATE_FRACTION * (measured + passed)
    if is_closed and measured >= 0.5 * STATE_FRACTION:
        return FaceState.MEASURED
    return FaceState.OPEN if passed >= STATE_FRACTION else FaceState.UNKNOWN


def measure_face(face: Face, hits: Hits, views: Sequence[SeenView]) -> SeenFace:
    """Return the measurements of a face.

    Parameters
    ----------
    face
        The face, in map.
    hits
        Hits near it.
    views
        Views, whose free columns show beams that ended further away.
    """
    shape = max(round(face.width / CELL), 1), max(round(face.height / CELL), 1)
    size = np.array([face.width / shape[0], face.height / shape[1]])
    T_face = inverse(face.T_map_face)
    ends, origins = transform(T_face, hits.ends), transform(T_face, hits.origins)
    measured, passed = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    corner = np.array([-0.5 * face.width, 0.0])
    on = np.abs(ends[:, 0]) <= ON_FACE
    mark_cells(measured, ends[on, 1:], corner, size)
    crossing = (np.abs(ends[:, 0]) > PASSED) & (ends[:, 0] * origins[:, 0] < 0.0)
    a, b = origins[crossing], ends[crossing]
    crossed = a + (b - a) * (a[:, :1] / (a[:, :1] - b[:, :1]))
    mark_cells(passed, crossed[:, 1:], corner, size)
    y, z = (corner[k] + (np.arange(shape[k]) + 0.5) * size[k] for k in range(2))
    middles = np.stack(np.meshgrid([0.0], y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    for view in views:
        passed |= _columns_passed(face, middles, view).reshape(shape)
    passed &= ~measured
    inside = on & (np.abs(ends[:, 1]) < 0.5 * face.width) & (np.abs(ends[:, 2]) < face.height)
    offset = float(np.median(ends[inside, 0])) if inside.any() else 0.0
    row, bar = _bar(measured, passed), np.inf
    if row is not None:
        columns, rows = np.floor((ends[inside, 1:] - corner) / size).astype(np.int64).T
        in_bar = (rows >= row) & (rows < row + 2) & ~measured[columns, row - 1]
        on[inside] = in_bar
        end = lower_end(
            on & inside, ends, origins, hits.half, offset, 0.5 * face.width, (row - 1) * size[1]
        )
        bar = np.inf if end is None else end
    below = measured[:, :row], passed[:, :row]
    return SeenFace(float(below[0].mean()), float(below[1].mean()), offset, bar)


def lower_end(
    on: Bool,
    ends: Float64,
    origins: Float64,
    half: Float64,
    offset: float,
    half_width: float,
    min_height: float,
) -> float | None:
    """Return the height of the lower end of a front: the one that the fewest beams contradict.

    Beams that ended on the front contradict a lower end above them; beams that passed below it
    contradict one below them. Range errors are along the beams, so the height of a beam is that at
    which it crosses the front. The end of a beam from below may be on the lower side of the board:
    its own height is used.

    Parameters
    ----------
    on
        bool (M,), hits on the front; at least one.
    ends, origins, half
        Hits, float64 (M, 3), (M, 3) and (M,), in a frame whose x axis is the front's normal, and z
        is up.
    offset, half_width
        x of the front, and its extent along y to either side of the origin, m.
    min_height
        Minimum height of a lower end where no beam is near it, m.

    Returns
    -------
    Middle between the nearest beams, m; None if no beam passed below the front.
    """
    away = ends[:, 0] - offset
    passed = (np.abs(away) > PASSED) & (away * (origins[:, 0] - offset) < 0.0)
    chosen = on | passed
    a, b, is_on = origins[chosen], ends[chosen], on[chosen]
    z = b[:, 2] + np.where(is_on, -1.0, 1.0) * half[chosen]
    part = (offset - a[:, 0]) / (b[:, 0] - a[:, 0])
    is_crossing = ~is_on | (b[:, 2] < a[:, 2])
    z = np.where(is_crossing, a[:, 2] + part * (z - a[:, 2]), z)
    y = a[:, 1] + part * (b[:, 1] - a[:, 1])
    middle = np.median(z[is_on])
    lower = np.flatnonzero((z < middle) & (np.abs(y) < half_width))
    lower = lower[np.argsort(z[lower], kind="stable")]
    if is_on[lower].all():
        return None
    steps = np.where(is_on[lower], 1, -1)
    contradicting = np.cumsum(np.append(0, steps))
    best = np.flatnonzero(contradicting == contradicting.min())
    heights = np.append(z[lower], middle)
    high = float(heights[best[-1]])
    return 0.5 * (max(float(heights[best[0] - 1]), min(high, min_height)) + high)


def _bar(measured: Bool, passed: Bool) -> int | None:
    """Return the lowest row of cells that is measured above an open part; None without one.

    Posts, which are measured in the row below as well, are not counted. The part above the bar may
    be out of the field of view.
    """
    for k in range(1, measured.shape[1]):
        below, row = measured[:, :k], measured[:, k] & ~measured[:, k - 1]
        is_open = _state(below.mean(), passed[:, :k].mean()) == FaceState.OPEN
        if is_open and _state(row.mean(), passed[:, k].mean()) == FaceState.MEASURED:
            return k
    return None


def _columns_passed(face: Face, points: Float64, view: SeenView) -> Bool:
    """Return at which points (N, 3) of a face beams of a view passed it, bool (N,).

    Beams start at the viewpoint. They passed a point if the columns before and behind the face are
    free along the ray through it. These columns are far enough from the face not to contain it.
    """
    T_view_face = inverse(view.T_map_view) @ face.T_map_face
    at, normal = transform(T_view_face, points), T_view_face[:3, 0]
    along = at - view.viewpoint
    along /= np.linalg.norm(along, axis=1)[:, None]
    cosine = np.abs(along @ normal)
    step = along * (np.sqrt(2.0) * view.free.cell_size / np.maximum(cosine, MIN_COSINE))[:, None]
    is_free = view.free.contains(at - step) & view.free.contains(at + step)
    return np.asarray((cosine >= MIN_COSINE) & is_free)
