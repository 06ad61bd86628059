"""Refinement of a circle or an ellipse by the last points of all views before its edge.

The edge is located at tangents around the outline, as the edges of straight models are. Centre and
half axes are the least-squares fit to the positions of all tangents.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.outlines.edge_position import HALF_RANGE, locate_edge
from tccm_ros.outlines.shape_models import RoundModel
from tccm_ros.records import SurfaceShape
from tccm_ros.surfaces.edges.edge_samples import MIN_PIECES, Edge, EdgeSampler

TANGENTS = 16
"""Number of tangents: three times the parameters of an ellipse, and one."""


def refine_round(model: RoundModel, sampler: EdgeSampler) -> tuple[RoundModel, Float64]:
    """Return the model fitted to the last points of all views, and the covariance of the fit.

    Parameters
    ----------
    model
        Circle or ellipse of the area that the views cover.
    sampler
        Samples of the surface's edges.

    Returns
    -------
    model : RoundModel
        The given one if too few tangents have points, or if these do not determine it.
    cov : float64 (K, K)
        Covariance of the corrections of `edge_jacobian`, m2; NaN if the model was not changed.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, TANGENTS, endpoint=False)
    J, normals = edge_jacobian(model, angles)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = model.center + directions * model.radii @ model.axes
    a, b = model.radii
    speeds = np.hypot(a * directions[:, 1], b * directions[:, 0])
    half_lengths = np.pi / TANGENTS * speeds
    shifts, information = np.zeros(TANGENTS), np.zeros(TANGENTS)
    for k, half in enumerate(half_lengths.tolist()):
        along = half * np.array([-normals[k, 1], normals[k, 0]])
        found = sampler.edge_samples(Edge(points[k] - along, points[k] + along))
        if len(found.at) < MIN_PIECES:
            continue
        # The outline bends away from the tangent.
        sagitta = 0.5 * a * b / speeds[k] ** 3 * (found.at - half) ** 2
        shifts[k], sigma = locate_edge(found._replace(last=found.last + sagitta))
        information[k] = sigma**-2
    count = J.shape[1]
    if np.count_nonzero(information) <= count:
        return model, np.full((count, count), np.nan)
    cov = np.linalg.pinv(J.T @ (information[:, None] * J))
    correction = cov @ (J.T @ (information * shifts))
    residuals = shifts - J @ correction
    freedom = np.count_nonzero(information) - count
    cov = cov * max(1.0, float(information @ residuals**2) / freedom)
    radii = model.radii + correction[2:]
    # Beyond the range in which edges are located, a correction is extrapolated.
    if radii.min() <= 0.0 or np.abs(J @ correction).max() > HALF_RANGE:
        return model, np.full((count, count), np.nan)
    return replace(model, center=model.center + correction[:2], radii=radii), cov


def edge_jacobian(model: RoundModel, angles: Float64) -> tuple[Float64, Float64]:
    """Return derivatives of the outline across itself, and its outward normals, at parameters.

    Parameters
    ----------
    model
        Circle or ellipse.
    angles
        float64 (N,), parameters of points on the outline, rad, from the first axis.

    Returns
    -------
    J : float64 (N, K)
        Derivatives by x and y of the centre, and by the radius of a circle or both half axes of an
        ellipse.
    normals : float64 (N, 2)
        Unit vectors.
    """
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    local = directions / model.radii
    local /= np.hypot(local[:, 0], local[:, 1])[:, None]
    normals = local @ model.axes
    by_radii = local * directions
    if model.shape is SurfaceShape.CIRCLE:
        by_radii = by_radii.sum(axis=1, keepdims=True)
    return np.hstack([normals, by_radii]), normals
