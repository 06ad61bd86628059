"""Ends of the beams of several views, in map, without those on objects that were removed later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.geometry import transform
from tccm_ros.racks.compartment import SeenView

NEAR_BEAMS = 0.04
"""Maximum distance from a hit of newer beams that pass it, m: one cube of hits."""

MIN_BEAMS = 3
"""A hit is removed if this many nearest newer beams all passed it; chosen: one may be a mixed
pixel, or pass beside an edge."""

BEYOND = 0.08
"""Minimum distance behind a hit at which beams that passed it end, m; chosen: two cubes of hits."""

MAX_VIEWS = 30
"""Maximum number of views of a rack, those with the most hits; chosen: they cover every side of it,
and bound the time of a solution."""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Ends of beams in map.

    Attributes
    ----------
    ends, origins
        float64 (M, 3), middle of each hit, and position of the sensor that measured it, m.
    half
        float64 (M,), half the height of each, m.
    view
        int64 (M,), index of the view.
    """

    ends: Float64
    origins: Float64
    half: Float64
    view: Int64

    def chosen(self, keep: Bool) -> Hits:
        """Return the hits for which `keep`, bool (M,), is true."""
        return Hits(self.ends[keep], self.origins[keep], self.half[keep], self.view[keep])

    def without_removed(self) -> Hits:
        """Return the hits of the `MAX_VIEWS` best views, without those that newer beams passed."""
        views, counts = np.unique(self.view, return_counts=True)
        views = np.sort(views[np.argsort(-counts, kind="stable")[:MAX_VIEWS]])
        keep = np.isin(self.view, views)
        for v in views:
            older = np.flatnonzero(keep & (self.view < v))
            newer = np.flatnonzero(self.view == v)
            if len(older) and len(newer) >= MIN_BEAMS:
                keep[older[self._are_looked_through(older, newer)]] = False
        return self.chosen(keep)

    def _are_looked_through(self, older: Int64, newer: Int64) -> Bool:
        """Return which older hits are passed by the beams of a newer view, bool (len(older),)."""
        origin = self.origins[newer[0]]
        beams, away = self.ends[newer] - origin, self.ends[older] - origin
        ranges, distances = np.linalg.norm(beams, axis=1), np.linalg.norm(away, axis=1)
        near, k = cKDTree(beams / ranges[:, None]).query(
            away / distances[:, None],
            MIN_BEAMS,
            distance_upper_bound=NEAR_BEAMS / distances.min(),
        )
        is_near = near * distances[:, None] <= NEAR_BEAMS
        ended = np.append(ranges, np.inf)[k]
        return np.asarray((is_near & (ended >= distances[:, None] + BEYOND)).all(axis=1))


class HitsInMap:
    """Index of the hits of views by position.

    Parameters
    ----------
    views
        In order of time.
    """

    def __init__(self, views: Sequence[SeenView]):
        self._of_views = [_hits_of(view, k) for k, view in enumerate(views)]
        self._boxes = np.array(
            [shapely.box(*_bounds(hits.ends[:, :2])) for hits in self._of_views], dtype=object
        )

    def near(self, outline: shapely.Geometry, distance: float) -> Hits:
        """Return the hits within a distance, m, of the box around an outline, by view.

        Parameters
        ----------
        outline
            Outline seen from above, in map.
        distance
            Distance along x and y, m.
        """
        around = shapely.box(*outline.bounds).buffer(distance, join_style="mitre")
        low_x, low_y, high_x, high_y = around.bounds
        parts = []
        for k in np.flatnonzero(shapely.intersects(self._boxes, around)).tolist():
            x, y = self._of_views[k].ends[:, 0], self._of_views[k].ends[:, 1]
            inside = (x > low_x) & (x < high_x) & (y > low_y) & (y < high_y)
            parts.append(self._of_views[k].chosen(inside))
        none = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64)
        columns = zip(none, *((p.ends, p.origins, p.half, p.view) for p in parts))
        return Hits(*(np.concatenate(column) for column in columns))


def _hits_of(view: SeenView, index: int) -> Hits:
    """Return the hits of a view."""
    low, high = view.hits[:, 2], view.hits[:, 3]
    middle = np.column_stack([view.hits[:, :2], 0.5 * (low + high)])
    eye = transform(view.T_map_view, view.viewpoint[None])
    return Hits(
        transform(view.T_map_view, middle),
        np.repeat(eye, len(low), axis=0),
        0.5 * (high - low),
        np.full(len(low), index),
    )


def _bounds(points: Float64) -> Float64:
    """Return the bounding box of points (N, 2), float64 (4,); nan without points."""
    if not len(points):
        return np.full(4, np.nan)
    return np.concatenate([points.min(axis=0), points.max(axis=0)])
