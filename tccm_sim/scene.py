"""Solids of a world: boxes and cylinders, some of which move, appear or vanish."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int64
from tccm_sim import raycast
from tccm_sim.raycast import ABSENT, BOX, CYLINDER, Grid, Solids
from tccm_sim.rigid import rigid, rotation_rpy

Vector = tuple[float, float, float]

CELL = 3.0  # m, of the grid over x, y (chosen: half the time of 0.5 m, as steps cost most)
FEW = 32  # solids; below this number a grid does not pay (chosen)
LARGE = 0.25  # fraction of the cells; larger solids are tested for every ray (chosen)


@dataclass(frozen=True, eq=False)
class Motion:
    """Position of a solid over time, linear between key frames.

    Attributes
    ----------
    times
        float64 (K,), s, increasing.
    offsets
        float64 (K, 4): x, y, z in m and yaw in rad, added to the solid's pose (the yaw about the
        solid's centre).
    """

    times: Float64
    offsets: Float64

    @cached_property
    def turns(self) -> bool:
        """Whether it has a yaw."""
        return bool(self.offsets[:, 3].any())

    def at(self, time: float) -> Float64:
        """Return the offset (x, y, z, yaw) at a time, float64 (4,), constant outside the keys."""
        k = bisect_right(self.times, time)
        if k == 0 or k == len(self.times):
            return self.offsets[max(k - 1, 0)]
        slope = (self.offsets[k] - self.offsets[k - 1]) / (self.times[k] - self.times[k - 1])
        return np.asarray(slope * (time - self.times[k - 1]) + self.offsets[k - 1])

    @staticmethod
    def through(keys: Sequence[Sequence[float]]) -> Motion:
        """Return the motion through rows of (time, x, y, z) or (time, x, y, z, yaw)."""
        rows = np.array([[*key, 0.0][:5] for key in keys], float)
        return Motion(rows[:, 0], rows[:, 1:])


@dataclass(frozen=True, eq=False)
class Solid:
    """A box or cylinder.

    Attributes
    ----------
    shape
        ``box`` or ``cylinder`` (axis z).
    T_world_solid
        float64 (4, 4), pose of its centre.
    half
        Half edges, or (radius, radius, half height), m.
    name
        Name of its object or furniture.
    surface
        Name of the designed horizontal surface that its top is part of, or empty. Tops of equal
        name form one surface.
    role
        ``floor``, ``wall``, ``ceiling``, ``furniture``, ``object`` or ``person``.
    motion, span
        Its motion, and start and end of the time in which it exists, s.
    glass
        Whether it is a box of glass, which only returns beams near normal incidence.
    """

    shape: Literal["box", "cylinder"]
    T_world_solid: Float64
    half: Vector
    name: str
    surface: str = ""
    role: str = "furniture"
    motion: Motion | None = None
    span: tuple[float, float] = (-np.inf, np.inf)
    glass: bool = False

    @property
    def is_still(self) -> bool:
        """Whether it always exists and never moves."""
        return self.motion is None and self.span == (-np.inf, np.inf)

    @property
    def bounding_radius(self) -> float:
        """Radius of its bounding sphere, m."""
        x, y, z = self.half
        return float(np.hypot(x, z) if self.shape == "cylinder" else np.sqrt(x * x + y * y + z * z))

    @property
    def half_extent(self) -> Float64:
        """Half edges of its axis-aligned bounding box, float64 (3,), m."""
        return np.abs(self.T_world_solid[:3, :3]) @ np.asarray(self.half)


class Traits(TypedDict, total=False):
    """Optional attributes of a solid.

    Attributes
    ----------
    surface, role, motion, span, glass
        As in `Solid`.
    """

    surface: str
    role: str
    motion: Motion
    span: tuple[float, float]
    glass: bool


@dataclass
class Scene:
    """A list of solids with methods that add to it.

    Lengths are in m, angles in rad; further keyword arguments are those of `Solid`.

    Attributes
    ----------
    solids
        All solids.
    wall_faces
        (start, end) of each face of a wall, with the free side on the left.
    """

    solids: list[Solid] = field(default_factory=list)
    wall_faces: list[tuple[tuple[float, float], tuple[float, float]]] = field(default_factory=list)

    def box(
        self,
        name: str,
        size: ArrayLike,
        center: ArrayLike,
        rpy: Vector = (0, 0, 0),
        **traits: Unpack[Traits],
    ) -> None:
        """Add a box.

        Parameters
        ----------
        name
            As in `Solid`.
        size
            Edge lengths along its own x, y, z.
        center, rpy
            Its pose in the world.
        """
        x, y, z = np.asarray(size, float) / 2.0
        self.solids.append(Solid("box", rigid(center, rpy), (x, y, z), name, **traits))

    def block(
        self, name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float],
        **traits: Unpack[Traits],
    ) -> None:  # fmt: skip
        """Add an axis-aligned box.

        Parameters
        ----------
        name
            As in `Solid`.
        x, y, z
            Limits of the box.
        """
        low, high = np.array([x, y, z], float).T
        self.box(name, high - low, (low + high) / 2.0, **traits)

    def cylinder(
        self,
        name: str,
        radius: float,
        height: float,
        center: ArrayLike,
        rpy: Vector = (0, 0, 0),
        **traits: Unpack[Traits],
    ) -> None:
        """Add a cylinder.

        Parameters
        ----------
        name
            As in `Solid`.
        radius, height
            Its size; the axis is its own z.
        center, rpy
            Its pose in the world.
        """
        half = (radius, radius, height / 2.0)
        self.solids.append(Solid("cylinder", rigid(center, rpy), half, name, **traits))

    def floor_and_ceiling(
        self, x: tuple[float, float], y: tuple[float, float], height: float | None = None
    ) -> None:
        """Add a floor at z = 0 and a ceiling.

        Parameters
        ----------
        x, y
            Limits of both.
        height
            Height of the ceiling; None for no ceiling.
        """
        self.block("floor", x, y, (-0.1, 0.0), role="floor")
        if height is not None:
            self.block("ceiling", x, y, (height, height + 0.1), role="ceiling")

    def room(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        height: float,
        name: str = "wall",
        thickness: float = 0.1,
    ) -> None:
        """Add four walls, a floor and a ceiling.

        Parameters
        ----------
        x, y
            Limits between the walls.
        height
            Height of the ceiling.
        name, thickness
            As in `wall`.
        """
        self.floor_and_ceiling((x[0] - 0.2, x[1] + 0.2), (y[0] - 0.2, y[1] + 0.2), height)
        corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1]), (x[0], y[0])]
        for start, end in pairwise(corners):
            self.wall(name, start, end, height, thickness)

    def wall(
        self,
        name: str,
        start: tuple[float, float],
        end: tuple[float, float],
        height: float = 2.5,
        thickness: float = 0.1,
        two_sided: bool = False,
    ) -> None:
        """Add a wall.

        Parameters
        ----------
        name
            As in `Solid`.
        start, end
            x, y of the ends of its face; the body is on the right, looking from start to end.
        height, thickness
            Its size.
        two_sided
            Whether the other side is a face, too.
        """
        along = np.subtract(end, start)
        length = float(np.hypot(*along))
        ux, uy = along / length
        middle = np.add(start, end) / 2.0 + thickness / 2.0 * np.array([uy, -ux])
        self.wall_faces.append((start, end))
        if two_sided:
            x, y = thickness * uy, -thickness * ux
            self.wall_faces.append(((end[0] + x, end[1] + y), (start[0] + x, start[1] + y)))
        self.box(
            name,
            (length, thickness, height),
            (*middle, height / 2.0),
            (0.0, 0.0, float(np.arctan2(uy, ux))),
            role="wall",
        )

    def table(
        self,
        name: str,
        size: tuple[float, float],
        height: float,
        center: tuple[float, float],
        yaw: float = 0.0,
        board: float = 0.03,
        **traits: Unpack[Traits],
    ) -> None:
        """Add a table: a board and four legs.

        Parameters
        ----------
        name
            Name of the solids and, by default, of the surface.
        size
            Edge lengths of the top.
        height
            Height of the top.
        center, yaw
            Planar pose of the top.
        board
            Thickness of the top.
        """
        R = rotation_rpy(0.0, 0.0, yaw)[:2, :2]
        place = (*center, height - board / 2.0)
        traits = {"surface": name, **traits}
        self.box(name, (*size, board), place, (0.0, 0.0, yaw), **traits)
        traits["surface"] = ""
        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            x, y = R @ (sx * (size[0] / 2.0 - 0.05), sy * (size[1] / 2.0 - 0.05)) + center
            leg = height - board
            self.box(name, (0.05, 0.05, leg), (x, y, leg / 2.0), (0.0, 0.0, yaw), **traits)

    def person(self, name: str, keys: Sequence[Sequence[float]]) -> None:
        """Add a person, two cylinders, existing from the first to the last (time, x, y)."""
        motion = Motion.through([(t, x, y, 0.0) for t, x, y in keys])
        span = (float(keys[0][0]), float(keys[-1][0]))
        for radius, low, high in ((0.12, 0.0, 0.85), (0.2, 0.85, 1.75)):
            self.cylinder(
                name, radius, high - low, (0.0, 0.0, (low + high) / 2.0),
                role="person", motion=motion, span=span,
            )  # fmt: skip

    def freeze(self) -> FrozenScene:
        """Return the scene with arrays for ray casting."""
        return FrozenScene(tuple(self.solids))


class FrozenScene:
    """A scene with arrays for ray casting.

    Attributes
    ----------
    solids
        All solids, in the order of the codes of `cast`.
    """

    def __init__(self, solids: tuple[Solid, ...]) -> None:
        self.solids = solids
        self._moving = [i for i, solid in enumerate(solids) if not solid.is_still]
        self._arrays = Solids(
            np.array([BOX if s.shape == "box" else CYLINDER for s in solids], np.int8),
            np.array([s.T_world_solid[:3, 3] for s in solids]),
            np.zeros((len(solids), 3)),
            np.array([s.T_world_solid[:3, :3].T for s in solids]),
            np.array([s.half for s in solids], float),
            np.array([s.bounding_radius for s in solids]) + 1e-6,
            np.array([s.glass for s in solids]),
        )
        self._grid = _grid(solids)
        self._interval = np.nan, np.nan

    def cast(
        self,
        origins: Float64,
        directions: Float64,
        times: Float64,
        max_range: float = 100.0,
        interval: tuple[float, float] | None = None,
    ) -> tuple[Float64, Int64]:
        """Return exact ranges and codes of rays, each at its own time.

        Parameters
        ----------
        origins, directions
            float64 (B, 3) in the world, m; unit directions.
        times
            float64 (B,), s in the world's time.
        max_range
            Maximum range, m.
        interval
            Times between which solids move in straight lines, s; by default the first and the last
            of the rays.

        Returns
        -------
        ranges, codes
            As in `raycast.cast`.
        """
        start, end = interval or (float(times[0]), float(times[-1]))
        self._move_solids(start, end)
        return raycast.cast(self._arrays, self._grid, origins, directions, times - start, max_range)

    def cosines(self, origins: Float64, directions: Float64, ranges: Float64, codes: Int64) -> (
        Float64
    ):  # fmt: skip
        """Return the cosines of the angles of incidence, float64 (B,), of the last rays cast.

        Parameters
        ----------
        origins, directions
            As in `cast`.
        ranges, codes
            Results of `cast`; the cosine is 1 without a hit.
        """
        normals = self.normals(origins, directions, ranges, codes)
        cosines = np.abs(np.einsum("bi,bi->b", normals, directions))
        return np.where(codes >= 0, cosines, 1.0)

    def normals(
        self, origins: Float64, directions: Float64, ranges: Float64, codes: Int64
    ) -> Float64:
        """Return unit normals at the hits of the last rays, float64 (B, 3), of either sign.

        Parameters
        ----------
        origins, directions, ranges, codes
            As in `cosines`; the normal is arbitrary without a hit.
        """
        arrays, solid, axis = self._arrays, codes // raycast.FACES, codes % raycast.FACES // 2
        normals = arrays.R_solid_world[solid, axis]
        round_side = np.flatnonzero((arrays.kind[solid] == CYLINDER) & (axis == 0) & (codes >= 0))
        hits = origins[round_side] + ranges[round_side, None] * directions[round_side]
        R = arrays.R_solid_world[solid[round_side]]
        offsets = hits - arrays.center[solid[round_side]]
        radial = offsets - np.einsum("bi,bi->b", offsets, R[:, 2])[:, None] * R[:, 2]
        normals[round_side] = radial / arrays.half[solid[round_side], :1]
        return normals

    def _move_solids(self, start: float, end: float) -> None:
        """Write the poses of moving solids at `start`, and their velocities until `end`."""
        if (start, end) == self._interval:
            return
        self._interval = start, end
        for i in self._moving:
            solid = self.solids[i]
            is_there = solid.span[0] <= start < solid.span[1]
            kind = BOX if solid.shape == "box" else CYLINDER
            self._arrays.kind[i] = kind if is_there else ABSENT
            if solid.motion is None:
                continue
            now = solid.motion.at(start)
            later = solid.motion.at(end) if end > start else now
            self._arrays.center[i] = solid.T_world_solid[:3, 3] + now[:3]
            self._arrays.velocity[i] = (later[:3] - now[:3]) / max(end - start, 1e-9)
            if solid.motion.turns:
                R_world_solid = rotation_rpy(0.0, 0.0, now[3]) @ solid.T_world_solid[:3, :3]
                self._arrays.R_solid_world[i] = R_world_solid.T


def _grid(solids: tuple[Solid, ...]) -> Grid:
    """Sort the static solids into cells; large and moving ones are tested for every ray."""
    boxes = np.array([(s.T_world_solid[:2, 3], s.half_extent[:2]) for s in solids])
    low, high = boxes[:, 0] - boxes[:, 1], boxes[:, 0] + boxes[:, 1]
    origin, span = low.min(axis=0) - 1e-3, high.max(axis=0) - low.min(axis=0) + 2e-3
    is_few = len(solids) <= FEW
    nx, ny = (1, 1) if is_few else (int(n) for n in np.ceil(span / CELL))
    first = np.floor((low - origin) / CELL).astype(int)
    last = np.floor((high - origin) / CELL).astype(int)
    covered = np.prod(last - first + 1, axis=1)
    everywhere, cells = [], [[] for _ in range(nx * ny)]  # type: ignore[var-annotated]
    for i, solid in enumerate(solids):
        if is_few or not solid.is_still or covered[i] > LARGE * nx * ny:
            everywhere.append(i)
            continue
        for cx in range(first[i, 0], last[i, 0] + 1):
            for cy in range(first[i, 1], last[i, 1] + 1):
                cells[cx * ny + cy].append(i)
    start = np.cumsum([0, *(len(items) for items in cells)])
    items = np.array([i for cell in cells for i in cell], np.int64)
    return Grid(origin, CELL, nx, ny, start, items, np.array(everywhere, np.int64))
