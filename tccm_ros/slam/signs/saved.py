"""Views of door signs in saved maps: conversion to named arrays and back."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.signs.hog import PATCH_SHAPE
from tccm_ros.signs.measurement import SignMeasurement
from tccm_ros.slam.chain import AnchoredPose
from tccm_ros.slam.signs.views import SignView

SHAPES = {
    "pixel": (2,), "bearing": (3,), "T_base_camera": (4, 4), "corners": (4, 2), "plate": (4, 3),
}  # fmt: skip
"""Shapes of the arrays of a measurement, without its patch."""


def pack_signs(views: Sequence[SignView]) -> dict[str, NDArray[Any]]:
    """Return named arrays with a row per view."""
    seen = [v.measurement for v in views]
    arrays = {
        f"sign_{name}": np.array([getattr(m, name) for m in seen], float).reshape(-1, *shape)
        for name, shape in SHAPES.items()
    }
    texts = json.dumps([[m.text, m.number] for m in seen]).encode()
    return arrays | {
        "sign_id": np.array([v.sign for v in views], np.int64),
        "sign_stamp_ns": np.array([m.stamp_ns for m in seen], np.int64),
        **pack_anchored("sign", [v.anchored for v in views]),
        "sign_texts": np.frombuffer(texts, np.uint8),
        "sign_confidence": np.array([m.confidence for m in seen], float),
        "sign_focal_length": np.array([m.focal_length for m in seen], float),
        "sign_patch": np.array([m.patch for m in seen], np.uint8).reshape(-1, *PATCH_SHAPE),
    }


def pack_anchored(prefix: str, anchored: Sequence[AnchoredPose]) -> dict[str, NDArray[Any]]:
    """Return anchored poses as arrays with a prefix; no attitudes where all are level."""
    attitudes = np.array([a.attitude for a in anchored], float).reshape(-1, 3)
    return {
        f"{prefix}_keyframe": np.array([a.keyframe for a in anchored], np.int64),
        f"{prefix}_pose": np.array([a.pose for a in anchored], float).reshape(-1, 3),
        f"{prefix}_pose_cov": np.array([a.cov for a in anchored], float).reshape(-1, 3, 3),
        **({f"{prefix}_attitude": attitudes} if attitudes.any() else {}),
    }


def unpack_anchored(
    prefix: str, s: Mapping[str, NDArray[Any]], keyframes: int
) -> list[AnchoredPose]:
    """Return the anchored poses whose arrays have a prefix.

    Raises
    ------
    ValueError
        For arrays inconsistent with each other or with the number of keyframes.
    """
    anchors = s[f"{prefix}_keyframe"].tolist()
    if not all(0 <= k < keyframes for k in anchors):
        raise ValueError(f"a {prefix} was seen from a keyframe that the map does not have")
    attitudes = s.get(f"{prefix}_attitude", np.zeros((len(anchors), 3))).tolist()
    rows = zip(anchors, s[f"{prefix}_pose"], s[f"{prefix}_pose_cov"], attitudes, strict=True)
    return [AnchoredPose(k, pose, cov, attitude=(z, a, b)) for k, pose, cov, (z, a, b) in rows]


def unpack_signs(s: Mapping[str, NDArray[Any]], keyframes: int) -> list[SignView]:
    """Return the views from the arrays of `pack_signs`; maps of earlier versions have none.

    Raises
    ------
    ValueError
        For arrays inconsistent with each other or with the number of keyframes.
    """
    if "sign_id" not in s:
        return []
    n = len(s["sign_id"])
    # Maps of earlier versions lack both: use a grey patch, and an unknown size.
    patches = s.get("sign_patch", np.full((n, *PATCH_SHAPE), 128, np.uint8))
    plates = s.get("sign_plate", np.full((n, *SHAPES["plate"]), np.nan))
    texts, anchored = json.loads(s["sign_texts"].tobytes()), unpack_anchored("sign", s, keyframes)
    measurements = [
        SignMeasurement(
            stamp, pixel, bearing, T, text, number, confidence, patch, corners, plate, f
        )
        for stamp, pixel, bearing, T, (text, number), confidence, patch, corners, plate, f in zip(
            s["sign_stamp_ns"].tolist(),
            s["sign_pixel"],
            s["sign_bearing"],
            s["sign_T_base_camera"],
            texts,
            s["sign_confidence"].tolist(),
            patches,
            s["sign_corners"],
            plates,
            s["sign_focal_length"].tolist(),
            strict=True,
        )
    ]
    rows = zip(measurements, anchored, s["sign_id"].tolist(), strict=True)
    return [SignView(*row) for row in rows]
