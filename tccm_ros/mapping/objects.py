"""What stands on a surface, and where there is room to put something down."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from shapely import Polygon

from tccm_ros.config import Config
from tccm_ros.mapping.cuboids import TICK, Cuboids
from tccm_ros.mapping.planes import PlaneFits
from tccm_ros.records import PlaneRecord, TabletopObject

__all__ = ["ObjectTracker", "find_objects", "smallest_rectangle"]

Array = NDArray[np.float64]

ROOT3 = math.sqrt(3.0)
"""Half the length of a uniform spread, in standard deviations."""

SURFACE_AREA = 0.12
"""A level plane smaller than this, m2, may be the top of an object."""

WALL_AREA = 0.25
"""A standing plane of this area, m2, is a wall or a piece of furniture, no side of an object."""

SEAM = 0.06
"""What ends this near below a surface, m, carries it."""


def find_objects(
    cuboids: Cuboids, fits: PlaneFits, planes: Sequence[PlaneRecord], config: Config
) -> list[TabletopObject]:
    """Find what stands on the horizontal planes of a map.

    An object ends below `objects.max_height`: what goes on upwards is furniture, a wall or a
    person. What carries another surface (a table's leg, a seat's front) is no object either.

    Parameters
    ----------
    cuboids, fits
        The map and its planes.
    planes
        What `PlaneTracker.update(fits)` returned.
    config
        Group `objects`.

    Returns
    -------
    list[TabletopObject]
        By plane, from the highest down, then by position. Ids count from 0; `ObjectTracker` makes
        them stay.
    """
    spread = _Spread.of(cuboids)
    # Things stand on surfaces and in front of walls: both are left out before clustering.
    loose = ~_structure(fits)[fits.labels]
    found: list[TabletopObject] = []
    levels = [p for p in planes if p.kind == "horizontal" and len(p.boundary) >= 3]
    covers = {
        plane.id: Polygon(plane.boundary[:, :2]).buffer(SEAM)
        for plane in levels
        if plane.area > SURFACE_AREA
    }
    # From the highest surface down, so that a box on a stove stands on the stove, not the counter.
    for plane in sorted(levels, key=lambda p: (-float(p.centroid[2]), p.id)):
        standing = _above(spread, loose, plane, config)
        for cluster in _clusters(spread, standing, config.objects.cluster_distance):
            thing = _object(cuboids, spread, cluster, plane, config)
            if thing is not None and not _carries(thing, levels, covers):
                found.append(thing)
            loose[cluster] = False
    return [replace(thing, id=index) for index, thing in enumerate(found)]


@dataclass(frozen=True, slots=True, eq=False)
class _Spread:
    """Where the points of each cuboid are: low and high corner, float64 (N, 3), m."""

    mean: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, cuboids: Cuboids) -> _Spread:
        mean = cuboids.mean()
        reach = ROOT3 * np.sqrt(np.maximum(cuboids.cov()[:, [0, 3, 5]], 0.0))
        low, high = mean - reach, mean + reach
        low[:, 2] = np.maximum(low[:, 2], cuboids.bottom * TICK)
        high[:, 2] = cuboids.top * TICK
        return cls(mean, low, high)


def _structure(fits: PlaneFits) -> NDArray[np.bool_]:
    """Tell which labels are surfaces and walls; the last entry is for no label (-1)."""
    kept = [fit.area > (SURFACE_AREA if fit.kind == "horizontal" else WALL_AREA) for fit in fits]
    return np.array([*kept, False], bool)


def _above(
    spread: _Spread, loose: NDArray[np.bool_], plane: PlaneRecord, config: Config
) -> NDArray[np.int64]:
    """Return the loose cuboids over a plane: within the convex hull of its outline.

    A thing hides what is behind it, so its place may be a notch of the outline; `_object` asks
    that it touches the outline.
    """
    x_low, y_low = plane.boundary[:, :2].min(axis=0)
    x_high, y_high = plane.boundary[:, :2].max(axis=0)
    x, y = spread.mean[:, 0], spread.mean[:, 1]
    near = np.flatnonzero(loose & (x >= x_low) & (x <= x_high) & (y >= y_low) & (y <= y_high))
    height = spread.high[near] @ plane.normal - plane.offset
    near = near[height >= config.objects.min_height]
    hull = shapely.convex_hull(Polygon(plane.boundary[:, :2]))
    shapely.prepare(hull)
    return near[shapely.contains_xy(hull, x[near], y[near])]


def _carries(
    thing: TabletopObject, levels: Sequence[PlaneRecord], covers: Mapping[int, Polygon]
) -> bool:
    """Tell whether a thing reaches up to a surface over it."""
    top = float(thing.center[2] + thing.size[2] / 2.0)
    at = shapely.Point(thing.center[:2])
    for plane in levels:
        nx, ny, nz = plane.normal
        z = (plane.offset - nx * thing.center[0] - ny * thing.center[1]) / nz
        near = plane.id != thing.plane and -SEAM < z - top < SEAM
        if near and plane.id in covers and covers[plane.id].contains(at):
            return True
    return False


def _clusters(spread: _Spread, chosen: NDArray[np.int64], gap: float) -> list[NDArray[np.int64]]:
    """Group cuboids whose footprints come within a gap of each other, by their first cuboid."""
    if len(chosen) == 0:
        return []
    pairs = cKDTree(spread.mean[chosen, :2]).query_pairs(gap, output_type="ndarray")
    n = len(chosen)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(chosen[order], np.cumsum(np.bincount(label, minlength=count))[:-1])


def _object(
    cuboids: Cuboids,
    spread: _Spread,
    cluster: NDArray[np.int64],
    plane: PlaneRecord,
    config: Config,
) -> TabletopObject | None:
    points = float(cuboids.count[cluster].sum())
    if points < config.objects.min_points:
        return None
    low, high = spread.low[cluster], spread.high[cluster]
    corners = np.concatenate(
        [np.stack([a[:, 0], b[:, 1]], axis=1) for a in (low, high) for b in (low, high)]
    )
    hull = shapely.convex_hull(shapely.multipoints(corners))
    if not isinstance(hull, Polygon):
        return None
    center, size, yaw = smallest_rectangle(hull)
    nx, ny, nz = plane.normal
    floor = (plane.offset - nx * center[0] - ny * center[1]) / nz
    height = float(high[:, 2].max()) - floor
    if height > config.objects.max_height:
        return None
    # What hangs in the air over the surface does not stand on it, nor what reaches down beside it.
    lift = float(low[:, 2].min()) - floor
    if not -SEAM <= lift <= max(0.5 * height, config.objects.cluster_distance):
        return None
    if hull.distance(Polygon(plane.boundary[:, :2])) > config.objects.cluster_distance:
        return None
    return TabletopObject(
        id=-1,
        plane=plane.id,
        center=np.array([*center, floor + height / 2.0]),
        size=np.array([*size, height]),
        yaw=yaw,
        footprint=np.asarray(hull.exterior.coords)[:0:-1],
        points=round(points),
    )


def smallest_rectangle(hull: Polygon) -> tuple[Array, Array, float]:
    """Return centre (2,), size (2,) and yaw of the smallest rectangle around a convex polygon."""
    ring = np.asarray(shapely.minimum_rotated_rectangle(hull).exterior.coords)
    sides = np.diff(ring, axis=0)[:2]
    lengths = np.linalg.norm(sides, axis=1)
    longer = int(lengths[1] > lengths[0])
    yaw = math.atan2(sides[longer, 1], sides[longer, 0])
    yaw = yaw - math.pi if yaw > math.pi / 2 else yaw + math.pi if yaw <= -math.pi / 2 else yaw
    return ring[:4].mean(axis=0), lengths[[longer, 1 - longer]], yaw


class ObjectTracker:
    """Gives each object an id that stays while it stands within `objects.track_distance`."""

    def __init__(self, config: Config) -> None:
        self._reach = config.objects.track_distance
        self._known: list[TabletopObject] = []
        self._next_id = 0

    def update(self, objects: Sequence[TabletopObject]) -> list[TabletopObject]:
        """Return the objects with ids that stay; nearest pairs are matched first."""
        pairs = sorted(
            (math.dist(new.center, old.center), i, old.id)
            for i, new in enumerate(objects)
            for old in self._known
            if math.dist(new.center, old.center) <= self._reach
        )
        ids: dict[int, int] = {}
        for _, i, old_id in pairs:
            if i not in ids and old_id not in ids.values():
                ids[i] = old_id
        result = []
        for i, thing in enumerate(objects):
            if i not in ids:
                ids[i] = self._next_id
                self._next_id += 1
            result.append(replace(thing, id=ids[i]))
        self._known = result
        return result
