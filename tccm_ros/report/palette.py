"""Colours that stay distinct for colour-blind readers, on paper and on screens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.results.models import SurfaceEntry

PALETTE = (
    "#0072b2",
    "#e69f00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#d55e00",
    "#999933",
    "#882255",
    "#44aa99",
    "#ddcc77",
    "#332288",
    "#aa4499",
)
"""Okabe and Ito's colours, then those of Tol's muted palette that differ enough from them."""

FLOOR = "#eef0f2"
WALL = "#3a3f47"
PATH = "#7a828c"
VIEW = "#1f2328"
OBJECT = "#5b4636"
TRUTH = "#111111"
LANDMARK = "#a0257a"
ROOM = "#c79ab8"

WORLD = {"wall": WALL, "path": PATH, "view": VIEW, "object": OBJECT, "sign": LANDMARK}
"""Colours of the three-dimensional view, by kind."""


def color_by_id(identity: int, label: str = "") -> str:
    """Return the colour of a surface by its id, the same in every map; the floor is pale."""
    return FLOOR if label == "floor" else PALETTE[identity % len(PALETTE)]


def surface_colors(surfaces: Sequence[SurfaceEntry]) -> dict[int, str]:
    """Assign every surface a colour of `PALETTE`, with equal colours far from each other.

    In order of ids, each surface gets the colour whose nearest surface is farthest, the first of
    the palette among equals. The floor is pale.

    Parameters
    ----------
    surfaces
        Surfaces in any order; the result depends only on ids and centroids.

    Returns
    -------
    dict
        Surface id -> ``#rrggbb``.
    """
    colors: dict[int, str] = {}
    centroids: dict[str, list[Float64]] = {color: [] for color in PALETTE}
    for surface in sorted(surfaces, key=lambda s: s.id):
        if surface.is_floor:
            colors[surface.id] = FLOOR
            continue
        distance = {c: _min_distance(surface.centroid, seen) for c, seen in centroids.items()}
        best = max(PALETTE, key=lambda color: distance[color])
        centroids[best].append(surface.centroid)
        colors[surface.id] = best
    return colors


def _min_distance(point: Float64, others: Sequence[Float64]) -> float:
    return min((float(np.linalg.norm(point - other)) for other in others), default=np.inf)
