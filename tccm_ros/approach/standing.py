"""Goal poses of the base at a surface: on free floor, with the spot within the arm's length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.approach.floor import Floor
from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.geometry import compose2, transform2

SIDE_RAD = np.pi / 4.0
"""Normals within this angle of a side's direction belong to it: four sides cover the outline."""

SLACK_M = 0.01
"""The footprint may be nearer than the gap to other parts of the outline by this, m: half of the
specified accuracy of 2 cm."""

BASE_WEIGHT = 0.3
"""Weight of the distance from the base, relative to that from the middle of a side. Chosen: another
side of a table is better than a corner of the nearest one."""


@dataclass(frozen=True, slots=True, eq=False)
class StandingPose:
    """Goal pose and staging pose of the base at a surface.

    Attributes
    ----------
    pose, staging
        float64 (3,), planar poses of the base: at the surface, and further back on the same normal,
        both facing the edge.
    edge
        float64 (2,), the point of the outline ahead.
    distance
        Horizontal distance of the spot from the base's origin, m; nan without a spot.
    """

    pose: Float64
    staging: Float64
    edge: Float64
    distance: float

    def moved(self, motion: Float64) -> StandingPose:
        """Return the poses after a rigid motion (3,), which moves a point p to motion * p."""
        return StandingPose(
            compose2(motion, self.pose),
            compose2(motion, self.staging),
            transform2(motion, self.edge[None])[0],
            self.distance,
        )


def standing_poses(
    target: Target,
    floor: Floor,
    footprint: Footprint,
    gap: float,
    staging: float,
    max_distance: float,
    spot: Float64 | None,
    side: float | None,
    base: Float64 | None = None,
) -> list[StandingPose]:
    """Return the free goal poses at a surface, the best first.

    With a spot they are sorted by the distance from it. Without one the cost is the distance from
    the middle of the side, plus `BASE_WEIGHT` times the distance from the base.

    Parameters
    ----------
    target, floor, footprint
        The surface, the floor in the same frame, and the base.
    gap
        Distance between the footprint and the edge, m.
    staging
        Length of the final straight motion, m.
    max_distance
        Maximum horizontal distance of the spot from the base's origin, m.
    spot
        float64 (2,), position that the arm must get to.
    side
        Direction from the surface's middle to the wanted side, in its own frame, rad.
    base
        float64 (2,), position of the base.
    """
    points, normals, off_middle = target.edge_points
    outline = target.polygon
    places = points + (gap + footprint.front) * normals
    from_spot = np.full(len(points), np.nan) if spot is None else np.hypot(*(places - spot).T)
    order = off_middle if spot is None else from_spot
    if spot is None and base is not None:
        order = order + BASE_WEIGHT * np.hypot(*(places - base).T)
    is_wanted = np.ones(len(points), bool)
    if spot is not None:
        is_wanted &= from_spot <= max_distance
    if side is not None:
        is_wanted &= target.side_of(normals, side) <= SIDE_RAD + 1e-6
    found = []
    for k in np.argsort(order, kind="stable").tolist():
        if not is_wanted[k]:
            continue
        yaw = float(np.arctan2(-normals[k, 1], -normals[k, 0]))
        pose = np.array([*places[k], yaw])
        back = np.array([*(places[k] + staging * normals[k]), yaw])
        if shapely.distance(Polygon(footprint.at(pose)), outline) < gap - SLACK_M:
            continue
        if floor.is_way_free(footprint, back, pose):
            found.append(StandingPose(pose, back, points[k], float(from_spot[k])))
    return found
