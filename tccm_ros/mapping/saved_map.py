"""A saved map: arrays of walls and keyframes, and views with poses relative to keyframes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from tccm_ros.arrays import Float32, Float64, Int64
from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.errors import MapError
from tccm_ros.geometry import spatial
from tccm_ros.records import SensorKind
from tccm_ros.surfaces.labels.corrected_labels import label_to_give
from tccm_ros.surfaces.object_labels import SeenDetection
from tccm_ros.surfaces.polygons import polygons_of
from tccm_ros.surfaces.views.plane_errors import fit_covariance
from tccm_ros.surfaces.views.views import SeenObject, SurfacePatch, View
from tccm_ros.tabletop.free_places import rectangle_corners

Arrays = dict[str, NDArray[Any]]

ABSENT = np.iinfo(np.int64).min
"""Represents None in a saved array."""

UNKNOWN = np.full(3, np.nan)
"""Represents None in an array of positions."""

REMOVED = ("forgotten", "forgotten_objects")
"""Integers of a view that count its removed predecessors' rows."""

NUMBERS = ("number", "first_seen_ns", "placed_ns")
"""Integers of a patch that may be None."""


@dataclass(frozen=True, slots=True, eq=False)
class SavedView:
    """A view of a finished session.

    Attributes
    ----------
    view
        The view.
    keyframe
        Keyframe of its session that is nearest in time; -1: none.
    is_on_keyframe
        Whether its pose moves with that keyframe; else, without a level laser, it is fixed in map.
    T_anchor_view
        float64 (4, 4), pose in that keyframe (horizontal, at its planar pose), or in map.
    cov_z_roll_pitch
        float64 (3, 3), covariance of (z, roll, pitch).
    """

    view: View
    keyframe: int
    is_on_keyframe: bool
    T_anchor_view: Float64
    cov_z_roll_pitch: Float64


@dataclass(frozen=True, slots=True, eq=False)
class SavedMap:
    """A map that a later session continues.

    Attributes
    ----------
    walls
        `WallSlam.saved`: keyframes, walls and loops; empty without a level laser.
    views
        Views of all sessions.
    """

    walls: Mapping[str, NDArray[Any]]
    views: tuple[SavedView, ...]

    @property
    def keyframe_count(self) -> int:
        """Number of keyframes; 0 without a level laser."""
        return len(self.walls.get("keyframe_stamp_ns", ()))


def views_in_map(saved: SavedMap) -> tuple[SavedView, ...]:
    """Return the views of a saved map with fixed poses in map, independent of keyframes.

    Raises
    ------
    MapError
        If the saved walls are damaged.
    """
    if not saved.walls:
        return saved.views
    # `unpack_walls` would import the graph, which nodes that read maps do not load.
    try:
        T_map_keyframe = spatial(np.asarray(saved.walls["keyframe_pose"]).reshape(-1, 3))
    except (KeyError, ValueError) as error:
        raise MapError(f"saved wall map is damaged: {error}") from None
    return tuple(
        replace(v, is_on_keyframe=False, T_anchor_view=T_map_keyframe[v.keyframe] @ v.T_anchor_view)
        if v.is_on_keyframe
        else v
        for v in saved.views
    )


def pack_views(views: Sequence[View]) -> Arrays:
    """Return the arrays of views: concatenated rows of all views, and row counts."""
    patches = [patch for view in views for patch in view.patches]
    objects = [item for view in views for item in view.objects]
    outlines = [np.frombuffer(shapely.to_wkb(p.outline), np.uint8) for p in patches]
    counts = [_column(objects, name) for name in ("points", "number", "first_seen_ns", "views")]
    viewpoints = [UNKNOWN if v.viewpoint is None else v.viewpoint for v in views]
    return {
        **{name: _column(views, name) for name in ("stamp_ns", "session", *REMOVED)},
        "reach": np.array([v.max_range for v in views], float),
        **_counts(views, patches="patches", objects="objects", hits_of="hits"),
        "free": np.array([len(v.free.keys) for v in views], np.int64),
        "free_cell_size": np.array([v.free.cell_size for v in views], float),
        "free_keys": _joined([v.free.keys for v in views], np.int64),
        "free_low": _joined([v.free.low for v in views], float),
        "free_high": _joined([v.free.high for v in views], float),
        **_counts(patches, points_of="points"),
        "points": _joined([p.points for p in patches], np.float32, 3),
        "weights": _joined([p.weights for p in patches], np.int32),
        **{name: _column(patches, name) for name in ("count", *NUMBERS)},
        "spacing": np.array([p.spacing for p in patches], float),
        "mean": np.array([p.mean for p in patches], float).reshape(-1, 3),
        "cov": np.array([p.cov for p in patches], float).reshape(-1, 3, 3),
        "cov_plane": np.array([p.cov_plane for p in patches], float).reshape(-1, 3, 3),
        "systematic_parts": np.array([p.systematic.shape[1] for p in patches], np.int64),
        "systematic": _joined([p.systematic.T for p in patches], np.float64, 3),
        "outline_bytes": np.array([len(o) for o in outlines], np.int64),
        "outlines": _joined(outlines, np.uint8),
        **_counts(objects, footprints_of="footprint"),
        "footprints": _joined([o.footprint for o in objects], np.float64, 2),
        "object_z": np.array([(o.low, o.high) for o in objects], np.float64).reshape(-1, 2),
        "object_counts": np.stack(counts, axis=1),
        "viewpoints": np.array(viewpoints, float).reshape(-1, 3),
        "sensors": _column(views, "sensor"),
        "hits": _joined([v.hits for v in views], np.float32, 4),
        **_pack_detections(views),
        **_pack_corrections(views),
    }


def _column(items: Sequence[Any], name: str) -> Int64:
    """Return an integer attribute of each item, int64 (N,); `ABSENT` represents None."""
    values = [getattr(item, name) for item in items]
    return np.array([ABSENT if value is None else value for value in values], np.int64)


def _counts(items: Sequence[Any], **attributes: str) -> Arrays:
    """Return the number of rows of attributes of each item, by names of arrays."""
    return {
        name: np.array([len(getattr(item, attribute)) for item in items], np.int64)
        for name, attribute in attributes.items()
    }


def _pack_detections(views: Sequence[View]) -> Arrays:
    """Return the arrays of detections; no arrays without detections."""
    seen = [item for view in views for item in view.detections]
    if not seen:
        return {}
    names = [class_id.encode() for item in seen for class_id in item.scores]
    return {
        "detections": np.array([len(v.detections) for v in views], np.int64),
        "detection_centers": np.array([item.center for item in seen], np.float64),
        "detection_counts": np.array([item.count for item in seen], np.int64),
        "detection_classes": np.array([len(item.scores) for item in seen], np.int64),
        "detection_scores": np.array([s for item in seen for s in item.scores.values()], float),
        "detection_name_bytes": np.array([len(name) for name in names], np.int64),
        "detection_names": np.frombuffer(b"".join(names), np.uint8),
    }


def _pack_corrections(views: Sequence[View]) -> Arrays:
    """Return the arrays of user-supplied labels; no arrays without such labels."""
    given = [item for view in views for item in view.corrected_labels.items()]
    if not given:
        return {}
    names = [label.encode() for _, label in given]
    return {
        "corrections": np.array([len(v.corrected_labels) for v in views], np.int64),
        "correction_numbers": np.array([number for number, _ in given], np.int64),
        "correction_name_bytes": np.array([len(name) for name in names], np.int64),
        "correction_names": np.frombuffer(b"".join(names), np.uint8),
    }


def _joined(parts: Sequence[NDArray[Any]], dtype: Any, *shape: int) -> NDArray[Any]:
    return np.concatenate([np.zeros((0, *shape), dtype), *parts])


def unpack_views(arrays: Mapping[str, NDArray[Any]]) -> list[View]:
    """Return the views from the arrays of `pack_views`.

    Raises
    ------
    MapError
        If arrays are missing or inconsistent.
    """
    try:
        return _unpack(_upgraded(arrays))
    except KeyError as error:
        raise MapError(f"saved views have no array {error}") from None
    except (ValueError, IndexError, TypeError, shapely.errors.GEOSException) as error:
        raise MapError(f"saved views are damaged: {error}") from None


def _upgraded(a: Mapping[str, NDArray[Any]]) -> Arrays:
    """Return the arrays of a map with those that maps of older versions lack."""
    views, patches = len(a["stamp_ns"]), len(a["count"])
    added: Arrays = {
        **{name: np.zeros(views, np.int64) for name in (*REMOVED, "sensors", "objects", "hits_of")},
        "viewpoints": np.full((views, 3), np.nan),
        "hits": np.zeros((0, 4), np.float32),
        **{name: np.full(patches, ABSENT) for name in NUMBERS},
        "systematic": np.zeros((0, 3)),
        "systematic_parts": np.zeros(patches, np.int64),
        "object_counts": np.zeros((0, 4), np.int64),
        **_prisms(a.get("object_boxes", np.zeros((0, 7)))),
    }
    if "cov_plane" not in a:
        parts = zip(_split(a["points"], a["points_of"]), _split(a["weights"], a["points_of"]))
        added["cov_plane"] = np.array(
            [fit_covariance(p.astype(float), w.astype(float)) for p, w in parts]
        )
    return added | dict(a)


def _prisms(boxes: Float64) -> Arrays:
    """Return the arrays of prisms for the boxes of objects in maps of older versions."""
    boxes = boxes.reshape(-1, 7)
    half = 0.5 * boxes[:, 5]
    footprints = [box[:2] + rectangle_corners(box[3], box[4], box[6]) for box in boxes]
    return {
        "footprints": _joined(footprints, np.float64, 2),
        "footprints_of": np.full(len(boxes), 4),
        "object_z": np.column_stack([boxes[:, 2] - half, boxes[:, 2] + half]),
    }


def _unpack(a: Mapping[str, NDArray[Any]]) -> list[View]:
    patches = [
        SurfacePatch(
            points,
            weights,
            int(a["count"][k]),
            a["mean"][k],
            a["cov"][k],
            polygons_of(shapely.from_wkb(outline.tobytes())),
            float(a["spacing"][k]),
            cov_plane,
            systematic.T,
            *(_present(int(a[name][k])) for name in NUMBERS),
        )
        for k, (points, weights, outline, cov_plane, systematic) in enumerate(
            zip(
                _split(a["points"], a["points_of"]),
                _split(a["weights"], a["points_of"]),
                _split(a["outlines"], a["outline_bytes"]),
                a["cov_plane"].reshape(-1, 3, 3),
                _split(a["systematic"].reshape(-1, 3), a["systematic_parts"]),
                strict=True,
            )
        )
    ]
    free = zip(*(_split(a[f"free_{name}"], a["free"]) for name in ("keys", "low", "high")))
    first = np.concatenate([[0], np.cumsum(a["patches"])])
    if first[-1] != len(patches) or len(a["patches"]) != len(a["stamp_ns"]):
        raise ValueError(f"{len(patches)} patches, {first[-1]} expected")
    objects, detections, labels = _unpack_objects(a), _unpack_detections(a), _unpack_corrections(a)
    viewpoints, hits = a["viewpoints"].reshape(-1, 3), _unpack_hits(a)
    return [
        View(
            int(a["stamp_ns"][v]),
            tuple(patches[first[v] : first[v + 1]]),
            FreeColumns(float(a["free_cell_size"][v]), *columns),
            float(a["reach"][v]),
            int(a["session"][v]),
            int(a["forgotten"][v]),
            objects[v],
            int(a["forgotten_objects"][v]),
            detections[v],
            labels[v],
            viewpoints[v] if np.isfinite(viewpoints[v]).all() else None,
            SensorKind(int(a["sensors"][v])),
            hits[v],
        )
        for v, columns in enumerate(free)
    ]


def _unpack_hits(a: Mapping[str, NDArray[Any]]) -> list[Float32]:
    """Return the hits of the beams of each view."""
    hits = _split(a["hits"].reshape(-1, 4), a["hits_of"])
    if len(hits) != len(a["stamp_ns"]) or not np.isfinite(a["hits"]).all():
        raise ValueError(f"hits of {len(hits)} views, {len(a['stamp_ns'])} expected, all finite")
    return hits


def _unpack_objects(a: Mapping[str, NDArray[Any]]) -> list[tuple[SeenObject, ...]]:
    """Return the objects of each view."""
    counts, z = a["object_counts"].reshape(-1, 4), a["object_z"].reshape(-1, 2)
    footprints = _split(a["footprints"].reshape(-1, 2), a["footprints_of"])
    if min(map(len, footprints), default=3) < 3:
        raise ValueError("an object has a footprint of fewer than three corners")
    if not len(footprints) == len(z) == len(counts) or len(a["objects"]) != len(a["stamp_ns"]):
        raise ValueError(f"{len(footprints)} objects, {len(counts)} expected")
    if not (np.isfinite(z).all() and all(np.isfinite(ring).all() for ring in footprints)):
        raise ValueError("objects are not finite")
    objects = iter([_unpack_object(*parts) for parts in zip(footprints, z, counts)])
    return [tuple(itertools.islice(objects, count)) for count in a["objects"].tolist()]


def _unpack_object(footprint: Float64, z: Float64, numbers: Int64) -> SeenObject:
    points, number, first_seen_ns, views = numbers.tolist()
    low, high = z.tolist()
    return SeenObject(
        footprint, low, high, points, _present(number), _present(first_seen_ns), views
    )


def _unpack_detections(a: Mapping[str, NDArray[Any]]) -> list[tuple[SeenDetection, ...]]:
    """Return the detections of each view; empty if the map has no such arrays."""
    if "detections" not in a:
        return [()] * len(a["stamp_ns"])
    centers, scores = a["detection_centers"].reshape(-1, 3), a["detection_scores"]
    if len(a["detections"]) != len(a["stamp_ns"]) or len(centers) != len(a["detection_counts"]):
        raise ValueError(f"{len(centers)} detections, {len(a['detection_counts'])} expected")
    if not (np.isfinite(centers).all() and np.isfinite(scores).all()):
        raise ValueError("detections are not finite")
    names = _split(a["detection_names"], a["detection_name_bytes"])
    classes = [name.tobytes().decode() for name in names]
    pairs = list(zip(classes, scores.tolist(), strict=True))
    ends = np.cumsum(a["detection_classes"]).tolist()
    if (ends[-1] if ends else 0) != len(pairs):
        raise ValueError(f"{len(pairs)} classes of detections, {ends} expected")
    seen = [
        SeenDetection(center, dict(pairs[end - count : end]), number)
        for center, count, end, number in zip(
            centers,
            a["detection_classes"].tolist(),
            ends,
            a["detection_counts"].tolist(),
            strict=True,
        )
    ]
    last = np.cumsum(a["detections"]).tolist()
    if last[-1] != len(seen):
        raise ValueError(f"{len(seen)} detections, {last[-1]} expected")
    return [tuple(seen[b - n : b]) for n, b in zip(a["detections"].tolist(), last)]


def _unpack_corrections(a: Mapping[str, NDArray[Any]]) -> list[dict[int, str]]:
    """Return the user-supplied labels of each view; empty if the map has no such arrays."""
    if "corrections" not in a:
        return [{}] * len(a["stamp_ns"])
    names = _split(a["correction_names"], a["correction_name_bytes"])
    labels = [label_to_give(name.tobytes().decode()).value for name in names]
    numbers = _split(a["correction_numbers"], a["corrections"])
    if len(numbers) != len(a["stamp_ns"]) or len(labels) != len(a["correction_numbers"]):
        raise ValueError(f"{len(labels)} corrected labels, {len(a['correction_numbers'])} expected")
    given = iter(labels)
    return [dict(zip(own.tolist(), given)) for own in numbers]


def _present(value: int) -> int | None:
    """Return an optional entry."""
    return None if value == ABSENT else value


def _split(rows: NDArray[Any], counts: Int64) -> list[NDArray[Any]]:
    if int(counts.sum()) != len(rows):
        raise ValueError(f"{len(rows)} rows, {int(counts.sum())} expected")
    return np.split(rows, np.cumsum(counts)[:-1]) if len(counts) else []
