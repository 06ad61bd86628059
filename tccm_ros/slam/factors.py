"""The factors of the wall graph, one small class each.

A factor is data plus one method that adds its GTSAM form to a graph. To add a landmark or a
measurement of a new kind, write its class here and hand instances to `WallSlam.solve`: nothing
else changes. Variables are named by `Key`: keyframes and views are spatial poses (``gtsam.Pose3``),
walls and surfaces are planes (``gtsam.OrientedPlane3``). A factor that brings a landmark of its own
says where it starts by `initial`.

GTSAM orders the tangent of a pose (roll, pitch, yaw, x, y, z), in the body's frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import gtsam
import numpy as np
from numpy.typing import NDArray

from tccm_ros.geometry import spatial

__all__ = [
    "BetweenKeyframes",
    "BetweenViews",
    "Building",
    "CornerObservation",
    "Factor",
    "Key",
    "KeyframeView",
    "Planar",
    "PriorPose",
    "ViewPlane",
    "WallDirection",
    "WallObservation",
    "WallThroughCorner",
    "building_key",
    "corner_key",
    "keyframe_key",
    "surface_key",
    "view_key",
    "wall_key",
]

Float64 = NDArray[np.float64]

PLANAR_SIGMA = 1e-5
"""Roll, pitch (rad) and z (m) of a keyframe: small enough to vanish, large enough to be stable."""

CORNER_LEVEL = 1e-3
"""Roll, pitch (rad) and z (m) of a corner, which has none of them."""

BLIND = 1e3
"""Standard deviation (m, rad) of what a factor does not measure."""

HUBER_K = 1.345
"""Huber threshold in standard deviations: 95 % efficient for Gaussian noise."""


class Key(NamedTuple):
    """A variable of the graph: its kind (a letter) and number.

    The graph's variable of a keyframe is its pose turned by `turn` (rad) about z: GTSAM's basis of
    a plane's normal flips where the normal lies along x or y of the pose that sees it, and a
    keyframe is turned until none of its walls is near that case.
    """

    kind: str
    number: int
    turn: float = 0.0

    @property
    def symbol(self) -> int:
        """GTSAM's integer for this variable."""
        return gtsam.symbol(self.kind, self.number)

    def turned(self, T: Float64) -> gtsam.Pose3:
        """Return the graph's value for the pose T_map_frame (4, 4)."""
        return gtsam.Pose3(np.asarray(T, float) @ _turn(self.turn))

    def unturned(self, value: gtsam.Pose3) -> Float64:
        """Return T_map_frame (4, 4) of the graph's value."""
        return value.matrix() @ _turn(-self.turn)


def _turn(angle: float) -> Float64:
    T = np.eye(4)
    T[0, 0] = T[1, 1] = math.cos(angle)
    T[1, 0] = math.sin(angle)
    T[0, 1] = -T[1, 0]
    return T


def keyframe_key(index: int, turn: float = 0.0) -> Key:
    """Name the pose of a keyframe."""
    return Key("x", index, turn)


def view_key(index: int) -> Key:
    """Name the pose of a view: its index in the views given to `WallSlam.solve`."""
    return Key("v", index)


def wall_key(index: int) -> Key:
    """Name a wall."""
    return Key("w", index)


def surface_key(index: int) -> Key:
    """Name a surface plane; the index is the caller's."""
    return Key("s", index)


def corner_key(index: int) -> Key:
    """Name a corner."""
    return Key("c", index)


def building_key() -> Key:
    """Name the building's frame, turned so that its walls are off its axes."""
    return Key("f", 0, 0.25 * math.pi)


class Factor(Protocol):
    """What the graph asks of a factor."""

    @property
    def landmark(self) -> Key | None:
        """The landmark that this factor can start, if it has one."""

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add the GTSAM form."""

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return start values for landmarks that no other part of the graph starts."""


class _NoLandmark:
    @property
    def landmark(self) -> Key | None:
        return None

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        return []


def _gaussian(covariance: Float64) -> gtsam.noiseModel.Gaussian:
    return gtsam.noiseModel.Gaussian.Covariance(np.asarray(covariance, float))


def _huber(noise: gtsam.noiseModel.Base) -> gtsam.noiseModel.Robust:
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(HUBER_K), noise)


def planar_covariance(cov_xyyaw: Float64, z_roll_pitch: tuple[float, float, float]) -> Float64:
    """Spread a covariance of (x, y, yaw) to GTSAM's (roll, pitch, yaw, x, y, z).

    Parameters
    ----------
    cov_xyyaw
        float64 (3, 3), m and rad.
    z_roll_pitch
        Standard deviations of z (m), roll and pitch (rad).
    """
    cov = np.zeros((6, 6))
    cov[np.ix_([3, 4, 2], [3, 4, 2])] = cov_xyyaw
    z, roll, pitch = z_roll_pitch
    cov[0, 0], cov[1, 1], cov[5, 5] = roll**2, pitch**2, z**2
    return cov


def _turn_covariance(cov_xyyaw: Float64, turn: float) -> Float64:
    """Express a covariance of (x, y, yaw) in a frame turned by `turn` about z."""
    R = _turn(turn)[:3, :3]
    return R.T @ np.asarray(cov_xyyaw, float) @ R


@dataclass(frozen=True, slots=True, eq=False)
class PriorPose(_NoLandmark):
    """Where a keyframe is: planar pose (3,) and covariance (3, 3) of (x, y, yaw) in its frame."""

    key: Key
    pose: Float64
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior that also holds roll, pitch and z at zero."""
        cov = _turn_covariance(self.cov, self.key.turn)
        noise = _gaussian(planar_covariance(cov, (PLANAR_SIGMA,) * 3))
        value = self.key.turned(spatial(self.pose))
        graph.add(gtsam.PriorFactorPose3(self.key.symbol, value, noise))


@dataclass(frozen=True, slots=True, eq=False)
class Planar(_NoLandmark):
    """A pose keeps roll, pitch and z at zero; (x, y, yaw) stay free."""

    key: Key
    pose: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior at the start value that is blind along the plane."""
        sigmas = np.array([PLANAR_SIGMA, PLANAR_SIGMA, 1e3, 1e6, 1e6, PLANAR_SIGMA])
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        value = self.key.turned(spatial(self.pose))
        graph.add(gtsam.PriorFactorPose3(self.key.symbol, value, noise))


@dataclass(frozen=True, slots=True, eq=False)
class BetweenKeyframes(_NoLandmark):
    """Planar pose (3,) of `b` in `a`, with covariance (3, 3) of (x, y, yaw) in b's frame.

    `weight` scales the information: GNC reweights loop closures between optimisations.
    """

    a: Key
    b: Key
    delta: Float64
    cov: Float64
    weight: float = 1.0

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor; roll, pitch and z follow, loosely (`Planar` holds them)."""
        cov = _turn_covariance(np.asarray(self.cov) / self.weight, self.b.turn)
        noise = _gaussian(planar_covariance(cov, (1.0, 1.0, 1.0)))
        delta = gtsam.Pose3(_turn(-self.a.turn) @ spatial(self.delta) @ _turn(self.b.turn))
        graph.add(gtsam.BetweenFactorPose3(self.a.symbol, self.b.symbol, delta, noise))


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeView(_NoLandmark):
    """A view hangs on a keyframe: planar pose (3,) of the view in it, covariance (3, 3).

    The view's z, roll and pitch are those of the (level) keyframe within `lean`: the base leans
    (DESIGN section 7: 5 mm and 0.3 deg).
    """

    keyframe: Key
    view: Key
    delta: Float64
    cov: Float64
    lean: tuple[float, float, float] = (0.005, 0.00524, 0.00524)

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor with the lean as sigmas of z, roll and pitch."""
        noise = _gaussian(planar_covariance(np.asarray(self.cov), self.lean))
        delta = gtsam.Pose3(_turn(-self.keyframe.turn) @ spatial(self.delta))
        keys = self.keyframe.symbol, self.view.symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, delta, noise))


@dataclass(frozen=True, slots=True, eq=False)
class BetweenViews(_NoLandmark):
    """Registration of view `j` to view `i`: T_i_j (4, 4).

    `cov` is float64 (6, 6) of (roll, pitch, yaw, x, y, z) in j's frame, rad and m. The factor is
    robust (Huber).
    """

    i: int
    j: int
    T_i_j: Float64
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a robust between factor."""
        noise = _huber(_gaussian(self.cov))
        keys = view_key(self.i).symbol, view_key(self.j).symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, gtsam.Pose3(np.asarray(self.T_i_j)), noise))


@dataclass(frozen=True, slots=True, eq=False)
class ViewPlane:
    """View `view` saw surface `surface` as the plane ``normal . p = offset`` in its own frame.

    `cov` is float64 (3, 3) of (rotation about u, rotation about v, offset at the view's origin),
    rad and m, where u, v are any two tangents that the caller used; only rotation-isotropic
    covariances keep their meaning for another choice of u, v.
    """

    view: int
    surface: int
    normal: Float64
    offset: float
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor."""
        keys = view_key(self.view).symbol, surface_key(self.surface).symbol
        measured = np.array([*self.normal, -self.offset])
        graph.add(gtsam.OrientedPlane3Factor(measured, _gaussian(self.cov), *keys))

    @property
    def landmark(self) -> Key:
        """The surface."""
        return surface_key(self.surface)

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start the surface where the first of its factors sees it."""
        T_map_view = pose_of(view_key(self.view))
        normal = T_map_view[:3, :3] @ np.asarray(self.normal, float)
        offset = self.offset + normal @ T_map_view[:3, 3]
        plane = gtsam.OrientedPlane3(np.array([*normal, -offset]))
        return [(surface_key(self.surface), plane)]


@dataclass(frozen=True, slots=True, eq=False)
class WallObservation:
    """Keyframe `keyframe` saw wall `wall` as the line (phi, rho) in its base frame.

    `cov` is float64 (2, 2) of (phi, rho), with the correlation (DESIGN section 7). phi points from
    the robot through the wall, so that each side of a wall is a wall of its own.
    """

    keyframe: Key
    wall: Key
    phi: float
    rho: float
    cov: Float64

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor; its residual is (-sin dphi, 0, drho)."""
        v_phi, c, v_rho = self.cov[0, 0], self.cov[0, 1], self.cov[1, 1]
        cov = np.array([[v_phi, 0.0, -c], [0.0, v_phi, 0.0], [-c, 0.0, v_rho]])
        phi = self.phi - self.keyframe.turn
        measured = np.array([np.cos(phi), np.sin(phi), 0.0, -self.rho])
        keys = self.keyframe.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, _gaussian(cov), *keys))

    @property
    def landmark(self) -> Key:
        """The wall."""
        return self.wall

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start the wall where the first of its factors sees it."""
        T = pose_of(self.keyframe)
        normal = T[:3, :3] @ np.array([np.cos(self.phi), np.sin(self.phi), 0.0])
        rho = self.rho + normal @ T[:3, 3]
        return [(self.wall, gtsam.OrientedPlane3(np.array([normal[0], normal[1], 0.0, -rho])))]


@dataclass(frozen=True, slots=True, eq=False)
class CornerObservation:
    """Keyframe `keyframe` saw a corner at `point` (2,), m, in its base frame.

    `sigma` is its standard deviation in x and y, m. A corner is a level pose whose heading means
    nothing.
    """

    keyframe: Key
    corner: Key
    point: Float64
    sigma: float

    @property
    def landmark(self) -> Key:
        """The corner."""
        return self.corner

    def _pose(self) -> Float64:
        return spatial(np.array([self.point[0], self.point[1], 0.0]))

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a between factor that is blind to the corner's heading."""
        level = (CORNER_LEVEL, CORNER_LEVEL, CORNER_LEVEL)
        cov = planar_covariance(np.diag([self.sigma**2, self.sigma**2, 1.0]), level)
        delta = gtsam.Pose3(_turn(-self.keyframe.turn) @ self._pose())
        keys = self.keyframe.symbol, self.corner.symbol
        graph.add(gtsam.BetweenFactorPose3(*keys, delta, _gaussian(cov)))

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start the corner where the first of its factors sees it."""
        return [(self.corner, gtsam.Pose3(pose_of(self.keyframe) @ self._pose()))]


@dataclass(frozen=True, slots=True, eq=False)
class WallThroughCorner(_NoLandmark):
    """A wall passes through a corner within `sigma`, m; `phi` is its normal's direction in map."""

    corner: Key
    wall: Key
    phi: float
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor that is blind to the angle."""
        measured = np.array([np.cos(self.phi), np.sin(self.phi), 0.0, 0.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([BLIND, BLIND, self.sigma]))
        keys = self.corner.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, noise, *keys))


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """The building's own frame: a heading `yaw` (rad, a start value) that walls share."""

    key: Key
    yaw: float

    @property
    def landmark(self) -> Key:
        """The frame."""
        return self.key

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add a prior that holds the frame at the origin and leaves its heading free."""
        cov = np.diag([PLANAR_SIGMA**2, PLANAR_SIGMA**2, BLIND**2])
        PriorPose(self.key, np.array([0.0, 0.0, self.yaw]), cov).add_to(graph)

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start at `yaw`."""
        return [(self.key, self.key.turned(spatial(np.array([0.0, 0.0, self.yaw]))))]


@dataclass(frozen=True, slots=True, eq=False)
class WallDirection(_NoLandmark):
    """The structure prior: a wall's normal is at `angle` (rad) in the building's own frame.

    The building's frame is a pose whose heading is estimated with everything else, so the prior
    ties walls to each other and none to the map's axes.
    """

    building: Key
    wall: Key
    angle: float
    sigma: float

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add an oriented-plane factor that is blind to the distance."""
        angle = self.angle - self.building.turn
        measured = np.array([np.cos(angle), np.sin(angle), 0.0, 0.0])
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([self.sigma, self.sigma, BLIND]))
        keys = self.building.symbol, self.wall.symbol
        graph.add(gtsam.OrientedPlane3Factor(measured, noise, *keys))
