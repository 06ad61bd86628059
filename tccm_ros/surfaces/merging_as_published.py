"""Merging as published (surface mapping, IV.B): surfaces with points within a distance are one.

A part of the baseline ``surfaces.segmentation: seed``: no height is compared, so that what stands
less than the distance above a surface is one with it, and nothing is joined over what is hidden.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.geometry import transform
from tccm_ros.surfaces.contact import box_pairs, connect, patch_boxes
from tccm_ros.surfaces.merged_patches import Members, PlacedPatch
from tccm_ros.surfaces.patch_planes import PatchPlanes

__all__ = ["merge_by_distance"]


def merge_by_distance(
    placed: list[PlacedPatch], T_map_view: NDArray[np.float64], distance: float
) -> list[Members]:
    """Merge patches any of whose points come within a distance.

    Parameters
    ----------
    placed
        Patches in the order of their numbers.
    T_map_view
        float64 (V, 4, 4).
    distance
        m.
    """
    if not placed:
        return []
    clouds = [transform(T_map_view[p.view], p.patch.points) for p in placed]
    offsets = np.cumsum([0] + [len(cloud) for cloud in clouds])
    points = np.concatenate(clouds)
    boxes = patch_boxes(points, offsets)
    pairs = box_pairs(boxes, distance)
    root = connect(points, offsets, boxes, pairs, distance, _unknown(len(placed)), np.inf)
    return [tuple(placed[k] for k in np.flatnonzero(root == r)) for r in np.unique(root).tolist()]


def _unknown(count: int) -> PatchPlanes:
    """Return planes of which nothing is known: any two of them agree."""
    return PatchPlanes(
        np.arange(count),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
        np.full(count, np.inf),
        np.zeros((count, 3, 3)),
    )
