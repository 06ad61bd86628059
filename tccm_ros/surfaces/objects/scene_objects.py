"""Objects on the surfaces of the map, and free places between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point, Polygon

from tccm_ros.arrays import Float64
from tccm_ros.records import Hypothesis, Surface
from tccm_ros.surfaces.objects.object_tracks import ObjectTrack
from tccm_ros.tabletop.free_places import rectangle_corners, where_fits
from tccm_ros.tabletop.round_objects import rectangle_around

MAX_HEIGHT_DIFFERENCE = 0.10
"""Max difference in height of an object's lower side and the surface of the map under it, m;
chosen."""

OUTLINE_MARGIN = 0.05
"""Max distance of an object's centre from the outline of the surface under it, m; chosen."""


PANEL = 0.10
"""Max measured depth of legs, sides and fronts of furniture, m; chosen: a leg of the thickest
tables. Objects under a table that are no part of it are deeper, as their tops are seen."""

FLUSH = 0.015
"""Max difference in height of a surface and the upper side of a part that extends up to it, m:
objects under a thin board are further below it. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """An object on a surface, in map: a vertical cylinder, or its bounding box.

    Attributes
    ----------
    id
        Id of the object, constant while it is present, and in saved maps.
    surface
        Id of the surface under it.
    center
        float64 (3,), m.
    size
        float64 (3,), edges along its own x, y and z, m.
    yaw
        Yaw of its x axis, in (-pi/2, pi/2], rad.
    points
        Number of points on it in the view that measured it last.
    first_seen_ns, last_seen_ns
        Stamps of the first and the last view that measured it.
    views
        Number of views that measured it.
    label
        Class given by detectors, with its mean score; None: no detections.
    is_round
        Whether it is a vertical cylinder, as wide as its box.
    """

    id: int
    surface: int
    center: Float64
    size: Float64
    yaw: float
    points: int = 0
    first_seen_ns: int = 0
    last_seen_ns: int = 0
    views: int = 1
    label: Hypothesis | None = None
    is_round: bool = False

    @property
    def class_id(self) -> str:
        """Class given by detectors; empty: none."""
        return "" if self.label is None else self.label.class_id

    @property
    def footprint(self) -> Polygon:
        """Its outline seen from above, in map, m."""
        if self.is_round:
            return Point(self.center[:2]).buffer(0.5 * float(self.size[0]))
        corners = rectangle_corners(float(self.size[0]), float(self.size[1]), self.yaw)
        return Polygon(corners + self.center[:2])


def scene_objects(
    surfaces: Sequence[Surface], tracks: Sequence[ObjectTrack]
) -> tuple[SceneObject, ...]:
    """Return the objects on surfaces, by surface and id.

    Parameters
    ----------
    surfaces
        Surfaces of the map.
    tracks
        Tracks of objects, in map.
    """
    if not tracks or not surfaces:
        return ()
    outlines = np.array([outline_of(surface) for surface in surfaces], dtype=object)
    middles = shapely.points([track.center[:2] for track in tracks])
    tree = shapely.STRtree(outlines)
    which, under = tree.query(middles, predicate="dwithin", distance=OUTLINE_MARGIN)
    nearest: dict[int, tuple[float, int]] = {}
    for k, s in zip(which.tolist(), under.tolist()):
        track, surface = tracks[k], surfaces[s]
        bottom = float(track.center[2] - 0.5 * track.size[2])
        distance = abs(float(surface.height_at(track.center[:2])) - bottom)
        if distance < MAX_HEIGHT_DIFFERENCE:
            nearest[k] = min(nearest.get(k, (np.inf, -1)), (distance, surface.id))
    found = [
        _scene_object(tracks[k], surface)
        for k, (_, surface) in nearest.items()
        if not _is_part(tracks[k], surface, surfaces, outlines)
    ]
    return tuple(sorted(found, key=lambda item: (item.surface, item.id)))


def _is_part(
    track: ObjectTrack,
    under: int,
    surfaces: Sequence[Surface],
    outlines: NDArray[Any],
) -> bool:
    """Return whether a box is a part of furniture whose top is another surface: a side, or a leg.

    A part on the floor is thin and under that surface. A side of an appliance on a worktop, such as
    a stove, is along the edge of the appliance's top and extends up to it. The top is larger than
    the box, which distinguishes a side from an object whose top was measured.

    Parameters
    ----------
    track
        The box.
    under
        Id of the surface under it.
    surfaces, outlines
        Surfaces of the map, and their outlines.
    """
    top, footprint = float(track.center[2] + 0.5 * track.size[2]), track.footprint
    is_thin = min(track.size[:2]) < PANEL
    on_floor = any(surface.id == under and surface.label == "floor" for surface in surfaces)
    for surface, outline in zip(surfaces, outlines):
        above = float(surface.height_at(track.center[:2])) - top
        if surface.id == under or above < -FLUSH or surface.label == "floor":
            continue
        if on_floor and is_thin and shapely.dwithin(outline, footprint.centroid, OUTLINE_MARGIN):
            return True
        is_small = footprint.intersection(outline).area < 0.5 * outline.area
        is_along = is_small and above <= FLUSH
        if is_along and outline.boundary.buffer(OUTLINE_MARGIN).contains(footprint):
            return True
    return False


def _scene_object(track: ObjectTrack, surface: int) -> SceneObject:
    return SceneObject(
        track.id, surface, track.center, track.size, track.shape.yaw, track.points,
        track.first_seen_ns, track.last_seen_ns, track.views, track.scores.label(),
        track.shape.is_round,
    )  # fmt: skip


def free_places(
    surfaces: Sequence[Surface], objects: Sequence[SceneObject], size: tuple[float, float]
) -> dict[int, list[Float64]]:
    """Return the areas on surfaces, except the floor, in which an item can be put down.

    Parameters
    ----------
    surfaces, objects
        Surfaces and objects of one solution.
    size
        Width and depth of the item, m; its sides are parallel to those of the smallest rectangle
        around the surface, in either order.

    Returns
    -------
    dict of int to list of float64 (N, 3)
        Outer rings of the area that the item can cover, in map, by id of the surface; surfaces
        without free places are left out.
    """
    occupied: dict[int, list[Polygon]] = {}
    for item in objects:
        occupied.setdefault(item.surface, []).append(item.footprint)
    found = {}
    for surface in surfaces:
        if surface.label == "floor":
            continue
        room = outline_of(surface) - shapely.union_all(occupied.get(surface.id, []))
        yaw = rectangle_around(surface.boundary)[4]
        rings = where_fits(room, size, yaw)
        if rings:
            found[surface.id] = [_lifted(ring, surface) for ring in rings]
    return found


def outline_of(surface: Surface) -> shapely.Geometry:
    """Return the outline of a surface with its holes, in x and y of map, m."""
    holes = [hole[:, :2] for hole in surface.holes]
    return shapely.make_valid(Polygon(surface.boundary[:, :2], holes))


def _lifted(ring: Float64, surface: Surface) -> Float64:
    return np.column_stack([ring, surface.height_at(ring)])
