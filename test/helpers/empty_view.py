"""The three messages of a view without contents."""

import numpy as np

from tccm_ros.records import ObjectBoxes, SurfaceCloud, ViewIntervals


def empty_view(stamp_ns):
    return (
        SurfaceCloud(stamp_ns, "base", np.zeros((0, 3), np.float32), np.zeros(0, np.uint32)),
        ViewIntervals(stamp_ns, "base", np.zeros((0, 4), np.float32)),
        ObjectBoxes(stamp_ns, "base", (), np.zeros((0, 2)), np.zeros(0, np.uint32)),
    )
