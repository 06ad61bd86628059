"""Crossings of a view's rays with a plane: there the plane's surface is not.

A ray that ended below a plane crossed it. So a surface on that plane ends before the crossing,
unless an object on it hides the rest: no ray crosses the plane in the shadow of the object.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.surfaces.views.views import View


def crossings(view: View, normal: Float64, offset: float, margin: float) -> Float64:
    """Return where rays of a view crossed a plane, float64 (N, 2), x and y in m.

    Parameters
    ----------
    view
        The view, with the hits of its rays and the points of all its surfaces.
    normal, offset
        float64 (3,), unit, up, and m: the plane ``normal . p = offset`` in the view's frame.
    margin
        Min distance of the end of a ray below the plane, m.
    """
    eye = view.viewpoint
    above = -1.0 if eye is None else float(normal @ eye) - offset
    if eye is None or above <= 0.0:
        return np.zeros((0, 2))
    hits = np.asarray(view.hits[:, :3], np.float64)
    points = np.concatenate([hits, *(patch.points for patch in view.patches)])
    below = offset - points @ normal
    is_below = below > margin
    part = above / (above + below[is_below])
    crossed: Float64 = eye[:2] + part[:, None] * (points[is_below, :2] - eye[:2])
    return crossed
