"""Conversion of factors and start values to GTSAM's form."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key


def insert_poses(values: gtsam.Values, poses: Mapping[Key, Float64]) -> dict[Key, Float64]:
    """Insert start values of poses; return them as T_map_frame float64 (4, 4).

    Parameters
    ----------
    values
        Values of a graph, without these variables.
    poses
        Poses in map, float64 (3,) of (x, y, yaw) or (4, 4).
    """
    starts = {key: spatial(pose) if np.ndim(pose) == 1 else pose for key, pose in poses.items()}
    for key, T in starts.items():
        values.insert(key.symbol, key.to_value(T))
    return starts


def add_factors(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    factors: Iterable[Factor],
    pose_of: Callable[[Key], Float64],
    is_known: Callable[[int], bool] = lambda symbol: False,
) -> list[int]:
    """Add factors; the first factor of a new landmark gives its start value.

    Parameters
    ----------
    graph, values
        Graph and start values to add to.
    factors
        New factors.
    pose_of
        Returns T_map_frame float64 (4, 4) of a pose variable.
    is_known
        Returns whether a variable, by its symbol, has a value outside `values`.

    Returns
    -------
    list of int
        The size of `graph` after each factor
    """
    ends = []
    for factor in factors:
        factor.add_to(graph)
        ends.append(int(graph.size()))
        landmark = factor.landmark
        if landmark is None or values.exists(landmark.symbol) or is_known(landmark.symbol):
            continue
        for key, value in factor.initial(pose_of):
            values.insert(key.symbol, value)
    return ends
