"""Where to put the words of a picture, so that none covers another.

This is our own because adjustText 1.4 was tried on map.png and map3d.png of bags/flat and was
slower and worse. It stops on a clock by default (1 s), so that two runs drew different pictures;
stopped after 200 steps instead, with the same points to keep clear of, it took minutes for
map.png where `place_labels` takes 0.5 s (27 labels, 3,057 points), and names of shelves one above
the other still covered each other: words with one anchor are not pushed apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import Point, Polygon
from shapely.ops import polylabel

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.results.models import SurfaceEntry

__all__ = ["LabelRequest", "label_point", "place_labels"]

DIRECTIONS = 16
RINGS = 14
COVER_LABEL = 1e4
"""Cost of covering a whole label: more than any other, so that it happens only when it must."""

COVER_POINT = 6.0
"""Cost of covering one obstacle point."""

OUTSIDE = 1e6
MARGIN = 3.0
"""Pixels left free around a label."""

POLE_TOLERANCE = 0.01
"""How exactly the innermost point of an outline is wanted, m."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelRequest:
    """A label that wants to be at `anchor`, float64 (2,), with `size` (2,); pixels."""

    anchor: Float64
    size: Float64


def label_point(surface: SurfaceEntry) -> Float64:
    """Return where a surface's name belongs, float64 (3,), m: its centroid, or well inside it."""
    ring = Polygon(
        surface.boundary[:, :2], [hole[:, :2] for hole in surface.holes if len(hole) > 2]
    )
    if not ring.is_valid or ring.is_empty:
        return surface.centroid
    inner = polylabel(ring, POLE_TOLERANCE)
    middle = Point(surface.centroid[:2])
    room = inner.distance(ring.boundary)
    if ring.contains(middle) and middle.distance(ring.boundary) > 0.6 * room:
        return surface.centroid
    return np.array([inner.x, inner.y, surface.centroid[2]])


def place_labels(
    requests: Sequence[LabelRequest],
    canvas: Float64,
    obstacles: Float64,
) -> Float64:
    """Place labels near their anchors, greedily in the order given.

    Parameters
    ----------
    requests
        The labels, the most important first.
    canvas
        float64 (2, 2), lower and upper corner of where labels may be, pixels.
    obstacles
        float64 (M, 2), points that labels should rather not cover (walls, outlines), pixels.

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
        boxes += np.array([-0.5, 0.5])[:, None] * (request.size + 2 * MARGIN)
        cost = cost + OUTSIDE * _outside(boxes, canvas) + COVER_LABEL * _overlap(boxes, placed)
        cost = cost + COVER_POINT * _covered(boxes, obstacles)
        best = int(np.argmin(np.round(cost, 6)))
        centers[index] = candidates[best]
        placed = np.concatenate([placed, boxes[best : best + 1]])
    return centers


def _candidates(request: LabelRequest) -> Float64:
    """Return the anchor, then rings of places around it, float64 (1 + rings * directions, 2)."""
    turns = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1) * (0.5 * request.size + MARGIN)
    rings = np.arange(1, RINGS + 1)[:, None, None] * 0.7
    return np.concatenate([request.anchor[None], (request.anchor + rings * circle).reshape(-1, 2)])


def _outside(boxes: Float64, canvas: Float64) -> Bool:
    return ((boxes[:, 0] < canvas[0]) | (boxes[:, 1] > canvas[1])).any(axis=1)


def _overlap(boxes: Float64, placed: Float64) -> Float64:
    """Return the share of each box that placed boxes cover, summed, float64 (K,)."""
    if len(placed) == 0:
        return np.zeros(len(boxes))
    low = np.maximum(boxes[:, None, 0], placed[None, :, 0])
    high = np.minimum(boxes[:, None, 1], placed[None, :, 1])
    area = np.prod(boxes[:, 1] - boxes[:, 0], axis=1)
    return np.prod(np.maximum(high - low, 0.0), axis=2).sum(axis=1) / area


def _covered(boxes: Float64, points: Float64) -> Int64:
    inside = (points >= boxes[:, None, 0]) & (points <= boxes[:, None, 1])
    return inside.all(axis=2).sum(axis=1)
