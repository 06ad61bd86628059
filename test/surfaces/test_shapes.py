"""Surfaces have the outlines of furniture, and edges say whether they were seen."""

import numpy as np
import pytest
from room import Board, Room, Screen
from shapely import Polygon
from surface_maps import above_floor, build, overlap

from tccm_ros.records import EdgeState, SurfaceShape

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


def test_what_was_seen_is_kept_beside_the_model(table):
    seen = Polygon(table.boundary_seen[:, :2])
    assert table.area_seen == pytest.approx(seen.area, rel=1e-6)
    assert len(table.boundary_seen) > len(table.boundary)
    assert table.area == pytest.approx(Polygon(table.boundary[:, :2]).area, rel=1e-6)


def test_two_views_know_the_edges_better_than_one(table):
    looks = [(Room([TABLE]), HERE, 10), (Room([TABLE]), (0.5, 1.6, -1.0), 20)]
    (both,) = above_floor(build(looks))
    assert np.nanmean([e.sigma for e in both.edges]) < np.nanmean([e.sigma for e in table.edges])


def test_an_edge_behind_a_higher_object_was_not_seen():
    screen = Screen(1.0, -0.7, 1.0, 0.1, 1.4)
    (found,) = above_floor(build([(Room([TABLE], [screen]), HERE, 10)]))
    assert any(edge.state is not EdgeState.SEEN for edge in found.edges)
