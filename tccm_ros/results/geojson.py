"""Surfaces and walls as GeoJSON features, in m of the map frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.records import Surface, Wall
from tccm_ros.results.floor_plan import close_corners
from tccm_ros.results.numbers import Stamp


def feature_collection(
    surfaces: Sequence[Surface], walls: Sequence[Wall], frame_id: str
) -> dict[str, Any]:
    """Return surfaces as polygons with holes, and walls as a floor plan with closed corners.

    The coordinates are x, y, z in m in `frame_id`, not longitude and latitude; readers that need
    these must georeference the map. Rings are closed; outer rings are counter-clockwise and holes
    clockwise, as RFC 7946 requires.

    Parameters
    ----------
    surfaces, walls
        Surfaces and walls in the frame `frame_id`.
    frame_id
        Name of the map frame.
    """
    return {
        "type": "FeatureCollection",
        "frame_id": frame_id,
        "features": [_surface(s) for s in surfaces]
        + [_wall(wall, ends) for wall, ends in zip(walls, close_corners(walls))],
    }


def _surface(surface: Surface) -> dict[str, Any]:
    rings = [_closed(surface.boundary), *(_closed(hole) for hole in surface.holes)]
    return {
        "type": "Feature",
        "geometry": {"type": "Polygon", "coordinates": rings},
        "properties": {
            "kind": "surface",
            "id": surface.id,
            "label": surface.label,
            "confidence": surface.confidence,
            "height": surface.height,
            "area": surface.area,
            "first_seen": Stamp(surface.first_seen_ns),
            "last_seen": Stamp(surface.last_seen_ns),
        },
    }


def _wall(wall: Wall, ends: Float64) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": ends},
        "properties": {"kind": "wall", "id": wall.id, "observations": wall.observations},
    }


def _closed(ring: Float64) -> Float64:
    return np.concatenate([ring, ring[:1]])
