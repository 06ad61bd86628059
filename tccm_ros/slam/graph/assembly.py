"""Factors and start values in GTSAM's form, for a batch and for updates of ISAM2."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key


class Update(NamedTuple):
    """What an update adds to ISAM2.

    Attributes
    ----------
    graph
        The factors.
    values
        Start values of variables that are new.
    ends
        How many of `graph` are of each `Factor` and those before it: one may have several.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    ends: list[int]


def assemble_update(
    isam: gtsam.ISAM2,
    factors: Iterable[Factor],
    poses: Mapping[Key, Float64],
    estimate: Callable[[Key], Float64],
) -> Update:
    """Return new factors and the start values of variables that are not in a graph yet.

    Parameters
    ----------
    isam
        The graph to update, which is left as it is.
    factors
        New ones.
    poses
        Start values as for `insert_poses`; those of poses in the graph are passed over.
    estimate
        Returns T_map_frame float64 (4, 4) of a pose in the graph.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    fresh = {key: pose for key, pose in poses.items() if not isam.valueExists(key.symbol)}
    starts = insert_poses(values, fresh)

    def pose_of(key: Key) -> Float64:
        return starts[key] if key in starts else estimate(key)

    ends = add_factors(graph, values, factors, pose_of, isam.valueExists)
    return Update(graph, values, ends)


def insert_poses(values: gtsam.Values, poses: Mapping[Key, Float64]) -> dict[Key, Float64]:
    """Insert start values of poses; return them as T_map_frame float64 (4, 4).

    Parameters
    ----------
    values
        Of a graph, without these variables.
    poses
        In map, float64 (3,) of (x, y, yaw) or (4, 4).
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
    """Add factors; landmarks that are new are started by the first factor that has them.

    Parameters
    ----------
    graph, values
        To add to.
    factors
        To add.
    pose_of
        Returns T_map_frame float64 (4, 4) of a pose.
    is_known
        Returns whether a variable, by its symbol, has a value elsewhere than in `values`.

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
