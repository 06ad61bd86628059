"""Objects on horizontal surfaces, and their ids from tilt cycle to tilt cycle."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.planes import PlaneFits
from tccm_ros.records import PlaneKind, PlaneRecord, TabletopObject
from tccm_ros.tabletop.footprints import (
    LooseCuboids,
    cluster_footprints,
    convex_hull,
    cuboids_above,
    footprint_corners,
    loose_cuboids,
    rectangle,
)
from tccm_ros.tabletop.round_objects import plan_shape
from tccm_ros.tabletop.splitting import split_at_gaps, split_by_height

SURFACE_AREA = 0.12
"""A horizontal plane smaller than this, m2, may be the top of an object. Chosen: 35 cm square."""

WALL_AREA = 0.25
"""A vertical plane of this area, m2, is a wall or a piece of furniture, not a side of an object.
Chosen: 50 cm square."""

SEAM = 0.06
"""Maximum distance between the top of a support and the surface that it carries, m. Chosen: a board
and its frame."""


def find_objects(
    cuboids: Cuboids,
    fits: PlaneFits,
    planes: Sequence[PlaneRecord],
    config: Config,
    labels: Int32 | None = None,
) -> list[TabletopObject]:
    """Return the objects on the horizontal planes of a map.

    A cluster higher than `objects.max_height` is no object but furniture, a wall or a person. A
    cluster that carries another surface (a table's leg, a seat's front) is no object either.

    Parameters
    ----------
    cuboids, fits
        The map and its planes.
    planes
        Result of `PlaneTracker.update(fits)`.
    config
        Group `objects`.
    labels
        int32 (N,), index in `fits` of the plane at each cuboid, -1 for none. By default those of
        the fits; needed where the planes were found in other cuboids.

    Returns
    -------
    list[TabletopObject]
        By plane, from the highest down, then by position. Ids count from 0; `ObjectTracker` assigns
        persistent ids.
    """
    horizontal = [p for p in planes if p.kind == PlaneKind.HORIZONTAL and len(p.boundary) >= 3]
    if not horizontal:
        return []
    labels, structure = fits.labels if labels is None else labels, _are_structure(fits)
    loose = loose_cuboids(cuboids.arrays, labels, structure)
    seen = cuboids.mean()[np.append(structure, False)[labels]]
    surfaces = _Surfaces(seen, config.objects.min_height)
    covers = [plane for plane in horizontal if plane.area > SURFACE_AREA]
    found: list[TabletopObject] = []
    # From the highest surface down: a box on a stove is assigned to the stove, not the counter.
    for plane in sorted(horizontal, key=lambda p: (-float(p.centroid[2]), p.id)):
        members, starts = _take_clusters(loose, plane, config)
        for k in np.flatnonzero(np.diff(starts)).tolist():
            cluster = members[starts[k] : starts[k + 1]]
            if loose.counts[cluster].sum() < config.objects.min_points:
                continue
            for part in _parts(loose, cluster, surfaces, plane, config):
                candidate = _object(loose, part, plane, config)
                if candidate is not None and not _carries(candidate, covers):
                    found.append(candidate)
    return [replace(item, id=index) for index, item in enumerate(found)]


def _take_clusters(loose: LooseCuboids, plane: PlaneRecord, config: Config) -> tuple[Int64, Int64]:
    """Return the clusters of free cuboids above a plane, within the convex hull of its outline.

    The cuboids are marked as not free. An object occludes the surface behind it and may so be in a
    notch of the outline; `_object` tests that it touches the outline.
    """
    hull = convex_hull(np.ascontiguousarray(plane.boundary[:, :2]))
    chosen = cuboids_above(loose, hull, plane.normal, plane.offset, config.objects.min_height)
    loose.is_free[chosen] = False
    return cluster_footprints(loose.mean, chosen, config.objects.cluster_distance)


class _Surfaces(NamedTuple):
    """Cuboids of surfaces and walls.

    Attributes
    ----------
    mean
        float64 (N, 3), means of their points, m.
    max_distance
        Maximum distance of a surface's cuboids from its plane, m.
    """

    mean: Float64
    max_distance: float

    def of(self, plane: PlaneRecord) -> Float64:
        """Return the means of a surface's cuboids seen from above, float64 (S, 2), m."""
        distance = np.abs(self.mean @ plane.normal - plane.offset)
        return np.asarray(self.mean[distance < self.max_distance, :2])


def _parts(
    loose: LooseCuboids, cluster: Int64, surfaces: _Surfaces, plane: PlaneRecord, config: Config
) -> Iterator[Int64]:
    """Yield the parts of a cluster between which the surface or a step in height is seen."""
    mean, max_length = loose.mean[cluster, :2], config.objects.max_height
    hull = convex_hull(mean)
    is_long = len(hull) > 2 and rectangle(hull)[2] > max_length  # few are
    surface = surfaces.of(plane) if is_long else np.zeros((0, 2))
    for part in split_at_gaps(mean, surface, loose.cell, max_length):
        yield from _split_by_height(loose, cluster[part], plane, config)


def _split_by_height(
    loose: LooseCuboids, cluster: Int64, plane: PlaneRecord, config: Config
) -> list[Int64]:
    """Return the parts of a cluster if each of them is an object, else the whole cluster."""
    gap = config.objects.cluster_distance
    parts = split_by_height(loose.mean[cluster, :2], loose.high[cluster, 2], loose.cell, gap)
    if len(parts) == 1:
        return [cluster]
    found = [cluster[part] for part in parts]
    are_objects = all(_object(loose, part, plane, config) is not None for part in found)
    return found if are_objects else [cluster]


def _are_structure(fits: PlaneFits) -> Bool:
    """Return which planes are surfaces and walls."""
    min_areas = {PlaneKind.HORIZONTAL: SURFACE_AREA, PlaneKind.ANY: WALL_AREA}
    return np.array([fit.area > min_areas[fit.kind] for fit in fits], np.bool_)


def _carries(item: TabletopObject, covers: Sequence[PlaneRecord]) -> bool:
    """Return whether an object touches a surface above it, and so carries it."""
    x, y, z = item.center.tolist()
    top = z + float(item.size[2]) / 2.0
    for plane in covers:
        nx, ny, nz = plane.normal.tolist()
        if (
            abs((plane.offset - nx * x - ny * y) / nz - top) < SEAM
            and plane.id != item.plane
            and _outline(plane).distance(shapely.Point(x, y)) < SEAM
        ):
            return True
    return False


def _outline(plane: PlaneRecord) -> shapely.Polygon:
    """Return the outline of a plane seen from above, without its holes."""
    return shapely.Polygon(plane.boundary[:, :2])


def _object(
    loose: LooseCuboids,
    cluster: Int64,
    plane: PlaneRecord,
    config: Config,
) -> TabletopObject | None:
    points = float(loose.counts[cluster].sum())
    if points < config.objects.min_points:
        return None
    hull = convex_hull(footprint_corners(loose.low, loose.high, cluster))
    if len(hull) < 3:
        return None
    x, y, length, width, yaw, is_round = plan_shape(hull)
    nx, ny, nz = plane.normal.tolist()
    floor = (plane.offset - nx * x - ny * y) / nz
    height = float(loose.high[cluster, 2].max()) - floor
    if height > config.objects.max_height:
        return None
    # A cluster with a gap above the surface, or that extends below it beside its edge, is not on
    # the surface.
    lift = float(loose.low[cluster, 2].min()) - floor
    if not -SEAM <= lift <= max(0.5 * height, config.objects.cluster_distance):
        return None
    if _outline(plane).distance(shapely.Polygon(hull)) > config.objects.cluster_distance:
        return None
    return TabletopObject(
        id=-1,
        plane=plane.id,
        center=np.array([x, y, floor + height / 2.0]),
        size=np.array([length, width, height]),
        yaw=yaw,
        footprint=hull,
        points=round(points),
        is_round=is_round,
    )


class ObjectTracker:
    """Assigns persistent ids to objects that move by less than a distance between tilt cycles.

    Attributes
    ----------
    config
        `objects.track_distance` is used, the maximum distance of the centers in two tilt cycles.
    """

    def __init__(self, config: Config) -> None:
        self._config = config.objects
        self._known: list[TabletopObject] = []
        self._next_id = 0

    def reset(self) -> None:
        """Remove all tracks; later ids continue."""
        self._known.clear()

    def update(self, objects: Sequence[TabletopObject]) -> list[TabletopObject]:
        """Return the objects with persistent ids; nearest pairs are matched first."""
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
        for i, item in enumerate(objects):
            if i not in ids:
                ids[i] = self._next_id
                self._next_id += 1
            result.append(replace(item, id=ids[i]))
        self._known = result
        return result
