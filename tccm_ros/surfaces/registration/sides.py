"""Sides of surfaces: straight edges that a view observed.

Most of a patch's outline is no edge of the surface: the tilt cycle ended there, or an object
occludes the rest. A segment of the outline is a side if the view looked through the columns just
beyond it. Its position is the expected end of the surface, beyond the last points by half the
distance of the scan lines across it; that distance also gives its standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
import shapely

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.outlines.shape_models import PROBE, SPACING
from tccm_ros.robust import median_sigma
from tccm_ros.surfaces.edges.edge_samples import BEYOND, END_SIGMA, INSIDE, OUTSIDE, STRAIGHT
from tccm_ros.surfaces.merging.occluded_areas import MAX_SEEN_FRACTION
from tccm_ros.surfaces.views.outline import SIDE_EDGE_FRACTION
from tccm_ros.surfaces.views.views import SurfacePatch, View

MIN_LENGTH = 0.2
"""Min length of a side, and of the overlap of two sides that match, m; chosen: the yaw of shorter
ones is uncertain."""

MIN_BINS = 5
"""Min number of points to which a line is fitted. With 3, sides reduce the error of views by a
tenth in place of a third (`test/surfaces/registration/test_registration.py`)."""

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
        return np.sqrt(12.0) * self.sigma / self.length

    def chosen(self, keep: Bool) -> Sides:
        """Return the sides selected by `keep`, bool (S,)."""
        return Sides(*(getattr(self, field.name)[keep] for field in fields(self)))

    def moved(self, middle: Float64, height: Float64) -> Sides:
        """Return the sides with other middles, float64 (S, 2), and heights, float64 (S,)."""
        return replace(self, middle=middle, height=height)


_Side = tuple[Float64, Float64, float, float, float]
"""Middle, outward, length, height and sigma of one side, as in `Sides`."""

_ROW = [("patch", "i8"), ("middle", "f8", 2), ("outward", "f8", 2)]
_ROW += [("length", "f8"), ("height", "f8"), ("sigma", "f8")]


def find_sides(view: View, margin: float) -> Sides:
    """Return the sides of a view's patches; `margin` is `views.clear_margin`, m."""
    rows = []
    for p, patch in enumerate(view.patches):
        for part in patch.outline.geoms:
            ring = shapely.geometry.polygon.orient(part.simplify(STRAIGHT), 1.0).exterior
            for start, end in pairwise(np.asarray(ring.coords)):
                side = _side(patch, view.free, margin, start, end)
                if side is not None:
                    rows.append((p, *side))
    table = np.array(rows, _ROW)
    return Sides(*(table[field.name].copy() for field in fields(Sides)))


def _side(
    patch: SurfacePatch, free: FreeColumns, margin: float, start: Float64, end: Float64
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
    at, across, gap = edge
    offset, slope, spread = _fit_line(at - 0.5 * length, across)
    middle = start + 0.5 * length * along + offset * outward
    height = float(patch.mean[2])
    if not _is_edge(free, margin, middle, along, outward, length, height):
        return None
    outward = (outward - slope * along) / np.hypot(1.0, slope)
    beyond, sigma = _expected_edge(patch.spacing, gap, outward, middle)
    sigma = float(np.sqrt(sigma**2 + END_SIGMA**2 + spread**2 / len(at)))
    return middle + beyond * outward, outward, length, height, sigma


def _edge_points(
    patch: SurfacePatch, start: Float64, along: Float64, outward: Float64, length: float
) -> tuple[Float64, Float64, float] | None:
    """Return positions along and across a side of its outermost points, and their median gap, m."""
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
    return at[first], across[first], float(np.median(across[first] - across[first + 1]))


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
        spread = max(median_sigma(residual), 0.5 * END_SIGMA)
        weight = 1.0 / (1.0 + (residual / (2.0 * spread)) ** 2)
    return float(line[0]), float(line[1]), spread


def _is_edge(
    free: FreeColumns,
    margin: float,
    middle: Float64,
    along: Float64,
    outward: Float64,
    length: float,
    height: float,
) -> bool:
    """Return whether the view looked through the columns just beyond a side."""
    count = max(int(length / PROBE), 2)
    steps = np.linspace(-0.5, 0.5, count) * (length - 2.0 * SPACING)
    for beyond in BEYOND:
        probe = middle + steps[:, None] * along + beyond * outward
        points = np.column_stack([probe, np.full(len(probe), height)])
        through = free.contains(points, margin)
        if through.mean() >= 1.0 - MAX_SEEN_FRACTION:
            return True
    return False


def _expected_edge(
    spacing: float, gap: float, outward: Float64, middle: Float64
) -> tuple[float, float]:
    """Return the expected distance of an edge beyond the last points, and its sigma, m.

    Scan lines run around the robot at a distance of `spacing`, with beams at a distance of `gap`. A
    far side is between the last line and the next. On a line across a side, the last beam is lost
    as a mixed pixel. At a near side, the laser sees the front of the object, so that the last
    points are at the side.
    """
    radial = float(outward @ middle / max(np.hypot(*middle), 1e-6))
    line, beam = spacing * max(radial, 0.0), gap * np.sqrt(max(1.0 - radial**2, 0.0))
    front = SIDE_EDGE_FRACTION * spacing * max(-radial, 0.0)
    return 0.5 * line + beam, float(np.sqrt((line**2 + beam**2) / 12.0 + front**2))
