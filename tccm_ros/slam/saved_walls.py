"""Saved wall maps: conversion to named arrays and back."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64, Int64
from tccm_ros.errors import MapError
from tccm_ros.records import LandmarkObservation
from tccm_ros.signs.hog import PATCH_SHAPE
from tccm_ros.signs.measurement import SignMeasurement
from tccm_ros.slam.chain import AnchoredPose
from tccm_ros.slam.factors.landmarks import landmark_class
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.landmarks import AnchoredObservation
from tccm_ros.slam.loops.matching import Proposal
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.signs.views import SignView
from tccm_ros.slam.walls.lines import Lines

SIGN_NUMBERS: dict[str, tuple[type, tuple[int, ...]]] = {
    "pixel": (float, (2,)),
    "bearing": (float, (3,)),
    "T_base_camera": (float, (4, 4)),
    "corners": (float, (4, 2)),
    "plate": (float, (4, 3)),
    "stamp_ns": (np.int64, ()),
    "confidence": (float, ()),
    "focal_length": (float, ()),
    "patch": (np.uint8, PATCH_SHAPE),
}
"""Type and shape of each field of a sign measurement but its texts."""


class SavedWalls(NamedTuple):
    """Keyframes, lines, loop closures and landmark observations of a wall map.

    Attributes
    ----------
    keyframes, lines
        Keyframes of all sessions, and the lines of each.
    poses
        float64 (K, 3), optimised poses of the keyframes in map.
    loops
        The accepted loop closures.
    observations
        Landmark observations.
    sign_views
        Views of door signs, each with the sign's id.
    unjoined
        Value of `LoopCloser.unjoined`.
    """

    keyframes: Sequence[GraphKeyframe]
    lines: Sequence[Lines]
    poses: Float64
    loops: Sequence[Proposal]
    observations: Sequence[AnchoredObservation]
    sign_views: Sequence[SignView]
    unjoined: Mapping[int, int] = {}


def pack_walls(saved: SavedWalls) -> dict[str, NDArray[Any]]:
    """Return named arrays; scans and lines are concatenated, with counts per keyframe."""
    keyframes, lines, poses, loops, observations, sign_views, unjoined = saved
    scans = [k.scan for k in keyframes]
    return {
        "keyframe_stamp_ns": np.array([s.stamp_ns for s in scans], np.int64),
        "keyframe_session": np.array([k.session for k in keyframes], np.int64),
        "keyframe_pose": poses.reshape(-1, 3).copy(),
        "keyframe_front_pose": _rows([k.pose for k in keyframes], 3),
        "keyframe_delta": _rows([k.delta for k in keyframes], 3),
        "keyframe_cov": _rows([k.cov for k in keyframes], 3, 3),
        "keyframe_systematic": _rows([k.systematic for k in keyframes], 3),
        "keyframe_odom": _rows([s.odom for s in scans], 3),
        "scan_origin": _rows([s.origin for s in scans], 2),
        "scan_count": np.array([len(s.points) for s in scans], np.int64),
        # float32 has an error of 0.1 mm in a map of 1 km, less than the laser's noise.
        "scan_points": _joined([s.points for s in scans], 2).astype(np.float32),
        "scan_normals": _joined([s.normals for s in scans], 2).astype(np.float32),
        "line_count": np.array([len(x) for x in lines], np.int64),
        "line_phi_rho": _joined([np.stack([x.phi, x.rho], axis=1) for x in lines], 2),
        "line_cov": _joined([x.cov for x in lines], 2, 2),
        "line_endpoints": _joined([x.endpoints for x in lines], 2, 2),
        "line_beams": np.concatenate([np.zeros(0, np.int64), *[x.count for x in lines]]),
        "loop_keyframes": np.array([(p.a, p.b) for p in loops], np.int64).reshape(-1, 2),
        "loop_delta": _rows([p.delta for p in loops], 3),
        "loop_cov": _rows([p.cov for p in loops], 3, 3),
        "loop_quality": _rows([np.array([p.inliers, p.score, p.window]) for p in loops], 3),
        **_pack_landmarks(observations),
        **_pack_signs(sign_views),
        **({"unjoined_sessions": np.array(sorted(unjoined.items()), np.int64)} if unjoined else {}),
    }


def _pack_landmarks(observations: Sequence[AnchoredObservation]) -> dict[str, NDArray[Any]]:
    seen = [s.observation for s in observations]
    kinds = sorted({o.kind for o in seen})
    return {
        "landmark_kinds": np.frombuffer(json.dumps(kinds).encode(), np.uint8),
        "landmark_kind": np.array([kinds.index(o.kind) for o in seen], np.int64),
        "landmark_id": np.array([o.id for o in seen], np.int64),
        "landmark_stamp_ns": np.array([o.stamp_ns for o in seen], np.int64),
        **_pack_anchored("landmark", [s.anchored for s in observations]),
        "landmark_size": np.array([len(o.measurement) for o in seen], np.int64),
        "landmark_measurement": _joined([o.measurement for o in seen]),
        "landmark_cov": _joined([o.covariance.ravel() for o in seen]),
    }


def _pack_signs(views: Sequence[SignView]) -> dict[str, NDArray[Any]]:
    """Return named arrays with a row per view of a sign."""
    seen = [v.measurement for v in views]
    texts = json.dumps([[m.text, m.number] for m in seen]).encode()
    return {
        f"sign_{name}": np.array([getattr(m, name) for m in seen], dtype).reshape(-1, *shape)
        for name, (dtype, shape) in SIGN_NUMBERS.items()
    } | {
        "sign_id": np.array([v.sign for v in views], np.int64),
        **_pack_anchored("sign", [v.anchored for v in views]),
        "sign_texts": np.frombuffer(texts, np.uint8),
    }


def _pack_anchored(prefix: str, anchored: Sequence[AnchoredPose]) -> dict[str, NDArray[Any]]:
    """Return anchored poses as arrays with a prefix; no attitudes where all are level."""
    attitudes = np.array([a.attitude for a in anchored], float).reshape(-1, 3)
    return {
        f"{prefix}_keyframe": np.array([a.keyframe for a in anchored], np.int64),
        f"{prefix}_pose": np.array([a.pose for a in anchored], float).reshape(-1, 3),
        f"{prefix}_pose_cov": np.array([a.cov for a in anchored], float).reshape(-1, 3, 3),
        **({f"{prefix}_attitude": attitudes} if attitudes.any() else {}),
    }


def _rows(arrays: Sequence[Float64], *shape: int) -> Float64:
    return np.array(arrays, float).reshape(-1, *shape)


def _joined(arrays: Sequence[Float64], *shape: int) -> Float64:
    return np.concatenate([np.zeros((0, *shape)), *arrays])


def unpack_walls(arrays: Mapping[str, NDArray[Any]]) -> SavedWalls:
    """Return the wall map from the arrays of `pack_walls`.

    Raises
    ------
    MapError
        For missing or inconsistent arrays.
    """
    try:
        return _unpack({name: np.asarray(value) for name, value in arrays.items()})
    except KeyError as error:
        raise MapError(f"saved wall map has no array {error}") from None
    except (IndexError, ValueError, TypeError) as error:
        raise MapError(f"saved wall map is damaged: {error}") from None


def _unpack(s: Mapping[str, NDArray[Any]]) -> SavedWalls:
    count = len(s["keyframe_stamp_ns"])
    points = _split(s["scan_points"].astype(float), s["scan_count"], count)
    normals = _split(s["scan_normals"].astype(float), s["scan_count"], count)
    phi_rho = _split(s["line_phi_rho"], s["line_count"], count)
    cov = _split(s["line_cov"], s["line_count"], count)
    ends = _split(s["line_endpoints"], s["line_count"], count)
    beams = _split(s["line_beams"], s["line_count"], count)
    none = np.zeros((0, 2))
    # Maps of earlier versions lack this array.
    systematic = s.get("keyframe_systematic", np.zeros((count, 3)))
    keyframes, lines = [], []
    for k in range(count):
        stamp, odom = int(s["keyframe_stamp_ns"][k]), s["keyframe_odom"][k]
        scan = LevelScan(stamp, odom, none, s["scan_origin"][k], points[k], normals[k])
        pose, delta = s["keyframe_front_pose"][k], s["keyframe_delta"][k]
        session = int(s["keyframe_session"][k])
        keyframes.append(
            GraphKeyframe(k, scan, pose, delta, s["keyframe_cov"][k], session, systematic[k])
        )
        phi, rho = phi_rho[k].T.copy()
        lines.append(Lines(phi, rho, cov[k], ends[k], beams[k]))
    loops = [
        Proposal(int(a), int(b), delta, c, float(q[0]), float(q[1]), float(q[2]))
        for (a, b), delta, c, q in zip(
            s["loop_keyframes"], s["loop_delta"], s["loop_cov"], s["loop_quality"]
        )
    ]
    poses = s["keyframe_pose"].reshape(count, 3)
    observations = _unpack_landmarks(s, count)
    # Most maps have a single trajectory, and lack this array.
    unjoined = {int(a): int(b) for a, b in s.get("unjoined_sessions", np.zeros((0, 2), np.int64))}
    signs = _unpack_signs(s, count)
    return SavedWalls(keyframes, lines, poses, loops, observations, signs, unjoined)


def _unpack_landmarks(s: Mapping[str, NDArray[Any]], keyframes: int) -> list[AnchoredObservation]:
    """Return the observations; maps of earlier versions have none."""
    if "landmark_kinds" not in s:
        return []
    kinds = json.loads(s["landmark_kinds"].tobytes())
    for kind in kinds:
        landmark_class(kind)
    sizes = s["landmark_size"]
    anchored = _unpack_anchored("landmark", s, keyframes)
    rows = zip(
        s["landmark_stamp_ns"].tolist(),
        [kinds[k] for k in s["landmark_kind"].tolist()],
        s["landmark_id"].tolist(),
        _split(s["landmark_measurement"], sizes, len(anchored)),
        _split(s["landmark_cov"], sizes**2, len(anchored)),
        anchored,
        strict=True,
    )
    return [
        AnchoredObservation(
            LandmarkObservation(stamp, kind, number, x, cov.reshape(len(x), -1)), pose
        )
        for stamp, kind, number, x, cov, pose in rows
    ]


def _unpack_anchored(
    prefix: str, s: Mapping[str, NDArray[Any]], keyframes: int
) -> list[AnchoredPose]:
    """Return the anchored poses whose arrays have a prefix."""
    anchors = s[f"{prefix}_keyframe"].tolist()
    if not all(0 <= k < keyframes for k in anchors):
        raise ValueError(f"a {prefix} was seen from a keyframe that the map does not have")
    attitudes = s.get(f"{prefix}_attitude", np.zeros((len(anchors), 3))).tolist()
    rows = zip(anchors, s[f"{prefix}_pose"], s[f"{prefix}_pose_cov"], attitudes, strict=True)
    return [AnchoredPose(k, pose, cov, attitude=(z, a, b)) for k, pose, cov, (z, a, b) in rows]


def _unpack_signs(s: Mapping[str, NDArray[Any]], keyframes: int) -> list[SignView]:
    """Return the views of signs; maps of earlier versions have none."""
    if "sign_id" not in s:
        return []
    n = len(s["sign_id"])
    # Maps of earlier versions lack both: use a grey patch, and an unknown size.
    known = {
        "sign_patch": np.full((n, *PATCH_SHAPE), 128, np.uint8),
        "sign_plate": np.full((n, 4, 3), np.nan),
        **s,
    }
    columns = [known[f"sign_{name}"] for name in SIGN_NUMBERS]
    values = zip(*(x.tolist() if x.ndim == 1 else x for x in columns), strict=True)
    texts, anchored = json.loads(s["sign_texts"].tobytes()), _unpack_anchored("sign", s, keyframes)
    rows = zip(texts, values, anchored, s["sign_id"].tolist(), strict=True)
    return [
        SignView(
            SignMeasurement(text=text, number=number, **dict(zip(SIGN_NUMBERS, row))), pose, sign
        )
        for (text, number), row, pose, sign in rows
    ]


def _split(rows: NDArray[Any], counts: Int64, expected: int) -> list[NDArray[Any]]:
    if len(counts) != expected or int(counts.sum()) != len(rows):
        raise ValueError(f"{len(rows)} rows for {int(counts.sum())} in {expected} parts")
    ends = np.cumsum(counts)
    return [np.ascontiguousarray(rows[end - n : end]) for n, end in zip(counts, ends)]
