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

NUMBERS: dict[str, tuple[type, tuple[int, ...]]] = {
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
"""Type and shape of each field of a measurement but its texts."""


def pack_signs(views: Sequence[SignView]) -> dict[str, NDArray[Any]]:
    """Return named arrays with a row per view."""
    seen = [v.measurement for v in views]
    texts = json.dumps([[m.text, m.number] for m in seen]).encode()
    return {
        f"sign_{name}": np.array([getattr(m, name) for m in seen], dtype).reshape(-1, *shape)
        for name, (dtype, shape) in NUMBERS.items()
    } | {
        "sign_id": np.array([v.sign for v in views], np.int64),
        **pack_anchored("sign", [v.anchored for v in views]),
        "sign_texts": np.frombuffer(texts, np.uint8),
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
    known = {
        "sign_patch": np.full((n, *PATCH_SHAPE), 128, np.uint8),
        "sign_plate": np.full((n, 4, 3), np.nan),
        **s,
    }
    columns = [known[f"sign_{name}"] for name in NUMBERS]
    values = zip(*(x.tolist() if x.ndim == 1 else x for x in columns), strict=True)
    texts, anchored = json.loads(s["sign_texts"].tobytes()), unpack_anchored("sign", s, keyframes)
    return [
        SignView(SignMeasurement(text=text, number=number, **dict(zip(NUMBERS, row))), pose, sign)
        for (text, number), row, pose, sign in zip(
            texts, values, anchored, s["sign_id"].tolist(), strict=True
        )
    ]
