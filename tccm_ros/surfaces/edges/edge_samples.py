"""Samples of a surface's outline, and the last points of each view before its edges.

A view observes an edge if it looked through the space just beyond, at the surface's height. Where
an object occludes the rest, or the view ends, the outline of the points is no edge of the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import Polygon

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.outlines.edge_position import INDEPENDENT, SIGMA, EdgeSamples
from tccm_ros.outlines.shape_models import HIDDEN_WIDTH, PROBE, SPACING, OutlineSamples
from tccm_ros.records import SensorKind
from tccm_ros.robust import GATE, MAD_TO_SIGMA, MAJORITY, UNIFORM_WIDTH, median_sigma
from tccm_ros.sensors.noise import systematic_errors
from tccm_ros.surfaces.merging.merged_surface import MergedSurface
from tccm_ros.surfaces.merging.merging import NumberedPatch, clouds_in_map
from tccm_ros.surfaces.merging.occluded_areas import EDGE_FRACTION, looked_through, probes
from tccm_ros.surfaces.views.crossings import crossings
from tccm_ros.surfaces.views.scan_lines import line_direction
from tccm_ros.surfaces.views.views import View

FREE_MARGIN_M = 0.02
"""Min distance of a probe from the ends of its free interval, m. With `views.clear_margin` (0.03),
edges of seats move, and .6 % of true boards are 15 mm outside of the scene in place of .5 %
(`test/scene/test_planning_scene.py`)."""

STRAIGHT = 0.02
"""Simplification tolerance for the direction of an outline, m; chosen."""

BEYOND = (0.10, 0.15)
"""Distances beyond an outline at which free space is tested, m; chosen: the edge of a column, and
1.5 times that."""

PASSED_WITHIN, LINES_BEYOND = 2.0 * PROBE, 1.5
"""Radius of the circle that touches an outline, in which crossings of rays count: min, m, and as a
multiple of the distance of scan lines. Chosen: at least two lines are in the circle."""

HEIGHTS_ABOVE = (0.1, 0.2, 0.3)
"""Heights above a surface at which views look over objects on it, m; chosen: those of objects. At
any height, a counter of a random flat (118) goes on by 0.8 m over what stands beside it."""

MIN_PIECES = 3
"""Min number of pieces of an edge that support its position; chosen: one or two may be stray
points."""

INSIDE, OUTSIDE = 0.12, 0.05
"""Distances inside and outside of an edge within which a last point may be, m; chosen."""

CROSSING = 0.3
"""Min sine of the angle between an edge and a scan line that crosses it; chosen."""

FACING_VIEW = -0.5
"""An edge faces the view if the cosine between the ray and its outward direction is smaller than
this: scan lines continue down its front. Chosen: 30 deg."""

LINE_INSIDE, LINE_LENGTH = 0.24, 0.36
"""Distances inside of an edge within which a line may end, and within which its points are counted,
m; chosen: two and three times `INSIDE`, as no neighbouring line shows the end of the line."""

EVEN_SIGMA = 0.25 * MAD_TO_SIGMA
"""`median_sigma` of a uniform distribution, over its width: the median distance from the centre is
a quarter of the width."""

FRONT_FRACTION = 0.7
"""Fraction of the last samples at a near edge that are on the front below it; chosen: the part of
the front that counts as surface is one or two scan lines high."""


@dataclass(frozen=True, slots=True)
class Edge:
    """A straight edge in x and y of map, with the surface to its left.

    Attributes
    ----------
    start, end
        float64 (2,), m.
    """

    start: Float64
    end: Float64

    @property
    def length(self) -> float:
        """Its length, m."""
        return float(np.hypot(*(self.end - self.start)))

    @property
    def along(self) -> Float64:
        """Unit vector from start to end, float64 (2,)."""
        direction: Float64 = (self.end - self.start) / max(self.length, 1e-9)
        return direction

    @property
    def outward(self) -> Float64:
        """Unit vector away from the surface, float64 (2,)."""
        x, y = self.along
        return np.array([y, -x])


@dataclass(frozen=True)
class EdgePoints:
    """Points of a surface before an edge, from which its position and state follow.

    Attributes
    ----------
    samples
        The last points of each view before the edge.
    pieces
        Number of pieces of the edge.
    piece, across
        int64 (N,) and float64 (N,): the piece before which each point of the surface is, and its
        position across the edge, positive outwards, m.
    """

    samples: EdgeSamples
    pieces: int
    piece: Int64
    across: Float64

    def seen_fraction(self) -> float:
        """Return the fraction of the pieces of an edge at which a view observed the edge.

        Pieces without points of the surface do not count: the distance of scan lines may be larger
        than a piece.
        """
        found = self.samples
        is_end = found.ends & (np.abs(found.last) <= found.gap + GATE * SIGMA)
        seen = np.unique(np.floor(found.at[is_end] / SPACING).astype(np.int64))
        return len(seen) / max(np.isfinite(self._last_points()).sum(), 1)

    def reached_fraction(self, distance: float) -> float:
        """Return the fraction of the pieces of an edge with a point within `distance`, m, of it.

        Pieces without points do not count; 0.0 if no piece has any.
        """
        last = self._last_points()
        last = last[np.isfinite(last)]
        return float(np.mean(last >= -distance)) if len(last) else 0.0

    def ragged_sigma(self) -> float:
        """Return the standard deviation of last samples across an edge in excess of sampling, m.

        The samples of a true edge are collinear. Those at the border of an occlusion are not, and
        all of them fall short of the true edge by an unknown amount.
        """
        found = self.samples
        last, gap = found.last[found.ends], found.gap[found.ends]
        if len(last) < MIN_PIECES:
            return 0.0
        spread = median_sigma(last - np.median(last))
        expected = float(np.mean(gap**2)) * EVEN_SIGMA**2 + SIGMA**2
        return max(spread**2 - expected, 0.0) ** 0.5

    def furthest(self, limit: float = np.inf) -> float:
        """Return the largest distance across an edge at which the surface was measured, m.

        It is positive outwards, and -inf without any point. Points beyond `limit`, m, do not count.
        """
        last = self._last_points(limit)
        return float(np.sort(last)[-min(MIN_PIECES, len(last))])

    def is_ragged(self, limit: float = np.inf) -> bool:
        """Return whether most last points are short of the furthest one, as at an occlusion.

        Points beyond `limit`, m, do not count.
        """
        last, gaps = self._last_points(limit), self.samples.gap
        last = last[np.isfinite(last)]
        if not len(last) or not len(gaps):
            return False
        is_short = last < self.furthest(limit) - float(np.median(gaps)) - GATE * SIGMA
        return bool(is_short.mean() > MAJORITY)

    def _last_points(self, limit: float = np.inf) -> Float64:
        """Return the outermost point of the surface across each piece of an edge, m; -inf: none."""
        last, near = np.full(self.pieces, -np.inf), self.across < limit
        np.maximum.at(last, self.piece[near], self.across[near])
        return last


@dataclass(frozen=True)
class EdgeSampler:
    """Samples the edges of one surface from its views.

    Attributes
    ----------
    surface
        The surface.
    views, T_map_view
        All views, and their poses, float64 (V, 4, 4).
    config
        Uses `views.clear_margin` and the systematic errors of ``sensors``.
    """

    surface: MergedSurface
    views: Sequence[View]
    T_map_view: Float64
    config: Config

    @cached_property
    def _clouds(self) -> list[tuple[NumberedPatch, Float64]]:
        members = self.surface.members
        return list(zip(members, clouds_in_map(members, self.T_map_view)))

    @cached_property
    def _inverses(self) -> dict[int, Float64]:
        return {v: inverse(self.T_map_view[v]) for v in sorted(self.surface.views)}

    def outline_samples(self) -> OutlineSamples:
        """Return samples along the outline of the area that the views cover."""
        ring = shapely.geometry.polygon.orient(Polygon(self.surface.polygon.exterior), 1.0).exterior
        count = max(int(ring.length / SPACING), 8)
        at = (np.arange(count) + 0.5) / count
        points = shapely.get_coordinates(shapely.line_interpolate_point(ring, at, normalized=True))
        outward = _outward_at(ring, points)
        spacings = [m.patch.spacing for m in self.surface.members if m.patch.spacing > 0.0]
        spacing = min(spacings, default=SPACING)
        sigma = np.full(count, np.hypot(SIGMA, spacing / UNIFORM_WIDTH))
        sampling = np.full(count, spacing / UNIFORM_WIDTH)
        seen, within = np.zeros(count, bool), np.full(count, np.inf)
        for view in self._inverses:
            if len(self.views[view].hits):
                within = np.minimum(within, self._passed_within(view, points, outward))
            else:  # a map of version 0.1
                seen |= self._looks_past(view, points, outward)[0]
        is_passed = np.isfinite(within)
        sampling[is_passed] = np.maximum(within[is_passed], spacing) / UNIFORM_WIDTH
        return OutlineSamples(
            points, outward, sigma, sampling, seen | is_passed, self._looked_through()
        )

    def _passed_within(self, view: int, points: Float64, outward: Float64) -> Float64:
        """Return the distance beyond points within which a ray of a view passed, float64 (N,), m.

        A ray passed where it crossed the surface's plane in a circle that touches the outline.
        Infinite if no ray passed near enough.
        """
        T = self.T_map_view[view]
        normal = self.surface.normal @ T[:3, :3]
        offset = self.surface.offset - float(self.surface.normal @ T[:3, 3])
        passed = crossings(self.views[view], normal, offset, self.config.views.clear_margin)
        within = np.full(len(points), np.inf)
        if not len(passed):
            return within
        spacing = max(m.patch.spacing for m in self.surface.members if m.view == view)
        largest = min(max(PASSED_WITHIN, LINES_BEYOND * spacing), 0.5 * HIDDEN_WIDTH)
        radii = [largest, 0.5 * largest, 0.25 * largest]
        lifted = [self.surface.lift(points + radius * outward) for radius in radii]
        middles = [transform(self._inverses[view], each)[:, :2] for each in lifted]
        low = np.min(middles, axis=(0, 1)) - 2.0 * largest
        high = np.max(middles, axis=(0, 1)) + 2.0 * largest
        tree = cKDTree(passed[((passed > low) & (passed < high)).all(axis=1)])
        for radius, middle in zip(radii, middles):
            distance, _ = tree.query(middle, distance_upper_bound=radius)
            within[np.isfinite(distance)] = 2.0 * radius
        return within

    def _looked_through(self) -> Float64:
        """Return the squares outside of the outline that a view looked through, float64 (M, 2)."""
        outline = Polygon(self.surface.polygon.exterior)
        x_min, y_min, x_max, y_max = outline.bounds
        axes = np.arange(x_min, x_max, PROBE), np.arange(y_min, y_max, PROBE)
        points = np.stack([axis.ravel() for axis in np.meshgrid(*axes)], axis=1)
        wide = outline.buffer(BEYOND[0])
        points = points[~shapely.contains_xy(wide, points[:, 0], points[:, 1])]
        through = np.zeros(len(points), bool)
        for view, T_view_map in self._inverses.items():
            local = transform(T_view_map, self.surface.lift(points))
            through |= self.views[view].free.contains(local, FREE_MARGIN_M)
        return points[through]

    def edge_samples(self, edge: Edge) -> EdgeSamples:
        """Return the last points of each view before an edge; the edge is at 0 across."""
        found = [self._of_patch(edge, member, cloud) for member, cloud in self._clouds]
        rows = [np.zeros((0, 6)), *(rows for rows in found if rows is not None)]
        table = np.concatenate(rows)
        at, last, gap, front, ends, weight = table.T
        return EdgeSamples(at, last, gap, front, ends > 0.0, weight)

    def points_before(self, edge: Edge) -> EdgePoints:
        """Return the points of the surface and of its views before an edge."""
        offset = np.concatenate([cloud[:, :2] for _, cloud in self._clouds]) - edge.start
        at, across = offset @ edge.along, offset @ edge.outward
        near = (at > SPACING) & (at < edge.length - SPACING)
        piece = np.floor(at[near] / SPACING).astype(np.int64)
        pieces = int(edge.length / SPACING) + 1
        return EdgePoints(self.edge_samples(edge), pieces, piece, across[near])

    @cached_property
    def _directions(self) -> dict[NumberedPatch, Float64 | None]:
        return {
            m: None
            if self.views[m.view].sensor is SensorKind.DEPTH_IMAGE
            else line_direction(cloud[:, :2], m.patch.spacing)
            for m, cloud in self._clouds
        }

    def _of_patch(self, edge: Edge, member: NumberedPatch, cloud: Float64) -> Float64 | None:
        """Return the rows of `EdgeSamples` of one patch."""
        direction = self._directions[member]
        ray = 0.5 * (edge.start + edge.end) - self.T_map_view[member.view][:2, 3]
        if direction is None or ray @ edge.outward <= FACING_VIEW * np.hypot(*ray):
            return self._pieces(edge, member, cloud, None)
        direction = direction * (1.0 if direction @ edge.outward >= 0.0 else -1.0)
        if direction @ edge.outward >= CROSSING:
            return self._line_ends(edge, member, cloud, direction)
        return self._pieces(edge, member, cloud, direction)

    def _line_ends(
        self, edge: Edge, member: NumberedPatch, cloud: Float64, direction: Float64
    ) -> Float64 | None:
        """Return the rows of the scan lines that cross an edge and end near it, one for each."""
        offset = cloud[:, :2] - edge.start
        at, across = offset @ edge.along, offset @ edge.outward
        sine, cosine = float(direction @ edge.outward), float(direction @ edge.along)
        crosses_at = at - across * cosine / sine
        near = (across > -LINE_LENGTH) & (across < OUTSIDE)
        near &= (at > SPACING) & (at < edge.length - SPACING)
        near &= (crosses_at > 0.0) & (crosses_at < edge.length)
        if not near.any():
            return None
        at, across, crosses_at = at[near], across[near], crosses_at[near]
        width = max(SPACING, member.patch.spacing / sine)
        lines = np.floor(crosses_at / width).astype(np.int64)
        order = np.lexsort((-across, lines))
        begins = np.r_[True, np.diff(lines[order]) > 0]
        step = -np.diff(across[order])[~begins[1:]]
        if not (step > SIGMA * sine).any():
            return None
        step = float(np.median(step[step > SIGMA * sine]))
        first = np.flatnonzero(begins)
        count = np.diff(np.r_[first, len(order)])
        is_line = count >= max(2.0, MAJORITY * float(np.median(count)))
        tips = order[first[is_line]]
        tips = tips[across[tips] > -LINE_INSIDE]
        gap = np.full(len(tips), step)
        front = FRONT_FRACTION * np.maximum(-self._cosines(edge, member, at[tips]), 0.0)
        return self._rows(edge, member, at[tips], across[tips], gap, front)

    def _pieces(
        self, edge: Edge, member: NumberedPatch, cloud: Float64, direction: Float64 | None
    ) -> Float64 | None:
        """Return the rows of the pieces of an edge, one for the last point of each piece."""
        offset = cloud[:, :2] - edge.start
        at, across = offset @ edge.along, offset @ edge.outward
        near = (at > SPACING) & (at < edge.length - SPACING)
        near &= (across > -INSIDE) & (across < OUTSIDE)
        if np.count_nonzero(near) < 3:
            return None
        at, across = at[near], across[near]
        pieces = np.floor(at / SPACING).astype(np.int64)
        order = np.lexsort((-across, pieces))
        pieces, at, across = pieces[order], at[order], across[order]
        first = np.flatnonzero(np.r_[True, np.diff(pieces) > 0])
        has_next = np.diff(np.r_[first, len(pieces)]) >= 2
        beam = 0.0
        if has_next.any():
            at_first = first[has_next]
            beam = float(np.median(across[at_first] - across[at_first + 1]))
        at, last = at[first], across[first]
        radial = self._cosines(edge, member, at)
        across_lines = radial if direction is None else np.full(len(at), direction @ edge.along)
        gap = _gaps(across_lines, member.patch.spacing, beam)
        return self._rows(edge, member, at, last, gap, FRONT_FRACTION * np.maximum(-radial, 0.0))

    def _rows(
        self,
        edge: Edge,
        member: NumberedPatch,
        at: Float64,
        last: Float64,
        gap: Float64,
        front: Float64,
    ) -> Float64:
        """Return rows of `EdgeSamples`, with flags for observed ends, and weights.

        Free space is tested beyond the last point, not beyond the edge, which is only a first
        guess. If the view looked nowhere beyond the point, the view ends there, and the sample
        distance tells nothing about the end of the surface.
        """
        points = edge.start + at[:, None] * edge.along
        points = points + np.minimum(last, 0.0)[:, None] * edge.outward
        outward = np.broadcast_to(edge.outward, points.shape)
        ends, is_in_view = self._looks_past(member.view, points, outward)
        gap = np.where(is_in_view, gap, 0.0)
        weight = np.full(len(at), min(1.0, INDEPENDENT / max(len(at), 1)))
        return np.stack([at, last, gap, front, ends, weight], axis=1)

    def _cosines(self, edge: Edge, member: NumberedPatch, at: Float64) -> Float64:
        """Return the cosines between the rays to points of an edge and its outward direction."""
        rays = edge.start + at[:, None] * edge.along - self.T_map_view[member.view][:2, 3]
        return np.asarray(rays @ edge.outward / np.maximum(np.hypot(*rays.T), 1e-6), np.float64)

    def shared_sigma(self, edge: Edge) -> float:
        """Return the standard deviation across an edge of the systematic error of its views, m.

        One sensor took all views: range errors along opposite rays cancel.
        """
        middle = self.surface.lift(0.5 * (edge.start + edge.end)[None])
        moved = []
        for view, T_view_map in self._inverses.items():
            eye = self.views[view].viewpoint
            eye = np.zeros(3) if eye is None else eye
            local = transform(T_view_map, middle)
            errors = systematic_errors(local, eye, self.views[view].sensor, self.config)[0]
            outward = self.T_map_view[view][:2, :3].T @ edge.outward
            moved.append(errors @ outward)
        return float(np.linalg.norm(np.stack(moved).mean(axis=0)))

    def looks_over(self, edge: Edge) -> bool:
        """Return whether any view looked through the columns beyond an edge, at any height."""
        at = np.linspace(0.0, 1.0, int(edge.length / PROBE) + 2)[:, None]
        beyond = edge.start + at * (edge.end - edge.start) + BEYOND[1] * edge.outward
        points, over = self.surface.lift(beyond), np.zeros(len(beyond), bool)
        for view, T_view_map in self._inverses.items():
            over |= self.views[view].free.looked_into(transform(T_view_map, points))
        return bool(over.mean() >= MAJORITY)

    def faces_views(self, edge: Edge) -> bool:
        """Return whether most views of the surface were taken from beyond an edge."""
        middle = 0.5 * (edge.start + edge.end)
        origins = np.stack([self.T_map_view[view][:2, 3] for view in self._inverses])
        return bool(((origins - middle) @ edge.outward > 0.0).mean() > 0.5)

    def may_go_on(self, area: Polygon) -> bool:
        """Return whether the surface may extend into an area where objects on it occlude it.

        No view looked through the area at the height of the surface, and views looked through the
        space above most of it: a cabinet as high as the room is no object on a worktop.
        """
        at = self.surface.lift(probes(area, self.surface.height)[:, :2])
        if not len(at):
            return False
        through, *above = (
            looked_through(at + np.array([0.0, 0.0, z]), self.views, self.T_map_view, self.config)
            for z in (0.0, *HEIGHTS_ABOVE)
        )
        is_over = np.any(above, axis=0).mean() >= MAJORITY
        return bool(through.mean() <= EDGE_FRACTION and is_over)

    def hides(self, edge: Edge, other: MergedSurface) -> bool:
        """Return whether a higher surface is between any view and the middle of an edge."""
        if other.height <= self.surface.height:
            return False
        middle = 0.5 * (edge.start + edge.end)
        origins = [self.T_map_view[view][:2, 3] for view in self._inverses]
        ways = shapely.linestrings([np.stack([origin, middle]) for origin in origins])
        return bool(shapely.intersects(ways, other.polygon).any())

    def _looks_past(self, view: int, points: Float64, outward: Float64) -> tuple[Bool, Bool]:
        """Return whether a view looked past each point of an outline.

        Returns
        -------
        through, into : bool (N,)
            Whether it looked through the space just beyond, and into the columns there, at any
            height.
        """
        free = self.views[view].free
        probes = [self.surface.lift(points + beyond * outward) for beyond in BEYOND]
        local = [transform(self._inverses[view], at) for at in probes]
        through = np.any([free.contains(at, FREE_MARGIN_M) for at in local], axis=0)
        return through, np.any([free.looked_into(at) for at in local], axis=0)


def _outward_at(ring: shapely.LinearRing, points: Float64) -> Float64:
    """Return the outward directions of a counter-clockwise ring at points on it."""
    smooth = np.asarray(ring.simplify(STRAIGHT).coords)
    edges = shapely.linestrings(np.stack([smooth[:-1], smooth[1:]], axis=1))
    nearest = shapely.STRtree(edges).nearest(shapely.points(points))
    along = (smooth[1:] - smooth[:-1])[nearest]
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    return np.column_stack([along[:, 1], -along[:, 0]])


def _gaps(cosine: Float64, spacing: float, beam: float) -> Float64:
    """Return the distance across an edge from a last sample to the next one, m.

    Scan lines have a distance of `spacing`, and samples a distance of `beam` across the edge.
    `cosine` is that of the angle between the edge and the scan lines. If their direction is
    unknown, they are assumed to run around the robot: then it is that of the angle between the ray
    and the outward direction.
    """
    lines = spacing * np.abs(cosine)
    return np.asarray(lines + beam * np.sqrt(np.maximum(1.0 - cosine**2, 0.0)), np.float64)
