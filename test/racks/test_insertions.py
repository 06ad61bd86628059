"""Insertions through the front of a compartment whose cells are known."""

import numpy as np
import pytest
from shapely.geometry import box

from tccm_ros.geometry import spatial
from tccm_ros.racks.compartment import Compartment, FaceState, OpenPart, SpaceGrid
from tccm_ros.racks.insertions import AccessState, Hand, InsertionSpace, Obstacle

WIDTH, DEPTH, HEIGHT, CELL = 0.6, 0.3, 0.3, 0.03
CORNER = np.array([-0.42, -0.45, 0.0])
T_FRONT = spatial(np.array([1.0, 2.0, 0.5]))
MUG = (0.09, 0.09, 0.12)


def compartment(unseen=(), hit=(), open_parts=()):
    """Return a compartment that was seen but for some boxes; what was hit is not seen."""
    shape = (25, 30, 10)
    seen, hits = np.ones(shape, bool), np.zeros(shape, bool)
    for cells, boxes in ((None, unseen), (hits, hit)):
        for low, high in boxes:
            a, b = (np.round((np.array(p) - CORNER) / CELL).astype(int) for p in (low, high))
            part = tuple(slice(i, j) for i, j in zip(a, b))
            seen[part] = False
            if cells is not None:
                cells[part] = True
    state = FaceState.MEASURED
    return Compartment(
        4, 4, 5, T_FRONT, WIDTH, DEPTH, HEIGHT, state, state, state, state, 1.0,
        SpaceGrid(CORNER, CELL, seen, hits), open_parts,
    )  # fmt: skip


def in_front(found):
    """Return where a placement is in the frame of the front, (3,)."""
    return (np.linalg.inv(T_FRONT) @ [*found.position, 1.0])[:3]


def footprint(x, y, edge=0.08):
    """Return a footprint in map of what stands at x, y in the frame of the front."""
    from shapely.affinity import affine_transform

    (a, b), (c, d) = T_FRONT[:2, :2]
    middle = box(x - edge / 2, y - edge / 2, x + edge / 2, y + edge / 2)
    return affine_transform(middle, [a, b, c, d, *T_FRONT[:2, 3]])


def test_an_empty_compartment_is_filled_clear_of_edges_and_of_each_other():
    found = InsertionSpace(compartment()).insertions(MUG, Hand(0.08, 0.1), 0.02)
    at = np.array([in_front(p) for p in found])
    assert len(at) >= 4
    np.testing.assert_allclose(at[:, 0], DEPTH / 2, atol=1e-9)
    assert np.abs(at[:, 1]).max() <= WIDTH / 2 - MUG[1] / 2 - 0.02 + 1e-9
    assert np.diff(np.sort(at[:, 1])).min() >= MUG[1] + 0.02 - 1e-9
    assert {p.surface for p in found} == {4}
    assert found[0].free_height == HEIGHT


@pytest.mark.parametrize("x", [-0.15, 0.06, 0.21])
@pytest.mark.parametrize("kind", ["hit", "unseen"])
def test_insertion_stops_at_hits_and_unseen_space(x, kind):
    block = ((x, -0.06, 0.06), (x + 0.06, 0.06, 0.12))
    space = InsertionSpace(compartment(**{kind: [block]}))
    for p in space.insertions(MUG, Hand(), 0.02):
        at = in_front(p)
        beside = abs(at[1]) - MUG[1] / 2 - 0.06
        assert beside >= 0.02 - CELL / 2 or at[0] + MUG[0] / 2 <= x


def test_unseen_space_above_an_object_does_not_block_it():
    space = InsertionSpace(compartment(unseen=[((-0.42, -0.45, 0.18), (0.33, 0.45, 0.3))]))
    assert space.insertions(MUG, Hand(), 0.02)
    assert not space.insertions((0.09, 0.09, 0.2), Hand(), 0.02)
    assert not space.insertions(MUG, Hand(0.05, 0.2), 0.02), "the hand is higher"


def test_an_object_that_is_too_high_or_too_wide_has_no_place():
    space = InsertionSpace(compartment())
    assert not space.insertions((0.09, 0.09, HEIGHT - 0.01), Hand(), 0.02)
    assert not space.insertions((0.09, WIDTH - 0.01, 0.1), Hand(), 0.02)
    assert not space.insertions((DEPTH - 0.01, 0.09, 0.1), Hand(), 0.02)


def test_low_object_indistinct_from_the_board_is_an_obstacle():
    low = Obstacle(9, footprint(0.1, 0.0), 0.0, 0.02)
    for p in InsertionSpace(compartment(), [low]).insertions(MUG, Hand(), 0.02):
        assert abs(in_front(p)[1]) >= 0.08 / 2 + MUG[1] / 2


def object_at(number, x, y, height=0.12):
    cells = ((round(x - 0.045, 3), round(y - 0.045, 3), 0.0), (x + 0.045, y + 0.045, height))
    return Obstacle(number, footprint(x, y), 0.0, height), cells


def test_object_is_free_from_the_front_unless_another_is_before_it():
    far, far_cells = object_at(1, 0.225, 0.015)
    near, near_cells = object_at(2, 0.075, 0.015)
    hand = Hand(0.08, 0.1)
    alone = InsertionSpace(compartment(hit=[far_cells]), [far])
    assert alone.access(far, hand, 0.02).state == AccessState.FREE
    both = InsertionSpace(compartment(hit=[far_cells, near_cells]), [far, near])
    assert both.access(near, hand, 0.02).state == AccessState.FREE
    blocked = both.access(far, hand, 0.02)
    assert (blocked.state, blocked.objects) == (AccessState.BLOCKED, (2,))


def test_object_behind_unseen_space_is_neither_free_nor_blocked():
    item, cells = object_at(1, 0.225, 0.015)
    unseen = [((0.0, -0.15, 0.0), (0.12, 0.15, 0.3))]
    space = InsertionSpace(compartment(unseen=unseen, hit=[cells]), [item])
    assert space.access(item, Hand(0.08, 0.1), 0.02).state == AccessState.UNKNOWN


def test_hand_higher_than_the_compartment_is_blocked_by_the_board_above():
    item, cells = object_at(1, 0.225, 0.015)
    space = InsertionSpace(compartment(hit=[cells]), [item])
    access = space.access(item, Hand(0.08, 0.29), 0.02)
    assert (access.state, access.surface) == (AccessState.BLOCKED, 5)


@pytest.mark.parametrize(
    ("left_m", "low_m", "is_named"), [(0.0, 0.06, True), (0.3, 0.06, False), (0.0, 0.21, False)]
)
def test_the_open_door_that_is_in_the_way_of_a_hand_is_named(left_m, low_m, is_named):
    """One beside the way, or above it, is not."""
    T = T_FRONT @ spatial(np.array([-0.15, left_m, np.pi / 2]))
    T[2, 3] += low_m + 0.03
    door = OpenPart(T, np.array([0.12, 0.02, 0.06]))
    corner = -0.165, left_m - 0.06, low_m
    leaf = corner, (-0.135, left_m + 0.06, low_m + 0.06)
    item, cells = object_at(1, 0.225, 0.015)
    space = InsertionSpace(compartment(hit=[cells, leaf], open_parts=(door,)), [item])
    access = space.access(item, Hand(0.08, 0.1), 0.02)
    assert access.open_parts == ((door,) if is_named else ())
    assert access.state == (AccessState.BLOCKED if is_named else AccessState.FREE)
