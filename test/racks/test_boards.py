"""Boards of racks: pieces of one board, and what hidden edges do not tell."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from outlined_surfaces import surface
from shapely import Point, Polygon, affinity, box

from tccm_ros.racks.boards import board_frame, completed_boards, whole_boards, with_seen_sides
from tccm_ros.racks.ceilings import Ceiling
from tccm_ros.racks.compartment import FaceState
from tccm_ros.records import EdgeState, SurfaceEdge


def board_of(outline, number, *hidden):
    """Return a board with its edges: those of the given indices are hidden, the others seen."""
    board = surface(outline, number=number, label="shelf")
    ends = zip(board.boundary, np.roll(board.boundary, -1, axis=0))
    edges = (
        SurfaceEdge(a, b, EdgeState.HIDDEN, np.nan)
        if k in hidden
        else SurfaceEdge(a, b, EdgeState.SEEN, 0.007)
        for k, (a, b) in enumerate(ends)
    )
    return replace(board, edges=tuple(edges))


def sides(board):
    """Return the directions of the outward normals of a board's edges, in quarter turns."""
    way = np.roll(board.boundary, -1, axis=0) - board.boundary
    return np.round(np.arctan2(-way[:, 0], way[:, 1]) / (0.5 * np.pi)).astype(int) % 4


def test_a_board_that_was_seen_in_three_pieces_is_one_in_any_order():
    """The middle piece is the smallest: the outer ones fill too little of a board without it."""
    spans = (0.0, 0.5), (0.85, 1.25), (0.5, 0.85)
    cut = [surface(box(a, 0.0, b, 0.3), number=k) for k, (a, b) in enumerate(spans)]
    for order in permutations(cut):
        (whole,) = whole_boards(order)
        assert whole.id == 0
        assert whole.area == pytest.approx(1.25 * 0.3)
        assert whole.boundary[:, 0].max() == pytest.approx(1.25)


def test_boards_that_are_far_from_each_other_or_at_two_heights_stay_two():
    whole, other = surface(box(0.0, 0.0, 0.5, 0.3), number=0), box(0.5, 0.0, 0.9, 0.3)
    for board in (
        surface(other, height=0.77, number=1),
        surface(box(0.9, 0.0, 1.3, 0.3), number=1),
    ):
        assert whole_boards([board, whole]) == [whole, board]


def test_board_extends_past_a_hidden_edge_to_the_seen_edge_of_another():
    upper = board_of(box(0.0, 0.0, 0.9, 0.34), 1)
    lower = box(0.0, 0.0, 0.7, 0.30)
    right, back = (sides(surface(lower)).tolist().index(k) for k in (0, 1))
    for hidden, bounds in (
        ((), (0.7, 0.30)),
        ((back,), (0.7, 0.34)),
        ((right,), (0.9, 0.30)),
        ((right, back), (0.9, 0.34)),
    ):
        whole, _ = completed_boards([board_of(lower, 0, *hidden), upper])
        np.testing.assert_allclose(whole.boundary[:, :2].max(axis=0), bounds, atol=1e-3)
        np.testing.assert_allclose(whole.boundary[:, :2].min(axis=0), 0.0, atol=1e-3)
    unseen = board_of(box(0.0, 0.0, 0.9, 0.34), 1, 0, 1, 2, 3)
    whole, _ = completed_boards([board_of(lower, 0, right, back), unseen])
    np.testing.assert_allclose(whole.boundary[:, :2].max(axis=0), (0.7, 0.30), atol=1e-3)


def test_a_board_continues_to_the_corner_between_two_hidden_edges():
    upper = board_of(box(0.0, 0.0, 0.9, 0.34), 1)
    lower = box(0.0, 0.0, 0.7, 0.1)
    hidden = [sides(surface(lower)).tolist().index(k) for k in (0, 1)]
    for edges, area in ((hidden, 0.9 * 0.34), (hidden[:1], 0.9 * 0.1), (hidden[1:], 0.7 * 0.34)):
        whole, _ = completed_boards([board_of(lower, 0, *edges), upper])
        assert Polygon(whole.boundary[:, :2]).area == pytest.approx(area, rel=0.01)


def test_the_shadow_of_an_object_on_a_long_board_is_a_part_of_it():
    """Its sides are further from the ends than a board continues; its end there was seen."""
    upper = board_of(box(0.0, 0.0, 1.8, 0.34), 1)
    shadow = box(0.8, 0.2, 1.0, 0.34)
    lower = Polygon(box(0.0, 0.0, 1.8, 0.34) - shadow)
    board = surface(lower, number=0)
    inner = [k for k, p in enumerate(board.boundary) if shadow.buffer(0.01).contains(Point(p[:2]))]
    hidden = [k for k in inner if (k + 1) % len(board.boundary) in inner and sides(board)[k] != 1]
    whole, _ = completed_boards([board_of(lower, 0, *hidden), upper])
    assert len(hidden) == 2
    assert Polygon(whole.boundary[:, :2]).area == pytest.approx(1.8 * 0.34, abs=1e-3)


def test_board_does_not_extend_past_its_seen_edge():
    """The top of an open door of the same height is a part of the board above."""
    spur = [(0.0, 0.0), (0.7, 0.0), (0.9, -0.3), (0.9, 0.34), (0.0, 0.34)]
    upper = board_of(Polygon(spur), 1)
    lower = box(0.0, 0.03, 0.9, 0.34)
    front = sides(surface(lower)).tolist().index(3)
    whole, _ = completed_boards([board_of(lower, 0, front), upper])
    assert whole.boundary[:, 1].min() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("depth", "expected"), [(0.32, 0.304), (0.4, 0.3)])
def test_a_side_is_the_mean_of_edges_that_agree_and_else_the_inner_one(depth, expected):
    lower, upper = board_of(box(0.0, 0.0, 0.9, 0.3), 0), board_of(box(0.0, 0.0, 0.9, depth), 1)
    lower, upper = (
        replace(board, edges=tuple(replace(e, sigma=sigma) for e in board.edges))
        for board, sigma in ((lower, 0.01), (upper, 0.02))
    )
    ceiling = Ceiling(np.zeros(2), np.array([0.9, 0.3]), 0.35, FaceState.MEASURED, 1)
    found = with_seen_sides(ceiling, [lower, upper], np.eye(4))
    np.testing.assert_allclose(found.high, [0.9, expected])
    np.testing.assert_allclose(found.low, 0.0, atol=1e-12)


def test_the_axes_of_a_compartment_are_those_of_seen_edges():
    """A rectangle turns as far as its hidden edges let it."""
    upper = board_of(affinity.rotate(box(0.0, 0.0, 0.9, 0.34), 20.0), 1)
    lower = board_of(affinity.rotate(box(0.0, 0.0, 0.9, 0.34), 24.0), 0, 0, 1, 2, 3)
    for board, stack, degrees in ((lower, [lower, upper], 20.0), (lower, [lower], 24.0)):
        T = board_frame(board, stack)
        yaw = np.degrees(np.arctan2(T[1, 0], T[0, 0])) % 90.0
        assert yaw == pytest.approx(degrees, abs=1e-6)
