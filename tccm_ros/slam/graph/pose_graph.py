"""Pose graphs in GTSAM: batch optimisation and marginal covariances.

The graph is built from scratch in a fixed order and optimised as a batch, so that the result is a
function of its factors. The elimination ordering is GTSAM's default COLAMD, as in the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import gtsam
import numpy as np
from scipy.sparse import csc_matrix

from tccm_ros.arrays import Float64, Int64
from tccm_ros.geometry import spatial, wrap_angle
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.factors.noise import PLANAR_ORDER, rotate_frame
from tccm_ros.slam.graph.marginals import Information

MAX_ITERATIONS = 50
"""Maximum number of iterations of a batch optimisation. Chosen as a bound: the change of the error
normally ends it before."""
RELATIVE_TOLERANCE = 1e-5
"""Relative change of the cost below which Levenberg-Marquardt ends (chosen)."""

INITIAL_LAMBDA = 1e-6
"""Initial damping: the start values are near the optimum (chosen)."""


@dataclass(frozen=True, eq=False)
class GraphSolution:
    """An optimised graph; covariances are computed lazily, once.

    Attributes
    ----------
    values
        Values of all variables.
    graph
        The factors.
    iterations
        Number of Levenberg-Marquardt iterations.
    """

    values: gtsam.Values
    graph: gtsam.NonlinearFactorGraph
    iterations: int

    def pose(self, key: Key) -> Float64:
        """Return T_map_frame float64 (4, 4)."""
        return key.from_value(self.values.atPose3(key.symbol))

    def planar_poses(self, keys: Sequence[Key]) -> Float64:
        """Return planar poses float64 (N, 3)."""
        return poses_of(self.values, keys)

    def plane(self, key: Key) -> Float64:
        """Return a wall or surface as float64 (4,): unit normal and d, ``normal . p + d = 0``."""
        return np.asarray(self.values.atOrientedPlane3(key.symbol).planeCoefficients())

    def covariance(self, key: Key) -> Float64:
        """Return the marginal covariance in GTSAM's tangent order of the variable."""
        return self._marginals[key.symbol]

    def planar_covariance(self, key: Key) -> Float64:
        """Return the covariance float64 (3, 3) of (x, y, yaw) in the pose's own frame."""
        cov = self.covariance(key)[np.ix_(PLANAR_ORDER, PLANAR_ORDER)]
        return rotate_frame(cov, -key.yaw_offset)

    def relative_covariance(self, a: Key, b: Key, point: Float64) -> Float64:
        """Return the covariance of the difference of a point's positions by two keyframes.

        Parameters
        ----------
        a, b
            Keyframes.
        point
            float64 (2,), in map, m.

        Returns
        -------
        float64 (2, 2) of (x, y) in map, m2, of the difference of the two positions
        """
        gradients = np.zeros((2, int(self._linear.dims.sum())))
        for key, sign in ((a, 1.0), (b, -1.0)):
            first = self._linear.firsts[key.symbol]
            gradients[:, first : first + 6] += sign * self._motion_of(key, point)
        moved = np.array([self._information.solve(gradient) for gradient in gradients])
        return np.asarray(gradients @ moved.T)

    def _motion_of(self, key: Key, point: Float64) -> Float64:
        """Return the derivative (2, 6) of a point (2,) fixed to a pose, by the pose's tangent.

        The tangent is (roll, pitch, yaw, x, y, z) in the pose's own frame.
        """
        T = self.values.atPose3(key.symbol).matrix()
        motion = np.zeros((2, 6))
        motion[:, 3:] = T[:2, :3]
        motion[:, 2] = T[1, 3] - point[1], point[0] - T[0, 3]
        return motion

    def displacements(self, keys: Sequence[Key], gradients: Float64) -> Float64:
        """Return the displacement of keyframes, to first order, for a change of measurements.

        Parameters
        ----------
        keys
            Variables of K keyframes.
        gradients
            float64 (K, 3), ``J' W d`` of (x, y, yaw) in each keyframe's own frame: `d` is the
            change of the measurements, `J` the derivative of their residuals by the keyframe, `W`
            their information.

        Returns
        -------
        float64 (K, 3), (x, y, yaw) in each keyframe's own frame
        """
        firsts = self._linear.firsts
        columns = np.array([firsts[key.symbol] for key in keys])[:, None] + PLANAR_ORDER
        offsets = np.array([key.yaw_offset for key in keys])
        gradient = np.zeros(int(self._linear.dims.sum()))
        gradient[columns] = _rotated(gradients, -offsets)
        return _rotated(self._information.solve(gradient)[columns], offsets)

    @cached_property
    def _linear(self) -> _Linear:
        return _linearise(self.graph, self.values)

    @cached_property
    def _information(self) -> Information:
        return Information(self._linear.A, self._linear.dims)

    @cached_property
    def _marginals(self) -> dict[int, Float64]:
        """The marginal covariance of every variable by its symbol."""
        return dict(zip(self._linear.firsts, self._information.marginal_blocks()))

    def errors_of(self, indices: Iterable[int]) -> Float64:
        """Return half the squared Mahalanobis distances of factors by index, float64 (N,)."""
        return np.array([self.graph.at(i).error(self.values) for i in indices])


class _Linear(NamedTuple):
    """First column of each variable, Jacobian in standard deviations, columns per variable."""

    firsts: dict[int, int]
    A: csc_matrix
    dims: Int64


def _linearise(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> _Linear:
    linear = graph.linearize(values)
    symbols = list(values.keys())
    zeros = values.zeroVectors()
    dims = np.array([zeros.at(symbol).size for symbol in symbols], np.int64)
    row, column, entry = linear.sparseJacobian_()
    shape = int(row.max(initial=0.0)), int(dims.sum()) + 1
    A = csc_matrix((entry, (row.astype(int) - 1, column.astype(int) - 1)), shape=shape)
    firsts = dict(zip(symbols, (np.cumsum(dims) - dims).tolist()))
    return _Linear(firsts, A[:, :-1], dims)


def _rotated(vectors: Float64, angles: Float64) -> Float64:
    """Return vectors (K, 3) with (x, y) rotated about z by angles (K,)."""
    c, s = np.cos(angles), np.sin(angles)
    x, y, yaw = vectors.T
    return np.stack([c * x - s * y, s * x + c * y, yaw], axis=1)


class PoseGraph:
    """A growing graph; each batch optimisation starts from the values of the previous one.

    Parameters
    ----------
    factors
        Factors of the graph.
    poses
        Start values of all poses by variable, float64 (3,) or (4, 4).
    """

    def __init__(self, factors: Iterable[Factor], poses: Mapping[Key, Float64]) -> None:
        self._graph, self._values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._starts = insert_poses(self._values, poses)
        self.add(factors)

    def add(self, factors: Iterable[Factor]) -> None:
        """Add factors, which also initialise new landmarks."""
        add_factors(self._graph, self._values, factors, self._starts.__getitem__)

    def __len__(self) -> int:
        return int(self._graph.size())

    def replace(self, index: int, factor: Factor) -> None:
        """Replace factor `index` by another factor of the same variables."""
        single = gtsam.NonlinearFactorGraph()
        factor.add_to(single)
        self._graph.replace(index, single.at(0))

    def optimise(self) -> GraphSolution:
        """Run Levenberg-Marquardt and return the solution."""
        params = gtsam.LevenbergMarquardtParams()
        params.setMaxIterations(MAX_ITERATIONS)
        params.setRelativeErrorTol(RELATIVE_TOLERANCE)
        params.setlambdaInitial(INITIAL_LAMBDA)
        optimizer = gtsam.LevenbergMarquardtOptimizer(self._graph, self._values, params)
        self._values = optimizer.optimize()
        return GraphSolution(self._values, self._graph, int(optimizer.iterations()))


def poses_of(values: gtsam.Values, keys: Sequence[Key]) -> Float64:
    """Return planar poses float64 (N, 3) of keyframes."""
    if not keys:
        return np.zeros((0, 3))
    poses = gtsam.utilities.allPose3s(values)
    matrices = gtsam.utilities.extractPose3(poses)
    known = np.array(poses.keys(), np.uint64)
    rows = matrices[np.searchsorted(known, np.array([key.symbol for key in keys], np.uint64))]
    R, t = rows[:, :9].reshape(-1, 3, 3), rows[:, 9:]
    yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0]) - np.array([key.yaw_offset for key in keys])
    return np.column_stack([t[:, :2], wrap_angle(yaw)])


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
