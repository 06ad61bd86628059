"""All planes of a map, by pooled moments: exact least-squares fits without touching a point.

The detector works on cuboid moments alone. `blocks` pools cuboids into flat patches,
`region_growing` grows regions of patches, `inliers` assigns cuboids to them, and `search` splits
them into connected sets and fits these. Planes of any tilt are found at once, each as exactly as by
a least-squares fit to the points of its cuboids.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, Cuboids
from tccm_ros.cuboids.moments import FLAT, tangents, uncertainty_of
from tccm_ros.outlines.boundary import Outline, members_by_plane, outlines
from tccm_ros.planes.arrays import PLANE, PlaneTable
from tccm_ros.planes.search import planes_of
from tccm_ros.records import PlaneKind


@dataclass(frozen=True, eq=False)
class PlaneCuboids:
    """The cuboids of all planes of a map, sorted by plane on first use.

    Attributes
    ----------
    cuboids, labels
        The map, and the plane of each of its cuboids.
    normals, offsets
        float64 (F, 3) and (F,), the planes.
    """

    cuboids: Cuboids
    labels: Int32
    normals: Float64
    offsets: Float64

    @cached_property
    def _sorted(self) -> tuple[Int64, Int64]:
        return members_by_plane(self.labels, len(self.offsets))

    @cached_property
    def outlines(self) -> list[Outline]:
        """The outline of each plane."""
        return outlines(self.cuboids, *self._sorted, self.normals, self.offsets)

    def members(self, index: int) -> Int64:
        """Return the indices of a plane's cuboids, rising."""
        members, starts = self._sorted
        return members[starts[index] : starts[index + 1]]


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """One plane of a map, in its frame. Outline and covariance are computed on first use.

    Attributes
    ----------
    index
        Label of its cuboids in `PlaneFits.labels`.
    kind
        Whether it is horizontal within `planes.horizontal_angle`.
    normal, offset
        Unit normal float64 (3,) and offset, m: ``normal . p = offset``. Horizontal normals point
        up, others towards the viewpoint.
    support
        Points of all its cuboids.
    rms
        Standard deviation of the fit's points across the plane, m.
    moments, origin
        Moments float64 (10,) of the points used in the fit, about an origin, m.
    plane_cuboids
        The cuboids of this and the other planes of the map.
    """

    index: int
    kind: PlaneKind
    normal: Float64
    offset: float
    support: int
    rms: float
    moments: Float64
    origin: tuple[float, float, float]
    plane_cuboids: PlaneCuboids

    @cached_property
    def centroid(self) -> Float64:
        """Mean of the points used in the fit, float64 (3,), m."""
        return self.moments[1:4] / self.moments[0] + self.origin

    @cached_property
    def tangents(self) -> tuple[Float64, Float64]:
        """Horizontal direction u and slope direction v; (u, v, normal) is right-handed."""
        return tangents(self.normal)

    @property
    def covariance(self) -> Float64:
        """Covariance (3, 3) of (rotation about u, rotation about v, offset at the centroid).

        In rad and m, of a least-squares fit with equal, independent noise `rms` of all points.
        """
        return self._uncertainty[0]

    @property
    def quality(self) -> float:
        """Plane quality, l1 l2 / l3 of the points' covariance, m2 (Eq. 8 of the TCCM paper)."""
        return float(self._uncertainty[1])

    @cached_property
    def _uncertainty(self) -> tuple[Float64, float]:
        return uncertainty_of(self.moments, self.normal, max(self.rms**2, FLAT))

    @cached_property
    def members(self) -> Int64:
        """Indices of the plane's cuboids, rising."""
        return self.plane_cuboids.members(self.index)

    @cached_property
    def outline(self) -> Outline:
        """The outline, with holes. The first access computes the outlines of all planes."""
        return self.plane_cuboids.outlines[self.index]

    @property
    def boundary(self) -> Float64:
        """Outer ring of `outline`."""
        return self.outline.boundary

    @property
    def holes(self) -> tuple[Float64, ...]:
        """Inner rings of `outline`."""
        return self.outline.holes

    @property
    def area(self) -> float:
        """Area of `outline`, m2."""
        return self.outline.area


class PlaneFits(Sequence[PlaneFit]):
    """The planes of one map, by falling support, and the label of each cuboid.

    Attributes
    ----------
    cuboids
        The map.
    labels
        int32 (N,), index of each cuboid's plane, -1 for none.
    """

    def __init__(self, cuboids: Cuboids, labels: Int32, rows: PlaneTable, origin: Float64) -> None:
        self.cuboids = cuboids
        self.labels = labels
        self._rows = rows
        self._origin = origin

    @cached_property
    def _fits(self) -> list[PlaneFit]:
        """One `PlaneFit` per row of `search.segment`."""
        rows = self._rows
        normals, offsets = rows["normal"].copy(), rows["offset"].copy()
        plane_cuboids = PlaneCuboids(self.cuboids, self.labels, normals, offsets)
        x, y, z = self._origin.tolist()
        return [
            PlaneFit(
                index=index,
                kind=PlaneKind.HORIZONTAL if row["is_horizontal"] else PlaneKind.ANY,
                normal=normals[index],
                offset=float(row["offset"]),
                support=round(float(row["support"])),
                rms=math.sqrt(row["variances"][2]),
                moments=row["moments"],
                origin=(x, y, z),
                plane_cuboids=plane_cuboids,
            )
            for index, row in enumerate(rows)
        ]

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index):  # type: ignore[no-untyped-def]
        return self._fits[index]

    def __iter__(self) -> Iterator[PlaneFit]:
        return iter(self._fits)


def find_planes(cuboids: Cuboids, config: Config, viewpoint: ArrayLike) -> PlaneFits:
    """Return all planes of a part map or an integration map.

    Parameters
    ----------
    cuboids
        The map.
    config
        Group `planes`.
    viewpoint
        (3,), m, position of the laser in the map's frame. Normals of planes that are not horizontal
        point towards it.

    Returns
    -------
    PlaneFits
        Deterministic: the same cuboids give the same planes in the same order.
    """
    view = np.ascontiguousarray(viewpoint, float)
    origin = np.rint(view * TICKS_PER_M)
    if len(cuboids) == 0:
        none = np.full(0, -1, np.int32)
        return PlaneFits(cuboids, none, np.zeros(0, PLANE), origin * TICK)
    p = config.planes
    limits = p.max_rms, float(p.min_points), p.min_area, p.flatness, math.cos(p.horizontal_angle)
    caps = cuboids.caps.of, cuboids.caps.moments
    labels, rows = planes_of(cuboids.arrays, caps, origin, view, limits)
    return PlaneFits(cuboids, labels, rows, origin * TICK)
