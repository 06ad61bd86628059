"""Where there is room on a surface to put something down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from tccm_ros.records import PlaneRecord, TabletopObject
from tccm_ros.tabletop.footprints import convex_hull, rectangle
from tccm_ros.tabletop.placement import where_fits

__all__ = ["FreePlaces", "find_free_places"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FreePlaces:
    """Where an object of `objects.place_size` fits on one surface.

    Attributes
    ----------
    plane
        PlaneRecord.id.
    polygons
        Rings float64 (N, 3), open, counter-clockwise from above, in the map's frame: the union of
        all places that the object can cover.
    """

    plane: int
    polygons: tuple[Array, ...]


def find_free_places(
    planes: Sequence[PlaneRecord],
    objects: Sequence[TabletopObject],
    size: tuple[float, float],
) -> list[FreePlaces]:
    """Find where a w x d object can be put down.

    Parameters
    ----------
    planes, objects
        Horizontal planes and what stands on them.
    size
        Width and depth of the object, m.

    Returns
    -------
    list[FreePlaces]
        One per horizontal plane, empty where there is no room. The object's sides are parallel to
        the smallest rectangle around the surface, either way round; for these two yaws the answer
        is exact.
    """
    result = []
    for plane in planes:
        if plane.kind != "horizontal" or len(plane.boundary) < 3:
            continue
        things = [Polygon(o.footprint) for o in objects if o.plane == plane.id]
        room = shapely.make_valid(Polygon(plane.boundary[:, :2], [h[:, :2] for h in plane.holes]))
        yaw = rectangle(convex_hull(plane.boundary[:, :2]))[4]
        region = where_fits(room.difference(shapely.union_all(things)), size, yaw)
        result.append(FreePlaces(plane.id, tuple(_lift(r, plane) for r in region)))
    return result


def _lift(ring: Array, plane: PlaneRecord) -> Array:
    nx, ny, nz = plane.normal
    z = (plane.offset - nx * ring[:, 0] - ny * ring[:, 1]) / nz
    return np.column_stack([ring, z])
