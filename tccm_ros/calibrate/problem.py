"""The least-squares problem: rig, planes, and roll and pitch of bases from hits on planes.

A hit p (in the frame of its place), the small roll and pitch w of the base at that place and a
plane with normal n and offset d give the residual ``n . (p + w x p) - d``. Assumptions on buildings
and bases are priors with standard deviations; they distinguish a wrong tilt zero from a tilted
base.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.arrays import Float64, Int64
from tccm_ros.calibrate.layout import WIDE_LEVEL_SIGMAS, WIDE_SIGMAS, AssumptionSigmas, Layout
from tccm_ros.calibrate.model import CycleBeams, RigModel, RigValues
from tccm_ros.calibrate.recording import LevelScans
from tccm_ros.calibrate.surroundings import CEILING, FIRST_WALL, FLOOR, RoomPlanes
from tccm_ros.geometry import pose


@dataclass(frozen=True, slots=True, eq=False)
class LevelHits:
    """Level laser hits at one place, with their walls.

    Attributes
    ----------
    scans
        Scans with the hits.
    place
        Number of the place.
    wall
        int64 (N,), wall number of each hit, -1 for none.
    """

    scans: LevelScans
    place: int
    wall: Int64


class Planes(NamedTuple):
    """All planes in the frames of horizontal bases: floor, ceiling at each place, then walls.

    Attributes
    ----------
    normals
        float64 (Q, 3), unit vectors towards the laser.
    offsets
        float64 (Q,), m: normal . x = offset.
    number
        int64 (Q,), `FLOOR`, `CEILING`, or `FIRST_WALL` and up.
    place
        int64 (Q,), place in whose frame the plane is given, -1 for all places.
    """

    normals: Float64
    offsets: Float64
    number: Int64
    place: Int64


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Residuals and derivatives at an estimate.

    Attributes
    ----------
    residuals
        float64 (N,), divided by `sigma`.
    jacobian
        float64 (N, P), their derivatives by the parameters.
    sigma
        float64 (N,), standard deviation of each residual, m.
    cluster
        int64 (N,); residuals of one cluster have a common error: they are near each other on one
        plane. Negative for the level laser.
    """

    residuals: Float64
    jacobian: Float64
    sigma: Float64
    cluster: Int64


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Hits of the tilting laser on planes, and of the level laser on walls.

    Attributes
    ----------
    model
        Rig model, which transforms the hits.
    hits, plane, place
        Hits, and the plane and place of each, int64 (N,).
    bag, poses
        Bag int64 (P,) and pose float64 (P, 3) of each place, as in `CalibrationRecording`: the
        slope of a ceiling is constant in the room, and differs between the frames of bases with
        different headings.
    surroundings
        The planes found; `plane` contains their numbers.
    level
        Hits of the level laser.
    T_level_mount
        The configured correction of the level laser's mount, float64 (4, 4).
    assumed
        Standard deviations of the assumptions.
    layout
        Order of the parameters.
    blur
        Added to the standard deviation of every residual, m: wide in the first round, so that no
        plane dominates before all are roughly known.
    """

    model: RigModel
    hits: CycleBeams
    plane: Int64
    place: Int64
    bag: Int64
    poses: Float64
    surroundings: RoomPlanes
    level: tuple[LevelHits, ...]
    T_level_mount: Float64
    assumed: AssumptionSigmas
    layout: Layout
    blur: float

    def linearise(self, x: Float64) -> Linearised:
        """Return residuals and derivatives at parameters float64 (P,)."""
        parts = [self._tilt_part(x), *(self._level_part(x, hits) for hits in self.level)]
        return Linearised(
            *(np.concatenate([getattr(part, name) for part in parts])
              for name in ("residuals", "jacobian", "sigma", "cluster"))
        )  # fmt: skip

    def _tilt_part(self, x: Float64) -> Linearised:
        layout, values = self.layout, RigValues.of_vector(x[self.layout.rig])
        ranges = np.linalg.norm(self.hits.points, axis=1)
        beams = self.model.transform_directions(
            self.hits, values, self.hits.points / ranges[:, None]
        )
        points = self.model.transform_points(self.hits, values) + x[layout.bias] * beams
        by_rig = self.model.jacobian(self.hits, values, points - x[layout.bias] * beams)
        residuals, J, normals = self._against_planes(x, points, self.plane, self.place)
        J[:, layout.rig] = np.einsum("ni,nij->nj", normals, by_rig)
        cosine = np.sum(normals * beams, axis=1)
        J[:, layout.bias] = cosine
        cluster = _clusters(points, self.plane, self.place, normals)
        sigma = self._sigma(cosine, ranges, cluster)
        return Linearised(residuals / sigma, J / sigma[:, None], sigma, cluster)

    def _level_part(self, x: Float64, level: LevelHits) -> Linearised:
        layout, has_wall = self.layout, level.wall >= 0
        T, points = (of_all[has_wall] for of_all in self.level_points(x, level.scans))
        place = np.full(has_wall.sum(), level.place)
        plane = level.wall[has_wall] + FIRST_WALL
        residuals, J, normals = self._against_planes(x, points, plane, place)
        R = level.scans.T_place_base[has_wall][:, :3, :3]
        J[:, layout.level.start : layout.level.start + 2] = np.einsum(
            "ni,nij->nj", normals, R[:, :, :2]
        )
        arm = points - T[:, :3, 3]
        J[:, layout.level.stop - 1] = normals[:, 1] * arm[:, 0] - normals[:, 0] * arm[:, 1]
        beams = arm / np.maximum(level.scans.ranges[has_wall], 1e-3)[:, None]
        cluster = _clusters(points, plane, place, normals)
        sigma = self._sigma(np.sum(normals * beams, axis=1), level.scans.ranges[has_wall], cluster)
        return Linearised(residuals / sigma, J / sigma[:, None], sigma, -1 - cluster)

    def _sigma(self, cosine: Float64, ranges: Float64, cluster: Int64) -> Float64:
        """Return the standard deviation of each residual, m.

        The common error of a cluster's hits (deviation of the plane, bias of the laser) is counted
        once per cluster, independent of the number of hits.
        """
        assumed = self.assumed
        shared = assumed.flatness**2 * np.bincount(cluster, minlength=1)[cluster]
        across = ranges * np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) * assumed.angle_noise
        own = (assumed.range_noise * cosine) ** 2 + across**2 + shared
        return np.sqrt(own + self.blur**2 * (cosine**2 + GRAZING**2))

    def _against_planes(
        self, x: Float64, points: Float64, plane: Int64, place: Int64
    ) -> tuple[Float64, Float64, Float64]:
        """Return residuals (m), derivatives without the rig's, and normals in the bases' frames."""
        layout = self.layout
        planes = self.planes(x)
        row = np.where(plane == CEILING, 1 + place, plane + layout.places - 1)
        row[plane == FLOOR] = 0
        n, d = planes.normals[row], planes.offsets[row]
        rolls_pitches = np.array([x[layout.roll_pitch(p)] for p in range(layout.places)])[place]
        w = np.column_stack([rolls_pitches, np.zeros(len(rolls_pitches))])
        level = points + np.cross(w, points)
        J = np.zeros((len(points), layout.size))
        rows = np.arange(len(points))
        column = layout.first_wall + 3 * layout.walls + 2 * place
        J[rows, column] = n[:, 2] * points[:, 1] - n[:, 1] * points[:, 2]
        J[rows, column + 1] = n[:, 0] * points[:, 2] - n[:, 2] * points[:, 0]
        J[plane == FLOOR, layout.floor] = -1.0
        self._ceiling_derivatives(J, level, plane, place)
        self._wall_derivatives(J, x, level, plane)
        residuals = np.sum(n * level, axis=1) - d
        seen_in_base = n + np.cross(n, w)
        return residuals, J, seen_in_base

    def _ceiling_derivatives(self, J: Float64, points: Float64, plane: Int64, place: Int64) -> None:
        """Write the derivatives of -(z - h) + x a + y b: the ceiling's normal points down.

        Here x and y are in the frame of the bag's first place.
        """
        rows = np.flatnonzero(plane == CEILING)
        at = self.poses[place[rows]]
        c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
        first = self.layout.first_ceiling + 3 * self.bag[place[rows]]
        J[rows, first] = 1.0
        J[rows, first + 1] = at[:, 0] + c * points[rows, 0] - s * points[rows, 1]
        J[rows, first + 2] = at[:, 1] + s * points[rows, 0] + c * points[rows, 1]

    def _wall_derivatives(self, J: Float64, x: Float64, points: Float64, plane: Int64) -> None:
        for number in range(self.layout.walls):
            mine, columns = plane == FIRST_WALL + number, self.layout.wall(number)
            phi, _, tilt = x[columns]
            c, s = np.cos(phi), np.sin(phi)
            J[mine, columns.start] = (points[mine, 1] * c - points[mine, 0] * s) * np.cos(tilt)
            J[mine, columns.start + 1] = -1.0
            J[mine, columns.start + 2] = points[mine, 2] * np.cos(tilt) - np.sin(tilt) * (
                points[mine, 0] * c + points[mine, 1] * s
            )

    def planes(self, x: Float64) -> Planes:
        """Return all planes at parameters float64 (P,)."""
        layout, places = self.layout, range(self.layout.places)
        normals, offsets = [[0.0, 0.0, 1.0]], [float(x[layout.floor])]
        for number, (at_x, at_y, yaw) in zip(self.bag.tolist(), self.poses.tolist()):
            height, a, b = x[layout.ceiling(number)].tolist()
            c, s = np.cos(yaw), np.sin(yaw)
            normals.append([c * a + s * b, c * b - s * a, -1.0])
            offsets.append(-height - a * at_x - b * at_y)
        for number in range(layout.walls):
            phi, rho, tilt = x[layout.wall(number)].tolist()
            normals.append([np.cos(phi) * np.cos(tilt), np.sin(phi) * np.cos(tilt), np.sin(tilt)])
            offsets.append(rho)
        walls = self.surroundings.walls
        numbers = [FLOOR, *(CEILING for _ in places), *(FIRST_WALL + i for i in range(len(walls)))]
        seen_from = [-1, *places, *(wall.place for wall in walls)]
        return Planes(
            np.array(normals), np.array(offsets), np.array(numbers, np.int64),
            np.array(seen_from, np.int64),
        )  # fmt: skip

    def level_mount(self, values: Float64, T_base_laser: Float64) -> Float64:
        """Return the correction of the level laser's mount for x, y, yaw at the laser itself."""
        at = (self.T_level_mount @ T_base_laser)[:3, 3]
        R = Rotation.from_rotvec([0.0, 0.0, values[2]]).as_matrix()
        shift = np.array([values[0], values[1], 0.0])
        T: Float64 = pose(R, at + shift - R @ at) @ self.T_level_mount
        return T

    def level_points(self, x: Float64, scans: LevelScans) -> tuple[Float64, Float64]:
        """Return the laser's pose (N, 4, 4) at each hit, and the hits (N, 3), m, at the place."""
        T = self.level_mount(x[self.layout.level], scans.T_base_laser) @ scans.T_base_laser
        T = scans.T_place_base @ T
        return T, np.einsum("nij,nj->ni", T[:, :3, :3], scans.points) + T[:, :3, 3]

    def start(self, values: RigValues, level: Float64) -> Float64:
        """Return the parameters of the found planes with horizontal bases, float64 (P,)."""
        x = np.zeros(self.layout.size)
        x[self.layout.rig], x[self.layout.level] = values.vector(), level
        x[self.layout.floor] = self.surroundings.floor or 0.0
        for bag, height in enumerate(self.surroundings.ceilings):
            x[self.layout.ceiling(bag).start] = height or 0.0
        for number, wall in enumerate(self.surroundings.walls):
            x[self.layout.wall(number)] = wall.phi, wall.rho, 0.0
        return x

    def priors(self, guess: RigValues, building_factor: float = 1.0) -> tuple[Float64, Float64]:
        """Return means and standard deviations of all parameters, float64 (P,) each.

        `building_factor` multiplies those of vertical walls, horizontal ceilings and the range
        bias. They are infinite without an assumption; those of the rig are `WIDE_SIGMAS`.
        """
        layout, assumed = self.layout, self.assumed
        means, sigmas = np.zeros(layout.size), np.full(layout.size, np.inf)
        means[layout.rig], sigmas[layout.rig] = guess.vector(), WIDE_SIGMAS
        sigmas[layout.level] = WIDE_LEVEL_SIGMAS
        sigmas[layout.bias] = assumed.range_bias * building_factor
        for bag in range(layout.bags):
            sigmas[layout.ceiling(bag)][1:] = assumed.ceiling * building_factor
        for number in range(layout.walls):
            sigmas[layout.wall(number).stop - 1] = assumed.vertical * building_factor
        for place in range(layout.places):
            sigmas[layout.roll_pitch(place)] = assumed.base_tilt
        return means, sigmas


GRAZING = 0.2
"""Fraction of `Problem.blur` for a beam that grazes its plane, as range errors are multiplied by
the cosine of incidence (chosen: without it, a scale that shrinks a room would make it flat)."""

CLUSTER_SIZE = 0.5
"""Edge of a cluster cell on a plane, m (chosen)."""


def _clusters(points: Float64, plane: Int64, place: Int64, normals: Float64) -> Int64:
    """Return the cluster number of each point: a cell of a plane at a place."""
    drop = np.argmax(np.abs(normals), axis=1)
    rows = np.arange(len(points))
    u, v = points[rows, (drop + 1) % 3], points[rows, (drop + 2) % 3]
    cell_u, cell_v = ((np.floor(w / CLUSTER_SIZE).astype(np.int64) % 4096) for w in (u, v))
    keys = ((place * 4096 + plane) * 4096 + cell_u) * 4096 + cell_v
    result: Int64 = np.unique(keys, return_inverse=True)[1]
    return result
