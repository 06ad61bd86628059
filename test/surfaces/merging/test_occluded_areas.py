"""Occluded areas of a surface are part of it; areas that a view looked through are not."""

from dataclasses import replace

import numpy as np
import pytest
from room import Board, Room, Screen
from shapely import Polygon
from surface_maps import above_floor, build, overlap

HERE = (0.0, 0.0, 0.0)


class OneSurface(Room):
    """A room whose boards are one surface in the surface message."""

    def look(self, pose, stamp_ns):
        cloud, intervals = super().look(pose, stamp_ns)
        return replace(cloud, surface=np.minimum(cloud.surface, 1)), intervals


def u_shape(gap):
    """Return three boards that are a table with a notch in its near side."""
    side = 0.5 * (1.4 - gap)
    return [
        Board(1.9, 0.0, 0.3, 1.4, 0.74),
        Board(1.5, 0.5 * (gap + side), 0.5, side, 0.74),
        Board(1.5, -0.5 * (gap + side), 0.5, side, 0.74),
    ]


def filled_fraction(surface, gap):
    hole = Polygon([(1.3, -0.4 * gap), (1.7, -0.4 * gap), (1.7, 0.4 * gap), (1.3, 0.4 * gap)])
    return Polygon(surface.boundary[:, :2]).intersection(hole).area / hole.area


@pytest.mark.parametrize("gap", [0.25, 0.4])
def test_a_gap_that_was_looked_through_stays_open(gap):
    (table,) = above_floor(build([(OneSurface(u_shape(gap)), HERE, 10)]))
    assert filled_fraction(table, gap) < 0.2


def test_the_shadow_of_an_object_is_closed():
    """A box 0.3 m wide on a table hides the area behind it, up to the far edge of the table."""
    board = Board(1.6, 0.0, 1.0, 1.4, 0.74)
    box = Screen(1.45, -0.15, 1.45, 0.15, 1.1)
    (table,) = above_floor(build([(Room([board], [box]), HERE, 10)]))
    (alone,) = above_floor(build([(Room([board]), HERE, 10)]))
    assert overlap(table, board) > overlap(alone, board) - 0.05
    assert np.isfinite(table.boundary).all()
