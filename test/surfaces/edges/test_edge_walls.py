"""Walls beside the edges of a surface: those behind it, hidden by it, and the front below it."""

import numpy as np
import pytest
from shapely import Polygon

from tccm_ros.surfaces.edges.edge_samples import Edge
from tccm_ros.surfaces.edges.edge_walls import (
    front_beyond,
    wall_across,
    walls_near,
)


@pytest.mark.parametrize("angle", [-0.04, 0.0, 0.05])
@pytest.mark.parametrize("yaw", [-2.0, 0.0, 1.1, 3.0])
@pytest.mark.parametrize("backwards", [False, True])
def test_an_edge_along_a_wall_is_so_far_from_it(yaw, angle, backwards):
    """The distance across is that of the foot of its middle."""
    c, s = np.cos(yaw), np.sin(yaw)
    start = np.array([2.0, -1.0])
    edge = Edge(start, start + 0.8 * np.array([c, s]))
    middle, beside = 0.5 * (edge.start + edge.end), 0.04
    along = np.array([np.cos(yaw + angle), np.sin(yaw + angle)])
    foot = middle + beside * np.array([along[1], -along[0]])
    wall = np.array([foot - 2.0 * along, foot + 1.5 * along])
    walls = np.array([wall[::-1] if backwards else wall, wall + 5.0])
    assert wall_across(edge, walls) == pytest.approx(beside * np.cos(angle), abs=1e-9)
    assert wall_across(edge, walls[1:]) is None


def placed(points, yaw):
    """Points about the origin, rotated and moved, so that no axis is special."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(points, float) @ np.array([[c, s], [-s, c]]) + [3.0, -1.0]


def hidden_walls(top, walls):
    """The walls near an outline that are none of the map."""
    return [w for w in walls_near(top, walls) if not (w == walls).all(axis=(1, 2)).any()]


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.1])
@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_a_wall_goes_on_behind_furniture_that_hides_it(yaw, offset):
    """A sideboard from x = 0 to 1.6 m, before a wall of which its two sides are seen."""
    top = Polygon(placed([[0, -0.45], [1.6, -0.45], [1.6, 0], [0, 0]], yaw))
    left = placed([[-2.0, 0.0], [-0.05, 0.0]], yaw)
    right = placed([[1.65, offset], [2.4, offset]], yaw)
    (behind,) = hidden_walls(top, np.stack([left, right]))
    ends = placed([[-0.05, 0.0], [1.65, 0.0]], yaw)
    assert {tuple(end) for end in behind.round(9)} == {tuple(end) for end in ends.round(9)}


@pytest.mark.parametrize(
    "other",
    [
        [[1.65, 0.1], [2.4, 0.1]],  # another face, 10 cm further back
        [[1.65, 0.0], [2.4, 0.2]],  # another direction
        [[1.65, -1.0], [2.4, -1.0]],
    ],
)
def test_walls_on_two_lines_have_nothing_between(other):
    top = Polygon([[0, -0.45], [1.6, -0.45], [1.6, 0], [0, 0]])
    walls = np.array([[[-2.0, 0.0], [-0.05, 0.0]], other])
    assert not hidden_walls(top, walls)


def test_wall_between_other_fronts_does_not_bound_a_table_across_it():
    table = Polygon([[0, -0.3], [1.0, -0.3], [1.0, 0.3], [0, 0.3]])
    fronts = np.array([[[-2.0, 0.0], [-0.05, 0.0]], [[1.05, 0.0], [2.4, 0.0]]])
    assert not hidden_walls(table, fronts)
    assert len(hidden_walls(table, fronts + np.array([0.0, 0.25]))) == 1


def test_a_doorway_that_is_not_beside_the_surface_stays_open():
    top = Polygon([[3.0, -0.45], [4.6, -0.45], [4.6, 0.0], [3.0, 0.0]])
    walls = np.array([[[-2.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [2.95, 0.0]]])
    assert not hidden_walls(top, walls)


@pytest.mark.parametrize("yaw", [0.0, 1.3, 3.0])
@pytest.mark.parametrize(("overhang", "goes_on"), [(0.0, True), (0.025, True), (0.05, False)])
def test_a_front_goes_on_beyond_the_end_of_an_edge(yaw, overhang, goes_on):
    """The front of a block from x = -0.6 to 1.4 m, its top seen from x = 0 on."""
    edge = Edge(*placed([[0.0, 0.0], [1.4, 0.0]], yaw))
    front = placed([[-0.6, overhang], [1.4, overhang]], yaw)
    left, right = -edge.along, edge.along
    assert front_beyond(edge, left, front[None]) == pytest.approx(0.6 if goes_on else 0.0)
    assert front_beyond(edge, right, front[None]) == 0.0
    assert front_beyond(edge, left, np.zeros((0, 2, 2))) == 0.0


@pytest.mark.parametrize(("end", "beyond"), [(-0.2, 0.0), (-0.6, 0.6)])
def test_a_corner_near_the_end_of_an_edge_may_be_beyond_the_front(end, beyond):
    """The wall map joins the front with a wall across it, from up to 25 cm away."""
    edge = Edge(np.array([0.0, 0.0]), np.array([1.4, 0.0]))
    walls = np.array([[[end, 0.0], [1.4, 0.0]], [[end, 0.0], [end, 2.0]]])
    assert front_beyond(edge, -edge.along, walls) == pytest.approx(beyond)
