"""A compartment: the space between a board and its ceiling, open at least at its front."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from shapely import Polygon

from tccm_ros.arrays import Bool, Float64
from tccm_ros.cuboids.free_columns import FreeColumns


class FaceState(StrEnum):
    """Observation state of a side, the back or the ceiling of a compartment."""

    MEASURED = "measured"
    """Beams ended on it."""
    OPEN = "open"
    """Beams passed through it."""
    UNKNOWN = "unknown"
    """Too few beams for a decision between open and closed."""


class SeenView(NamedTuple):
    """Measurements of one view in the space near its surfaces.

    Attributes
    ----------
    T_map_view
        float64 (4, 4).
    viewpoint
        float64 (3,), position of the sensor in the view's frame, m.
    hits
        float64 (M, 4), as in `ViewIntervals`.
    free
        Observed free columns, in the view's frame.
    """

    T_map_view: Float64
    viewpoint: Float64
    hits: Float64
    free: FreeColumns


@dataclass(frozen=True, slots=True, eq=False)
class SpaceGrid:
    """Cells of the space in a compartment and before its front, along the compartment's axes.

    Attributes
    ----------
    corner
        float64 (3,), lowest corner of the first cell, m.
    cell
        Edge of a cell, m.
    seen
        bool (X, Y, Z), whether beams passed a cell, or passed cells on both sides of it.
    hit
        bool (X, Y, Z), whether beams ended in it.
    """

    corner: Float64
    cell: float
    seen: Bool
    hit: Bool


class OpenPart(NamedTuple):
    """A part that stands open before a front, as a door or a drawer.

    Attributes
    ----------
    T_map_part
        float64 (4, 4), pose of the centre of its box; x is along its longer horizontal side, z up.
    size
        float64 (3,), edges of the box, m.
    """

    T_map_part: Float64
    size: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Compartment:
    """The space over a board, or over a part of it.

    Attributes
    ----------
    rack
        Id of the lowest board of its rack.
    board
        Id of the surface below it.
    above
        Id of the surface that is its ceiling; None if the ceiling belongs to no mapped surface.
    T_map_front
        float64 (4, 4): the middle of the front edge, on the board; x is the direction of insertion,
        y is to the left, z is up.
    width, depth, height
        Clear lengths along y, x and z, m. A face that was not measured is assumed at the edge of
        the board, an underside that was not measured at `MAX_BOARD` below the top of its board.
    left, right, back, ceiling
        Observation states of its faces.
    front_seen
        Fraction of its front through which beams passed, 0 to 1.
    space
        Free, occupied and unseen space in it.
    open_parts
        Doors and drawers that stand open before its front, from left to right.
    """

    rack: int
    board: int
    above: int | None
    T_map_front: Float64
    width: float
    depth: float
    height: float
    left: FaceState
    right: FaceState
    back: FaceState
    ceiling: FaceState
    front_seen: float
    space: SpaceGrid
    open_parts: tuple[OpenPart, ...] = ()

    @property
    def front(self) -> Float64:
        """Left and right end of its front edge, seen from outside, float64 (2, 3), in map, m."""
        half = np.array([[0.5], [-0.5]]) * self.width
        return np.asarray(self.T_map_front[:3, 3] + half * self.T_map_front[:3, 1])

    @property
    def outline(self) -> Polygon:
        """Outline of the compartment seen from above, in map, m."""
        x, y = np.array([0.0, self.depth]), 0.5 * self.width
        corners = np.array([[x[0], -y], [x[1], -y], [x[1], y], [x[0], y]])
        T = self.T_map_front
        return Polygon(corners @ T[:2, :2].T + T[:2, 3])
