"""Parts that stand open before the front of a compartment: doors and drawers.

They are no surfaces and no objects of the map. Each is the smallest box around the ends of beams on
it, with vertical sides.
"""

from __future__ import annotations

import numpy as np
import shapely

from tccm_ros.geometry import inverse, spatial, transform
from tccm_ros.racks.compartment import Compartment, OpenPart
from tccm_ros.racks.faces import ON_FACE
from tccm_ros.racks.hits import Hits
from tccm_ros.records import HITS_CUBE
from tccm_ros.tabletop.footprints import cluster_footprints, convex_hull, rectangle

LINKED = 2.0 * HITS_CUBE
"""Maximum distance of neighbouring hits on one part, m: there may be an empty cube between them."""

MIN_HITS = 9
"""Minimum number of hits on a part; chosen: a part of 12 cm square has as many cubes, mixed pixels
at an edge have fewer."""


def open_parts(space: Compartment, hits: Hits, known: shapely.Geometry) -> tuple[OpenPart, ...]:
    """Return the parts before the front of a compartment, from left to right.

    Parameters
    ----------
    space
        The compartment.
    hits
        Hits near it.
    known
        Outlines of surfaces, seen from above in map, m: hits there are on them, or on objects.
    """
    local = transform(inverse(space.T_map_front), hits.ends)
    before = (local[:, 0] < -ON_FACE) & (local[:, 2] > HITS_CUBE) & (local[:, 2] < space.height)
    before &= ~shapely.intersects_xy(known, *hits.ends[:, :2].T)
    chosen = np.flatnonzero(before)
    members, starts = cluster_footprints(np.ascontiguousarray(local), chosen, LINKED)
    found = []
    for part in np.split(members, starts[1:-1]):
        hull = convex_hull(local[part, :2])
        is_before = np.abs(local[part, 1]).min(initial=np.inf) < 0.5 * space.width
        if len(part) < MIN_HITS or len(hull) < 3 or not is_before:
            continue
        x, y, length, width, yaw = rectangle(hull)
        low = float((local[part, 2] - hits.half[part]).min())
        high = float((local[part, 2] + hits.half[part]).max())
        T = spatial(np.array([x, y, yaw]), 0.5 * (low + high))
        found.append((-y, OpenPart(space.T_map_front @ T, np.array([length, width, high - low]))))
    return tuple(part for _, part in sorted(found, key=lambda item: item[0]))
