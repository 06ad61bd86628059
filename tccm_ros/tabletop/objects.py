"""What stands on a surface, and where there is room to put something down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, Cuboids
from tccm_ros.planes import PlaneFits
from tccm_ros.records import PlaneRecord, TabletopObject
from tccm_ros.tabletop.footprints import (
    clusters,
    convex_hull,
    corners_of,
    distance_to_ring,
    loose_spread,
    over,
    rectangle,
)

__all__ = ["ObjectTracker", "find_objects"]

Array = NDArray[np.float64]

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
    levels = [p for p in planes if p.kind == "horizontal" and len(p.boundary) >= 3]
    if not levels:
        return []
    loose = _Loose.of(cuboids, fits)
    covers = [plane for plane in levels if plane.area > SURFACE_AREA]
    found: list[TabletopObject] = []
    # From the highest surface down, so that a box on a stove stands on the stove, not the counter.
    for plane in sorted(levels, key=lambda p: (-float(p.centroid[2]), p.id)):
        members, starts = loose.take(plane, config)
        for k in np.flatnonzero(np.diff(starts)).tolist():
            thing = _object(loose, members[starts[k] : starts[k + 1]], plane, config)
            if thing is not None and not _carries(thing, covers):
                found.append(thing)
    return [replace(thing, id=index) for index, thing in enumerate(found)]


@dataclass(frozen=True, slots=True, eq=False)
class _Loose:
    """The cuboids of no surface and no wall, and where their points are, m.

    Things stand on surfaces and in front of walls: both are left out before clustering.
    """

    column: NDArray[np.int64]
    count: Array
    mean: Array
    low: Array
    high: Array
    free: NDArray[np.bool_]
    cell: float

    @classmethod
    def of(cls, cuboids: Cuboids, fits: PlaneFits) -> _Loose:
        c = cuboids
        index, mean, low, high = loose_spread(
            c.count, c.s, c.S, c.ix, c.iy, c.bottom, c.top, c.cell_size * TICKS_PER_M, TICK,
            fits.labels, _structure(fits),
        )  # fmt: skip
        free = np.ones(len(index), np.bool_)
        column = c.ix[index].astype(np.int64)
        return cls(column, c.count[index], mean, low, high, free, c.cell_size)

    def take(
        self, plane: PlaneRecord, config: Config
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return clusters of what is left over a plane: within the convex hull of its outline.

        A thing hides what is behind it, so its place may be a notch of the outline; `_object` asks
        that it touches the outline.
        """
        chosen = over(
            self.column, self.mean, self.high, self.free, self.cell,
            convex_hull(plane.boundary[:, :2]), plane.normal, plane.offset,
            config.objects.min_height,
        )  # fmt: skip
        self.free[chosen] = False
        return clusters(self.mean, chosen, config.objects.cluster_distance)


def _structure(fits: PlaneFits) -> NDArray[np.bool_]:
    """Tell which planes are surfaces and walls."""
    kept = [fit.area > (SURFACE_AREA if fit.kind == "horizontal" else WALL_AREA) for fit in fits]
    return np.array(kept, np.bool_)


def _carries(thing: TabletopObject, covers: Sequence[PlaneRecord]) -> bool:
    """Tell whether a thing reaches up to a surface over it."""
    x, y, z = thing.center.tolist()
    top = z + float(thing.size[2]) / 2.0
    for plane in covers:
        nx, ny, nz = plane.normal.tolist()
        if (
            abs((plane.offset - nx * x - ny * y) / nz - top) < SEAM
            and plane.id != thing.plane
            and distance_to_ring(thing.center[None, :2], plane.boundary[:, :2]) < SEAM
        ):
            return True
    return False


def _object(
    loose: _Loose, cluster: NDArray[np.int64], plane: PlaneRecord, config: Config
) -> TabletopObject | None:
    points = float(loose.count[cluster].sum())
    if points < config.objects.min_points:
        return None
    hull = convex_hull(corners_of(loose.low, loose.high, cluster))
    if len(hull) < 3:
        return None
    x, y, length, width, yaw = rectangle(hull)
    nx, ny, nz = plane.normal.tolist()
    floor = (plane.offset - nx * x - ny * y) / nz
    height = float(loose.high[cluster, 2].max()) - floor
    if height > config.objects.max_height:
        return None
    # What hangs in the air over the surface does not stand on it, nor what reaches down beside it.
    lift = float(loose.low[cluster, 2].min()) - floor
    if not -SEAM <= lift <= max(0.5 * height, config.objects.cluster_distance):
        return None
    if distance_to_ring(hull, plane.boundary[:, :2]) > config.objects.cluster_distance:
        return None
    return TabletopObject(
        id=-1,
        plane=plane.id,
        center=np.array([x, y, floor + height / 2.0]),
        size=np.array([length, width, height]),
        yaw=yaw,
        footprint=hull,
        points=round(points),
    )


class ObjectTracker:
    """Gives each object an id that stays while it stands within `objects.track_distance`."""

    def __init__(self, config: Config) -> None:
        self._config = config.objects
        self._known: list[TabletopObject] = []
        self._next_id = 0

    def update(self, objects: Sequence[TabletopObject]) -> list[TabletopObject]:
        """Return the objects with ids that stay; nearest pairs are matched first."""
        pairs = sorted(
            (math.dist(new.center, old.center), i, old.id)
            for i, new in enumerate(objects)
            for old in self._known
            if math.dist(new.center, old.center) <= self._config.track_distance
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
