"""Views of a table with cups on it, part by part, without walls or noise."""

import numpy as np

from tccm_ros.geometry import inverse, spatial, transform
from tccm_ros.records import ObjectBoxes, SurfaceCloud, ViewIntervals

S = 1_000_000_000
TOP = np.stack(np.meshgrid(np.arange(1.0, 2.2, 0.03), np.arange(-0.4, 0.4, 0.03)), -1)
TABLE = np.column_stack([TOP.reshape(-1, 2), np.full(TOP[..., 0].size, 0.75)])
CUP = np.array([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])
FIRST, SECOND = (1.3, 0.0), (1.8, 0.2)
AHEAD = np.array([0.3, 0.0, 0.03])
"""Pose of the base at the second view."""


def parts(stamp_ns, pose, *cups):
    """Return the parts of a view of the table and of cups at places in map."""
    T = spatial(pose)
    points = transform(inverse(T), TABLE).astype(np.float32)
    labels = np.zeros(len(points), np.uint32)
    viewpoint = np.array([0.0, 0.0, 1.2], np.float32)
    places = [np.column_stack([CUP + cup, np.full(4, 0.8)]) for cup in cups]
    footprints = tuple(transform(inverse(T), place)[:, :2] for place in places)
    heights = np.tile([0.75, 0.85], (len(cups), 1))
    return (
        SurfaceCloud(stamp_ns, "base", points, labels, viewpoint),
        ViewIntervals(stamp_ns, "base", np.zeros((0, 4), np.float32)),
        ObjectBoxes(stamp_ns, "base", footprints, heights, np.full(len(cups), 50)),
    )
