"""What of a simulated flat was in view, and how far from its true edges outlines end."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from tccm_ros.evaluate.surfaces import SurfaceScore
from tccm_ros.geometry import inverse, transform
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.records import EdgeState, Scan, Surface
from tccm_sim import truth
from tccm_sim.engine import EPOCH_NS, Simulation

Array = NDArray[np.float64]

THIN, NEAR = 0.02, 0.05
"""Beams' ends are thinned to this grid; a place this near to one was in view, m."""

LEVEL, INSET = 0.015, 0.02
"""A beam's end is on a surface this near to its height and this far inside its outline, m: what hit
its front, or the wall behind, did not see it."""

EDGE_IN_VIEW = 0.8
"""An edge was in view if beams' ends on the surface are `NEAR` this fraction of it."""

ABOVE, BESIDE, FLUSH = 0.005, 0.01, 0.001
"""A solid goes on beyond an edge where a beam down from `ABOVE` it and `BESIDE` it, m, ends at its
height within `FLUSH`."""


def true_hits(simulation: Simulation, scan: Scan) -> Array:
    """Return where the beams of a scan ended, float64 (N, 3) in map, thinned to `THIN`."""
    offsets = simulation.rig.tilt.offsets
    T_world_laser = simulation.sensor_poses(
        scan.frame_id, (scan.stamp_ns - EPOCH_NS) * 1e-9 + offsets
    )
    bearings, ranges = simulation.rig.tilt.bearings, np.nan_to_num(scan.ranges, posinf=0.0)
    ends = (
        np.stack([np.cos(bearings), np.sin(bearings), np.zeros_like(bearings)], 1) * ranges[:, None]
    )
    good = ranges > 0.3
    points = np.einsum("bij,bj->bi", T_world_laser[good, :3, :3], ends[good])
    points = transform(truth.map_from_world(simulation), points + T_world_laser[good, :3, 3])
    return np.unique(np.round(points / THIN), axis=0) * THIN


def seen_fraction(outline: Polygon, height: float, hits: Array) -> float:
    """Return which fraction of a true surface lies within `NEAR` of a beam's end on it."""
    x_min, y_min, x_max, y_max = outline.bounds
    chosen = np.abs(hits[:, 2] - height) <= LEVEL
    chosen &= (hits[:, 0] > x_min) & (hits[:, 0] < x_max)
    chosen &= (hits[:, 1] > y_min) & (hits[:, 1] < y_max)
    on = np.unique(hits[chosen, :2], axis=0)
    on = on[shapely.contains_xy(outline.buffer(-INSET), on[:, 0], on[:, 1])]
    if not len(on):
        return 0.0
    covered = shapely.union_all(shapely.buffer(shapely.points(on), NEAR, quad_segs=2))
    return float(covered.intersection(outline).area / outline.area)


def true_outlines(simulation: Simulation) -> list[Polygon]:
    """Return the outlines of the true surfaces but the floor, in the order of the score."""
    outlines = []
    for surface in truth.surfaces(simulation)["surfaces"]:
        if surface["label"] != "floor":
            rings = [[point[:2] for point in ring] for ring in surface["holes"]]
            outlines.append(Polygon([point[:2] for point in surface["boundary"]], rings))
    return outlines


def edge_errors(
    solution: SurfaceSolution, score: SurfaceScore, simulation: Simulation, hits: Array
) -> Array:
    """Return how far outside of a true edge the outline ends, and the finest spacing of its views.

    Straight edges that were in view, of surfaces that were found; float64 (N, 4), m, the third 1
    where another solid goes on at the same height, as the sides of shelves beside their top board:
    what is there to be seen ends further out. The fourth is 1 where the map says that the edge was
    seen.
    """
    rows = []
    found = {s.id: k for k, s in enumerate(solution.surfaces)}
    for match, outline in zip(score.matches, true_outlines(simulation)):
        if not match.is_found or match.found is None or match.area < 0.1:
            continue
        k = found[match.found]
        surface, members = solution.surfaces[k], solution.mapped.members[k]
        polygon = Polygon(surface.boundary[:, :2], [hole[:, :2] for hole in surface.holes])
        spacing = min(m.patch.spacing for m in members if m.patch.spacing > 0.0)
        on = hits[np.abs(hits[:, 2] - match.height) <= LEVEL, :2]
        on = on[shapely.contains_xy(outline.buffer(-INSET), on[:, 0], on[:, 1])]
        near = shapely.MultiPoint(on).buffer(NEAR)
        ring = shapely.geometry.polygon.orient(outline, 1.0).exterior
        for start, end in pairwise(np.asarray(ring.coords)):
            error = _edge_error(start, end, polygon, near)
            if error is not None:
                is_flush = goes_on(simulation, start, end, match.height)
                rows.append((error, spacing, is_flush, says_seen(surface, 0.5 * (start + end))))
    return np.array(rows, np.float64).reshape(-1, 4)


def says_seen(surface: Surface, at: Array) -> bool:
    """Return whether the edge of a surface that is nearest to a place in map was seen."""
    lines = [shapely.LineString([edge.start[:2], edge.end[:2]]) for edge in surface.edges]
    nearest = int(np.argmin(shapely.distance(lines, shapely.Point(at))))
    return surface.edges[nearest].state is EdgeState.SEEN


def goes_on(simulation: Simulation, start: Array, end: Array, height: float) -> bool:
    """Return whether a solid goes on at the same height beyond most of an edge in map."""
    along = (end - start) / np.hypot(*(end - start))
    beside = start + np.linspace(0.1, 0.9, 9)[:, None] * (end - start)
    beside += BESIDE * np.array([along[1], -along[0]])
    points = np.column_stack([beside, np.full(len(beside), height + ABOVE)])
    origins = transform(inverse(truth.map_from_world(simulation)), points)
    down = np.tile([0.0, 0.0, -1.0], (len(origins), 1))
    ranges, _ = simulation.scene.cast(origins, down, np.zeros(len(origins)), 1.0)
    return bool((np.abs(ranges - ABOVE) <= FLUSH).mean() > 0.5)


def _edge_error(start: Array, end: Array, found: Polygon, near: shapely.Geometry) -> float | None:
    """Return the median of how far outside of an edge an outline ends, m; None: not in view."""
    length = float(np.hypot(*(end - start)))
    if length < 0.2:
        return None
    along = (end - start) / length
    outward = np.array([along[1], -along[0]])
    places = start + np.linspace(0.1, 0.9, 17)[:, None] * (end - start)
    if shapely.contains_xy(near, *(places - INSET * outward).T).mean() < EDGE_IN_VIEW:
        return None
    ends = []
    for place in places:
        ray = shapely.LineString([place - 0.25 * outward, place + 0.15 * outward])
        hit = np.concatenate(
            [np.zeros((0, 2)), *(np.asarray(g.coords) for g in shapely.get_parts(found & ray))]
        )
        ends.append(((hit - place) @ outward).max(initial=-0.25))
    return float(np.median(ends))
