"""Sides of surfaces: straight edges that a view observed.

Most of a patch's outline is no edge of the surface: the tilt cycle ended there, or an object
occludes the rest. The surface ends between its last points and the first ray that passed beyond
them at its height. A segment of the outline is a side if such rays passed along most of it. It is
in the middle of that strip, and the width of the strip gives its standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.outlines.edge_position import EDGE_SIGMA
from tccm_ros.outlines.shape_models import PROBE, SPACING
from tccm_ros.robust import UNIFORM_WIDTH, median_sigma
from tccm_ros.surfaces.edges.edge_samples import BEYOND, INSIDE, OUTSIDE, STRAIGHT
from tccm_ros.surfaces.views.crossings import crossings
from tccm_ros.surfaces.views.views import SurfacePatch, View

MIN_LENGTH = 0.2
"""Min length of a side, and of the overlap of two sides that match, m; chosen: the yaw of shorter
ones is uncertain."""

MIN_BINS = 5
"""Min number of points to which a line is fitted. With 3, sides reduce the error of views by a
tenth in place of a third (`test/surfaces/registration/test_registration.py`)."""

SEEN_THROUGH = 0.8
"""Min fraction of a side beyond which rays passed. With .85, hololens with every second image is
13 mm off in place of 6."""

FIT_ROUNDS = 6
"""Iterations of the robust line fit; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Sides:
    """The sides of the surfaces of one view, in x and y of the frame of its patches.

    Attributes
    ----------
    patch
        int64 (S,), index of the patch in the view.
    middle
        float64 (S, 2), m.
    outward
        float64 (S, 2), unit vectors away from the surface.
    length
        float64 (S,), m.
    height
        float64 (S,), height of the surface at the side, m.
    sigma
        float64 (S,), standard deviation across the side, m.
    """

    patch: Int64
    middle: Float64
    outward: Float64
    length: Float64
    height: Float64
    sigma: Float64

    def __len__(self) -> int:
        return len(self.patch)

    @property
    def yaw_sigma(self) -> Float64:
        """Standard deviations of the yaws, float64 (S,), rad, for even errors along the sides."""
        return UNIFORM_WIDTH * self.sigma / self.length

    def chosen(self, keep: Bool) -> Sides:
        """Return the sides selected by `keep`, bool (S,)."""
        return Sides(*(getattr(self, field.name)[keep] for field in fields(self)))

    def moved(self, middle: Float64, height: Float64) -> Sides:
        """Return the sides with other middles, float64 (S, 2), and heights, float64 (S,)."""
        return replace(self, middle=middle, height=height)


class _Side(NamedTuple):
    """One side, as in `Sides`."""

    middle: Float64
    outward: Float64
    length: float
    height: float
    sigma: float


_ROW = [("patch", "i8"), ("middle", "f8", 2), ("outward", "f8", 2)]
_ROW += [("length", "f8"), ("height", "f8"), ("sigma", "f8")]


def find_sides(view: View, margin: float) -> Sides:
    """Return the sides of a view's patches; `margin` is `views.clear_margin`, m."""
    rows = []
    for p, patch in enumerate(view.patches):
        passed = crossings(view, np.array([0.0, 0.0, 1.0]), float(patch.mean[2]), margin)
        for part in patch.outline.geoms:
            ring = shapely.geometry.polygon.orient(part.simplify(STRAIGHT), 1.0).exterior
            for start, end in pairwise(np.asarray(ring.coords)):
                side = _side(patch, (view.free, passed), margin, start, end)
                if side is not None:
                    rows.append((p, *side))
    table = np.array(rows, _ROW)
    return Sides(*(table[field.name].copy() for field in fields(Sides)))


def _side(
    patch: SurfacePatch,
    beyond: tuple[FreeColumns, Float64],
    margin: float,
    start: Float64,
    end: Float64,
) -> _Side | None:
    """Fit a side to a segment with the surface to its left; None: the segment is no side."""
    length = float(np.hypot(*(end - start)))
    if length < MIN_LENGTH:
        return None
    along = (end - start) / length
    outward = np.array([along[1], -along[0]])
    edge = _edge_points(patch, start, along, outward, length)
    if edge is None:
        return None
    at, across = edge
    offset, slope, spread = _fit_line(at - 0.5 * length, across)
    middle = start + 0.5 * length * along + offset * outward
    outward = (outward - slope * along) / np.hypot(1.0, slope)
    side = _Side(middle, outward, length, float(patch.mean[2]), spread)
    strip = _unseen_strip(beyond, margin, side, max(PROBE, 2.0 * patch.spacing))
    if strip is None:
        return None
    sigma = float(np.sqrt(EDGE_SIGMA**2 + spread**2 + (strip / UNIFORM_WIDTH) ** 2))
    return side._replace(middle=middle + 0.5 * strip * outward, sigma=sigma)


def _unseen_strip(
    beyond: tuple[FreeColumns, Float64], margin: float, side: _Side, width: float
) -> float | None:
    """Return the width of the strip beyond a side in which nothing was seen, m; None: no side.

    The surface ends between the last points and the first ray that passed beyond them. Where too
    few such rays are known, free columns show that it ends before them.

    Parameters
    ----------
    beyond
        Free columns of the view, and crossings of its rays at the height of the patch.
    margin
        Min distance of a free point from the ends of its interval, m.
    side
        Line through the last points.
    width
        Width of the pieces of the side with a first ray each, m.
    """
    free, passed = beyond
    along = np.array([-side.outward[1], side.outward[0]])
    offset = passed - side.middle
    at, across = offset @ along, offset @ side.outward
    near = (np.abs(at) < 0.5 * side.length) & (across > -INSIDE) & (across < BEYOND[-1])
    pieces = np.floor(at[near] / width).astype(np.int64)
    order = np.lexsort((across[near], pieces))
    first = order[np.diff(pieces[order], prepend=np.iinfo(np.int64).min) > 0]
    if len(first) >= SEEN_THROUGH * side.length / width:
        return max(float(np.median(across[near][first])), 0.0)
    count = max(int(side.length / PROBE), 2)
    steps = np.linspace(-0.5, 0.5, count) * (side.length - 2.0 * SPACING)
    for distance in BEYOND:
        probe = side.middle + steps[:, None] * along + distance * side.outward
        points = np.column_stack([probe, np.full(len(probe), side.height)])
        if free.contains(points, margin).mean() >= SEEN_THROUGH:
            return distance
    return None


def _edge_points(
    patch: SurfacePatch, start: Float64, along: Float64, outward: Float64, length: float
) -> tuple[Float64, Float64] | None:
    """Return positions along and across a side of its outermost points, m; None: too few."""
    offset = patch.points[:, :2].astype(np.float64) - start
    at, across = offset @ along, offset @ outward
    near = (at > 0.0) & (at < length) & (across > -INSIDE) & (across < OUTSIDE)
    at, across = at[near], across[near]
    bins = np.floor(at / max(patch.spacing, STRAIGHT)).astype(np.int64)
    order = np.lexsort((-across, bins))
    bins, at, across = bins[order], at[order], across[order]
    first = np.flatnonzero(np.r_[True, np.diff(bins) > 0]) if len(bins) else np.zeros(0, int)
    first = first[np.diff(np.r_[first, len(bins)]) >= 2]
    if len(first) < MIN_BINS:
        return None
    return at[first], across[first]


def _fit_line(at: Float64, across: Float64) -> tuple[float, float, float]:
    """Fit ``across = offset + slope * at`` robustly; return offset, slope and spread (m)."""
    A = np.stack([np.ones(len(at)), at], axis=1)
    weight = np.ones(len(at))
    line: Float64 = np.zeros(2)
    spread = 0.0
    for _ in range(FIT_ROUNDS):
        W = A * weight[:, None]
        line = np.asarray(np.linalg.solve(W.T @ A + 1e-9 * np.eye(2), W.T @ across), np.float64)
        residual = across - A @ line
        spread = max(median_sigma(residual), 0.5 * EDGE_SIGMA)
        weight = 1.0 / (1.0 + (residual / (2.0 * spread)) ** 2)
    return float(line[0]), float(line[1]), spread
