"""Surfaces have the outlines of furniture, and edges say whether they were seen."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from room import Board, Room, Screen
from shapely import Polygon, affinity
from surface_maps import above_floor, build, overlap, poses_at

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.outlines.edge_position import EdgeSamples, locate_edge
from tccm_ros.records import EdgeState, SurfaceShape
from tccm_ros.surfaces.edges import shapes
from tccm_ros.surfaces.edges.shapes import (
    _reaches_wall,
    _yaws,
    downweight_wall_points,
)

HERE = (0.0, 0.0, 0.0)
TABLE = Board(1.6, 0.0, 0.8, 1.2, 0.74)


@pytest.fixture(scope="module")
def table():
    (found,) = above_floor(build([(Room([TABLE]), HERE, 10)]))
    return found


def test_a_table_is_a_rectangle_with_four_corners(table):
    assert table.shape is SurfaceShape.RECTANGLE
    assert len(table.boundary) == len(table.edges) == 4
    # The first scan line is 4 cm behind the near edge of a board without a front.
    assert overlap(table, TABLE) > 1.0 - 0.10


def test_edges_are_those_of_the_boundary(table):
    starts = np.array([edge.start for edge in table.edges])
    ends = np.array([edge.end for edge in table.edges])
    assert starts == pytest.approx(table.boundary)
    assert ends == pytest.approx(np.roll(table.boundary, -1, axis=0))


def test_a_seen_edge_has_a_deviation_and_another_has_none(table):
    for edge in table.edges:
        assert np.isfinite(edge.sigma) == (edge.state is EdgeState.SEEN)
    assert sum(edge.state is EdgeState.SEEN for edge in table.edges) >= 3


def test_observed_outline_is_kept_beside_the_model(table):
    seen = Polygon(table.boundary_seen[:, :2])
    assert table.area_seen == pytest.approx(seen.area, rel=1e-6)
    assert 0.9 * table.area < table.area_seen < table.area
    assert table.area == pytest.approx(Polygon(table.boundary[:, :2]).area, rel=1e-6)


@pytest.mark.parametrize("unseen", [EdgeState.CUT, EdgeState.HIDDEN])
@pytest.mark.parametrize("seen", [0, 1])
def test_model_needs_one_observed_edge(monkeypatch, unseen, seen):
    states = itertools.chain([EdgeState.SEEN] * seen, itertools.repeat(unseen))
    monkeypatch.setattr(shapes, "_state", lambda *_: next(states))
    (found,) = above_floor(build([(Room([TABLE]), HERE, 10)]))
    assert found.shape is (SurfaceShape.RECTANGLE if seen else SurfaceShape.FREE)
    assert (found.area > found.area_seen * (1.0 + 1e-6)) == bool(seen)


def test_two_views_know_the_edges_better_than_one(table):
    looks = [(Room([TABLE]), HERE, 10), (Room([TABLE]), (0.5, 1.6, -1.0), 20)]
    (both,) = above_floor(build(looks))
    assert np.nanmean([e.sigma for e in both.edges]) < np.nanmean([e.sigma for e in table.edges])


def test_an_edge_behind_a_higher_object_was_not_seen():
    screen = Screen(1.0, -0.7, 1.0, 0.1, 1.4)
    (found,) = above_floor(build([(Room([TABLE], [screen]), HERE, 10)]))
    assert any(edge.state is not EdgeState.SEEN for edge in found.edges)


BOARD = Board(1.6, 0.0, 0.5, 1.6, 0.75)
FRONT = Screen(1.35, -0.8, 1.35, 0.8, 0.74)
"""A sideboard from x = 1.35 to 1.85 m, and its front, which the level laser sees."""

REAR = np.array([[[1.86, -3.0], [1.86, -0.85]], [[1.86, 0.85], [1.86, 2.0]]])
"""A wall behind it, of which it hides a part."""


def shape_of(screens, walls):
    room = Room([BOARD], [FRONT, *screens])
    surface_map = SurfaceSlam(Config()).map
    for record in room.look(HERE, 10):
        surface_map.add(record)
    (found,) = above_floor(surface_map.build(poses_at(spatial(np.array([HERE]))), walls))
    return found


def objects(*places, top=1.0):
    """Screens that stand on the sideboard."""
    return [Screen(x, y - half, x, y + half, top) for x, y, half in places]


CLUTTER = objects((1.5, -0.6, 0.2), (1.76, -0.32, 0.08), (1.55, -0.04, 0.2), (1.5, 0.36, 0.2),
                  (1.6, 0.68, 0.12))  # fmt: skip
"""All of the rear is hidden, and most of the board up to 1.55 m."""


def test_a_rear_that_objects_hide_is_at_the_wall_behind_it():
    without, found = shape_of(CLUTTER, np.zeros((0, 2, 2))), shape_of(CLUTTER, REAR)
    assert found.boundary[:, 0].max() == pytest.approx(1.86, abs=0.01)
    assert overlap(found, BOARD) > overlap(without, BOARD)
    rear = max(found.edges, key=lambda edge: edge.start[0] + edge.end[0])
    assert rear.state is not EdgeState.SEEN
    assert found.area_seen < 0.97 * found.area


RAGGED = np.r_[np.linspace(-0.11, -0.05, 12), -0.02, -0.01, -0.01]


@pytest.mark.parametrize(
    ("last", "wall", "ends", "beyond", "reaches"),
    [
        (RAGGED, 0.08, False, -0.01, True),
        (RAGGED, 0.15, False, -0.01, False),  # too far
        (RAGGED, 0.08, True, -0.01, False),  # views looked past the edge
        (RAGGED, 0.08, False, 0.2, False),  # the surface goes on beyond the wall
        (np.full(15, -0.01), 0.08, False, -0.01, False),  # it ends in line
    ],
)
def test_a_hidden_edge_near_a_wall_is_at_the_wall(last, wall, ends, beyond, reaches):
    samples = last_points(np.linspace(0.0, 1.0, 15), last, gap=0.01)
    samples = samples._replace(ends=np.full(15, ends))
    points = SimpleNamespace(
        furthest=lambda limit=np.inf: min(beyond, limit),
        is_ragged=lambda limit: np.mean(last < min(beyond, limit) - 0.03) > 0.5,
    )
    assert _reaches_wall(points, samples, wall) == reaches


def test_a_rear_that_ends_in_line_before_a_wall_stays_there():
    """Nothing hides it, and the wall 6 cm behind is no reason to go on."""
    found = shape_of([], REAR + np.array([0.05, 0.0]))
    assert found.boundary[:, 0].max() == pytest.approx(1.85, abs=0.025)


CRATE = Screen(1.3, 0.35, 1.3, 0.85, 1.05)
"""Something that stands on its right third, and hides that."""


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        (0.8, 0.8),  # the front goes on as far as the board
        (0.6, 0.48),  # a side panel, or the arm of a sofa: it has the same front
    ],
)
def test_a_top_goes_on_as_far_as_its_front(end, expected):
    front = np.array([[[1.39, -0.8], [1.39, end]]])
    hidden = shape_of([CRATE], np.zeros((0, 2, 2)))
    assert hidden.boundary[:, 1].max() < 0.5
    found = shape_of([CRATE], front)
    assert found.boundary[:, 1].max() == pytest.approx(expected, abs=0.1)
    left = max(found.edges, key=lambda edge: edge.start[1] + edge.end[1])
    assert left.state is not EdgeState.SEEN


def test_a_cabinet_beside_a_worktop_is_none():
    """It is as high as the room, so no view looked over it."""
    front = np.array([[[1.39, -0.8], [1.39, 0.8]]])
    found = shape_of([replace(CRATE, top=2.5)], front)
    assert found.boundary[:, 1].max() < 0.5


@pytest.mark.parametrize("yaw", [-0.6, 0.0, 0.3, 0.7])
def test_the_main_direction_is_that_of_the_long_edges(yaw):
    """The one with which most of the squares of lengths agree, modulo right angles."""
    ring = np.array([(0, 0), (2.0, 0.0), (2.1, 0.4), (2.0, 0.8), (1.6, 1.1), (0, 1.1), (-0.2, 0.5)])
    outline = affinity.rotate(Polygon(ring), yaw, origin=(0, 0), use_radians=True)
    steps = np.diff(np.asarray(outline.exterior.coords), axis=0)
    directions = np.linspace(-np.pi / 4, np.pi / 4, 20001)
    off = np.arctan2(steps[:, 1], steps[:, 0]) - directions[:, None]
    expected = directions[np.argmax(np.cos(4.0 * off) @ np.square(np.hypot(*steps.T)))]
    box, main, longest = _yaws(outline)
    assert (main - expected + np.pi / 4) % (np.pi / 2) == pytest.approx(np.pi / 4, abs=1e-3)
    assert abs(np.sin(longest - yaw)) == pytest.approx(0.0, abs=1e-9)
    sides = np.asarray(outline.minimum_rotated_rectangle.exterior.coords)
    side = sides[1] - sides[0]
    assert np.sin(2.0 * (box - np.arctan2(side[1], side[0]))) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("on_wall", [0, 4, 8])
def test_points_of_a_wall_do_not_carry_a_board_on_to_it(on_wall):
    """A board ends 0.12 m before a wall, as five lines show; the wall has points at its height."""
    last = np.r_[np.full(5, -0.125), np.full(on_wall, -0.004)]
    found = last_points(np.linspace(0.0, 0.4, len(last)), last, gap=0.02)
    found = found._replace(ends=np.arange(len(last)) < 5)
    position, _ = locate_edge(downweight_wall_points(found, 0.0), 0.0)
    assert position == pytest.approx(-0.115, abs=0.012)


def test_a_board_that_reaches_a_wall_ends_there():
    last = np.r_[np.full(3, -0.025), np.full(5, -0.004)]
    found = last_points(np.linspace(0.0, 0.4, 8), last, gap=0.03)
    found = found._replace(ends=np.zeros(8, bool))
    position, _ = locate_edge(downweight_wall_points(found, 0.0), 0.0)
    assert position == pytest.approx(0.0, abs=0.006)
    assert downweight_wall_points(found, None) is found


def last_points(at, last, gap):
    n = len(at)
    return EdgeSamples(at, last, np.full(n, gap), np.zeros(n), np.ones(n, bool), np.ones(n))
