"""Walls of signs, and reflections in walls, in a corridor of two sides with an end."""

import numpy as np

from tccm_ros.slam.signs.walls import is_behind_wall, wall_of_sign
from tccm_ros.slam.walls.association import WallTable

NONE = np.zeros(0, np.int64)
# y = 1, seen from below; y = -1, seen from above; x = 10, seen from the left.
PHI, RHO = np.array([np.pi / 2, -np.pi / 2, 0.0]), np.array([1.0, 1.0, 10.0])
# Along (-sin phi, cos phi): -x, x and y.
EXTENT = np.array([[-8.0, 0.0], [0.0, 10.0], [-1.0, 1.0]])
WALLS = WallTable(NONE, NONE, NONE, PHI, RHO, EXTENT, np.zeros(3), np.arange(3))
EYE = np.array([3.0, 0.0, 1.1])


def test_sign_is_on_the_near_wall_that_faces_the_reader():
    assert wall_of_sign(np.array([4.0, 0.97, 1.5]), EYE, WALLS) == 0
    assert wall_of_sign(np.array([4.0, -1.05, 1.5]), EYE, WALLS) == 1
    assert wall_of_sign(np.array([9.9, 0.2, 1.5]), EYE, WALLS) == 2
    assert wall_of_sign(np.array([4.0, 0.5, 1.5]), EYE, WALLS) == -1
    behind = np.array([3.0, 3.0, 1.1])
    assert wall_of_sign(np.array([4.0, 1.02, 1.5]), behind, WALLS) == -1


def test_a_sign_is_on_a_wall_up_to_a_little_beyond_its_end():
    assert wall_of_sign(np.array([8.2, 1.0, 1.5]), EYE, WALLS) == 0
    assert wall_of_sign(np.array([8.5, 1.0, 1.5]), EYE, WALLS) == -1


def test_point_behind_a_wall_that_faces_the_reader_is_a_reflection():
    mirrored, eyes = np.array([4.0, 3.0, 1.5]), np.array([EYE, [4.0, 0.2, 1.1]])
    assert is_behind_wall(mirrored, eyes, WALLS)
    assert not is_behind_wall(np.array([4.0, 1.1, 1.5]), eyes, WALLS)
    within = np.array([[3.0, 2.0, 1.1]])
    assert not is_behind_wall(mirrored, within, WALLS)
    # Most of three are behind the wall themselves.
    assert not is_behind_wall(mirrored, np.concatenate([within, within, [EYE]]), WALLS)


def test_a_point_beside_the_end_of_a_wall_is_no_reflection():
    beyond = np.array([9.8, 3.0, 1.5])
    assert not is_behind_wall(beyond, np.array([[9.0, 0.0, 1.1]]), WALLS)


def test_signs_without_walls_have_no_wall_and_no_reflection():
    nothing = np.zeros(0)
    empty = WallTable(NONE, NONE, NONE, nothing, nothing, np.zeros((0, 2)), nothing, NONE)
    assert wall_of_sign(EYE, EYE, empty) == -1
    assert not is_behind_wall(EYE + 1.0, EYE[None], empty)
