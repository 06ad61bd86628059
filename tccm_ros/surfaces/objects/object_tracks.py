"""Object tracks: objects on surfaces keep their ids while newer views measure them again.

Objects are numbered over all views in stamp order, and the id of a track is the number of its
oldest one. So ids follow from the views alone, like those of surfaces (`track_ids`). An object that
a view does not measure stays, as it may be occluded or out of view. It is removed once enough views
have looked through it. It is a false detection if enough views looked just above it without
measuring it. Detections at its position give its class.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform, transform_plan
from tccm_ros.robust import MAJORITY
from tccm_ros.surfaces.object_labels import MAX_GAP, ClassScores, distance_to_box
from tccm_ros.surfaces.objects.object_footprints import joined_footprint, without_noise
from tccm_ros.surfaces.views.views import SeenObject, View, with_detections
from tccm_ros.tabletop.free_places import rectangle_corners
from tccm_ros.tabletop.round_objects import PlanShape, plan_shape

INNER = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]) * 0.25
"""Points of a footprint, in edge lengths, that must all be free if the object is gone: the columns
of a view are as wide as a cup, and beams pass beside one. Chosen."""

ABOVE = 0.05
"""A view that looks through the space this far above an object would measure it, m; chosen."""


@dataclass(slots=True, eq=False)
class ObjectTrack:
    """State of an object after the views processed so far.

    Attributes
    ----------
    id
        Number of its oldest box.
    hull
        float64 (H, 2), convex hull of its footprints, without corners that a newer view looked
        through; in map, m.
    low, high
        Heights of its lower and upper end, m.
    points
        Number of points on it in the view that measured it last.
    first_seen_ns, last_seen_ns
        Stamps of the first and the last view that measured it.
    views
        Number of views that measured it.
    measured_by
        Keys of those of these views that are kept: stamps of two sessions may be equal. Empty at
        the end.
    misses
        Number of views that looked through it since the last view that measured it.
    over
        Number of views that looked just above it without measuring it; counted at the end.
    scores
        Class scores of its detections.
    shape
        Smallest rectangle or circle of the hull.
    center, size
        Centre of its box in map, and edges along its own x, y and z, float64 (3,), m.
    footprint
        Its box seen from above, in map, m.
    """

    id: int
    hull: Float64
    low: float
    high: float
    points: int
    first_seen_ns: int
    last_seen_ns: int
    views: int
    measured_by: frozenset[tuple[int, int]] = frozenset()
    misses: int = 0
    over: int = 0
    scores: ClassScores = field(default_factory=ClassScores)
    shape: PlanShape = field(init=False)
    center: Float64 = field(init=False)
    size: Float64 = field(init=False)
    footprint: Polygon = field(init=False)

    def __post_init__(self) -> None:
        self.shape = plan_shape(self.hull)
        x, y, length, width, yaw, _ = self.shape
        self.center = np.array([x, y, 0.5 * (self.low + self.high)])
        self.size = np.array([length, width, self.high - self.low])
        self.footprint = Polygon(rectangle_corners(length, width, yaw) + self.center[:2])


def nearest_pairs(first: Float64, second: Float64, max_distance: float) -> list[tuple[int, int]]:
    """Return pairs of points, the nearest first; each point is in at most one pair.

    Parameters
    ----------
    first, second
        float64 (N, 3) and (M, 3), m.
    max_distance
        Max distance of the two points of a pair, m.
    """
    if not len(first) or not len(second):
        return []
    distances = np.linalg.norm(first[:, None] - second[None], axis=2)
    return list(_nearest_first(distances, distances <= max_distance).items())


def _nearest_first(distances: Float64, allowed: Bool) -> dict[int, int]:
    """Associate rows with columns one to one, the nearest allowed pairs (N, M) first."""
    rows, columns = np.nonzero(allowed)
    order = np.lexsort((columns, rows, distances[rows, columns]))
    matched: dict[int, int] = {}
    for i, j in zip(rows[order].tolist(), columns[order].tolist()):
        if i not in matched and j not in matched.values():
            matched[i] = j
    return matched


def with_objects_of(newer: View, older: View, config: Config) -> View:
    """Return the newer of two views at one pose with the older view's object numbers and stamps.

    Parameters
    ----------
    newer, older
        Two successive views; the older one will be removed.
    config
        Uses `objects.track_distance`.
    """
    objects = list(newer.objects)
    for i, j in nearest_pairs(
        _centers(older.objects), _centers(objects), config.objects.track_distance
    ):
        old, own = older.objects[i], objects[j]
        number = (i if old.number is None else old.number) - len(older.objects)
        seen_ns = older.stamp_ns if old.first_seen_ns is None else old.first_seen_ns
        objects[j] = replace(own, number=number, first_seen_ns=seen_ns, views=old.views + own.views)
    forgotten = newer.forgotten_objects + older.forgotten_objects + len(older.objects)
    kept = replace(newer, objects=tuple(objects), forgotten_objects=forgotten)
    return with_detections(kept, older.detections) if older.detections else kept


def _centers(objects: Sequence[SeenObject]) -> Float64:
    return np.array(
        [(*plan_shape(o.footprint)[:2], 0.5 * (o.low + o.high)) for o in objects]
    ).reshape(-1, 3)


class TrackedObjects(NamedTuple):
    """The objects of all views.

    Attributes
    ----------
    tracks
        Objects that are present after the last view, by id.
    unused_detections
        Number of detections without an object at their position.
    known
        All tracks after the last view, including false detections.
    boxes
        Number of boxes of all views.
    """

    tracks: tuple[ObjectTrack, ...] = ()
    unused_detections: int = 0
    known: tuple[ObjectTrack, ...] = ()
    boxes: int = 0


NO_OBJECTS = TrackedObjects()


def track_objects(
    views: Sequence[View],
    T_map_view: Float64,
    config: Config,
    before: TrackedObjects = NO_OBJECTS,
) -> TrackedObjects:
    """Return the objects that are present after the last view.

    Noise and parts of furniture are measured once although many views look there; such boxes are
    discarded.

    Parameters
    ----------
    views
        Views in the order of sessions and stamps.
    T_map_view
        float64 (V, 4, 4), their poses.
    config
        Uses `objects.track_distance` and `objects.agreeing_views`.
    before
        The objects of the views before these.
    """
    known = [_copied(track) for track in before.known]
    after, unused = before.boxes, before.unused_detections
    for view, T in zip(views, T_map_view):
        first = after + view.forgotten_objects
        after = first + len(view.objects)
        known = _update(known, view, T, first, config)
        unused += _take_detections(known, view, T)
    for track, count in zip(known, _views_over(known, views, T_map_view)):
        track.over += int(count)
        track.measured_by = frozenset()
    needed = config.objects.agreeing_views
    tracks = [track for track in known if track.over < needed * track.views]
    tracks.sort(key=lambda track: track.id)
    return TrackedObjects(tuple(tracks), unused, tuple(known), after)


def _copied(track: ObjectTrack) -> ObjectTrack:
    copied = copy(track)
    copied.scores = replace(track.scores, total=dict(track.scores.total))
    return copied


def _views_over(tracks: Sequence[ObjectTrack], views: Sequence[View], T_map_view: Float64) -> Int64:
    """Return the number of views that looked just above each object without measuring it.

    Views that looked through the object itself are not counted: they saw the place without it.

    Returns
    -------
    int64 (N,)
    """
    count = np.zeros(len(tracks), np.int64)
    centers = np.array([track.center for track in tracks]).reshape(-1, 3)
    tops = centers.copy()
    tops[:, 2] += [0.5 * track.size[2] + ABOVE for track in tracks]
    for view, T in zip(views if len(tracks) else (), T_map_view):
        T_view_map = inverse(T)
        over = view.free.contains(transform(T_view_map, tops))
        over &= ~view.free.contains(transform(T_view_map, centers))
        count += over & [view.key not in track.measured_by for track in tracks]
    return count


def _take_detections(tracks: Sequence[ObjectTrack], view: View, T: Float64) -> int:
    """Associate each detection of a view with the nearest object; return the number without one."""
    unused = 0
    for seen in view.detections:
        center = transform(T, seen.center[None])[0]
        distances = [
            (
                distance_to_box(center, track.center, track.size, track.shape.yaw),
                np.linalg.norm(center - track.center),
                k,
            )
            for k, track in enumerate(tracks)
        ]
        gap, _, nearest = min(distances, default=(np.inf, np.inf, -1))
        if gap <= MAX_GAP:
            tracks[nearest].scores.add(seen.scores, seen.count)
        else:
            unused += seen.count
    return unused


def _update(
    known: list[ObjectTrack], view: View, T: Float64, first: int, config: Config
) -> list[ObjectTrack]:
    """Return the tracks after a view; `first` is the number of the view's first box."""
    if not known and not view.objects:
        return known
    seen = [_seen(item, k, view, T, first, config) for k, item in enumerate(view.objects)]
    matched = _matches(known, seen, config)
    kept = [track for i, track in enumerate(known) if i not in matched]
    _note_looked_through(kept, view, T)
    for j, new in enumerate(seen):
        same = [known[i] for i, k in matched.items() if k == j]
        if same:
            others = [other.hull for other in seen if other is not new]
            new = _combined(same, new, others, view, T, config.map.cell_size)
        kept.append(new)
    needed = config.objects.agreeing_views
    return [track for track in kept if track.misses < min(track.views, needed)]


def _seen(
    item: SeenObject, index: int, view: View, T: Float64, first: int, config: Config
) -> ObjectTrack:
    """Return an object of a view as a new track; `first` is the number of the first one."""
    hull, middle = item.footprint, 0.5 * (item.low + item.high)
    plan = transform_plan(T, hull, middle)
    z = float(transform(T, np.array([[*hull.mean(axis=0), middle]]))[0, 2])
    half = 0.5 * (item.high - item.low)
    return ObjectTrack(
        id=first + (index if item.number is None else item.number),
        hull=without_noise(plan, z, view, T, config),
        low=z - half,
        high=z + half,
        points=item.points,
        first_seen_ns=view.stamp_ns if item.first_seen_ns is None else item.first_seen_ns,
        last_seen_ns=view.stamp_ns,
        views=item.views,
        measured_by=frozenset({view.key}),
    )


def _matches(
    known: Sequence[ObjectTrack], seen: Sequence[ObjectTrack], config: Config
) -> dict[int, int]:
    """Associate known objects with the boxes of a view; return the box index by object index.

    Nearest pairs come first, one to one. Views from two sides measure two sides of an object: boxes
    that overlap, or are nearer to each other than objects are, belong to one object. A known object
    that is inside a box of the view is part of it.
    """
    if not known or not seen:
        return {}
    distances = np.linalg.norm(
        np.array([k.center for k in known])[:, None] - np.array([s.center for s in seen]), axis=2
    )
    first, second = _footprints(known), _footprints(seen)
    gaps = shapely.distance(first[:, None], second)
    overlaps = shapely.area(shapely.intersection(first[:, None], second))
    smaller = np.minimum(shapely.area(first)[:, None], shapely.area(second))
    are_level = _overlap_in_height(known, seen)
    near = (gaps <= config.objects.cluster_distance) & are_level
    matched = _nearest_first(distances, near | (distances <= config.objects.track_distance))
    inside = are_level & (overlaps > MAJORITY * smaller)
    for i in np.flatnonzero(inside.any(axis=1)).tolist():
        matched.setdefault(i, int(np.argmax(np.where(inside[i], overlaps[i], -1.0))))
    return matched


def _overlap_in_height(first: Sequence[ObjectTrack], second: Sequence[ObjectTrack]) -> Bool:
    low, high = np.array([(t.low, t.high) for t in first]).T[:, :, None]
    other_low, other_high = np.array([(t.low, t.high) for t in second]).T
    return np.asarray((low <= other_high) & (other_low <= high))


def _footprints(tracks: Sequence[ObjectTrack]) -> NDArray[Any]:
    """Return the footprints of objects, in map."""
    return np.array([track.footprint for track in tracks], dtype=object)


def _combined(
    same: Sequence[ObjectTrack],
    new: ObjectTrack,
    others: Sequence[Float64],
    view: View,
    T: Float64,
    spacing: float,
) -> ObjectTrack:
    """Merge the tracks of one object with that of a view that measured it again."""
    middle = 0.5 * (new.low + new.high)
    scores = ClassScores()
    for track in same:
        scores.add(track.scores.total, track.scores.count)
    return replace(
        new,
        id=min(new.id, *(track.id for track in same)),
        first_seen_ns=min(new.first_seen_ns, *(track.first_seen_ns for track in same)),
        hull=joined_footprint([t.hull for t in same], new.hull, others, middle, view, T, spacing),
        high=max([new.high, *(t.high for t in same if not _is_lower(t, new.high, view, T))]),
        views=new.views + max(track.views for track in same),
        measured_by=new.measured_by.union(*(track.measured_by for track in same)),
        over=max(track.over for track in same),
        scores=scores,
    )


def _is_lower(track: ObjectTrack, top: float, view: View, T: Float64) -> bool:
    """Return whether a view looked through what an object has above a height in map, m."""
    return bool(_looked_through([track], np.array([0.5 * (top + track.high)]), view, T)[0])


def _note_looked_through(tracks: Sequence[ObjectTrack], view: View, T: Float64) -> None:
    """Count a miss for each object that a view looked through."""
    if not tracks:
        return
    middles = np.array([0.5 * (track.low + track.high) for track in tracks])
    for track, is_seen in zip(tracks, _looked_through(tracks, middles, view, T)):
        track.misses += bool(is_seen)


def _looked_through(
    tracks: Sequence[ObjectTrack], heights: Float64, view: View, T: Float64
) -> Bool:
    """Return whether a view looked through each object (N > 0) at a height (N,), m, bool (N,)."""
    points = np.empty((len(tracks), len(INNER), 3))
    for k, track in enumerate(tracks):
        c, s = math.cos(track.shape.yaw), math.sin(track.shape.yaw)
        sides = np.array([[c, s], [-s, c]]) * track.size[:2, None]
        points[k, :, :2] = track.center[:2] + INNER @ sides
        points[k, :, 2] = heights[k]
    seen = view.free.contains(transform(inverse(T), points.reshape(-1, 3)))
    return np.asarray(seen.reshape(len(tracks), len(INNER)).all(axis=1), bool)
