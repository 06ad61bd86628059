"""Place the labels of a picture without overlaps.

adjustText 1.4 was slower and worse on map.png and map3d.png of bags/flat. By default it stops after
1 s of clock time, so that two runs drew different pictures. With 200 iterations instead and the
same obstacle points, it took minutes for map.png, compared with 0.5 s by `place_labels` (27 labels,
3,057 points), and the labels of stacked shelves still overlapped, because it does not separate
labels with the same anchor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import Point, Polygon
from shapely.ops import polylabel

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.results.models import SurfaceEntry

DIRECTIONS = 16
"""Candidates on each ring around an anchor; chosen."""

RINGS = 14
"""Rings of candidates; chosen."""

RING_STEP = 0.7
"""Distance between rings, in half sizes of the label; chosen."""

LABEL_COST = 1e4
"""Cost of covering a whole label, pixels; chosen: only where there is no other candidate."""

POINT_COST = 6.0
"""Cost of covering one obstacle point, pixels; chosen."""

OUTSIDE_COST = 1e6
"""Cost of leaving the picture, pixels; chosen: above all others."""

MARGIN_PX = 3.0
"""Free space around a label, pixels; chosen."""

POLE_TOLERANCE_M = 0.01
"""Tolerance of the innermost point of an outline, m; chosen."""

MIN_CENTROID_ROOM = 0.6
"""Minimum distance of the centroid from the outline, relative to the innermost point's, for a label
at the centroid; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelRequest:
    """A label to place.

    Attributes
    ----------
    anchor
        float64 (2,), desired centre, pixels.
    size
        float64 (2,), width and height, pixels.
    """

    anchor: Float64
    size: Float64


def label_point(surface: SurfaceEntry) -> Float64:
    """Return the point of a surface's label, float64 (3,), m: the centroid or a point inside."""
    ring = Polygon(
        surface.boundary[:, :2], [hole[:, :2] for hole in surface.holes if len(hole) > 2]
    )
    if not ring.is_valid or ring.is_empty:
        return surface.centroid
    inner = polylabel(ring, POLE_TOLERANCE_M)
    middle = Point(surface.centroid[:2])
    room = inner.distance(ring.boundary)
    if ring.contains(middle) and middle.distance(ring.boundary) > MIN_CENTROID_ROOM * room:
        return surface.centroid
    return np.array([inner.x, inner.y, surface.centroid[2]])


def place_labels(
    requests: Sequence[LabelRequest],
    canvas: Float64,
    obstacles: Float64,
) -> Float64:
    """Place labels near their anchors, greedily in the given order.

    Parameters
    ----------
    requests
        The labels, the most important first.
    canvas
        float64 (2, 2), lower and upper corner of the area for labels, pixels.
    obstacles
        float64 (M, 2), points that labels should not cover (walls, outlines), pixels.

    Returns
    -------
    float64 (N, 2)
        The centre of each label, pixels.
    """
    placed = np.zeros((0, 2, 2))
    centers = np.zeros((len(requests), 2))
    for index, request in enumerate(requests):
        candidates = _candidates(request)
        cost = np.hypot(*(candidates - request.anchor).T)
        boxes = np.stack([candidates, candidates], axis=1)
        boxes += np.array([-0.5, 0.5])[:, None] * (request.size + 2 * MARGIN_PX)
        cost = cost + OUTSIDE_COST * _outside(boxes, canvas) + LABEL_COST * _overlap(boxes, placed)
        cost = cost + POINT_COST * _covered(boxes, obstacles)
        best = int(np.argmin(np.round(cost, 6)))
        centers[index] = candidates[best]
        placed = np.concatenate([placed, boxes[best : best + 1]])
    return centers


def _candidates(request: LabelRequest) -> Float64:
    """Return the anchor, then rings of points around it, float64 (1 + rings * directions, 2)."""
    angles = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1) * (0.5 * request.size + MARGIN_PX)
    rings = np.arange(1, RINGS + 1)[:, None, None] * RING_STEP
    return np.concatenate([request.anchor[None], (request.anchor + rings * circle).reshape(-1, 2)])


def _outside(boxes: Float64, canvas: Float64) -> Bool:
    return ((boxes[:, 0] < canvas[0]) | (boxes[:, 1] > canvas[1])).any(axis=1)


def _overlap(boxes: Float64, placed: Float64) -> Float64:
    """Return the sum of the fractions of each box covered by placed boxes, float64 (K,)."""
    if len(placed) == 0:
        return np.zeros(len(boxes))
    low = np.maximum(boxes[:, None, 0], placed[None, :, 0])
    high = np.minimum(boxes[:, None, 1], placed[None, :, 1])
    area = np.prod(boxes[:, 1] - boxes[:, 0], axis=1)
    return np.prod(np.maximum(high - low, 0.0), axis=2).sum(axis=1) / area


def _covered(boxes: Float64, points: Float64) -> Int64:
    inside = (points >= boxes[:, None, 0]) & (points <= boxes[:, None, 1])
    return inside.all(axis=2).sum(axis=1)
