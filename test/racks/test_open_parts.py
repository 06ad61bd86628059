"""Doors and drawers that stand open before a compartment."""

import numpy as np
import shapely

from tccm_ros.geometry import inverse, spatial, transform
from tccm_ros.racks.compartment import Compartment, FaceState, SpaceGrid
from tccm_ros.racks.compartments import open_parts
from tccm_ros.racks.hits import Hits

FRONT = spatial(np.array([2.0, 1.0, 0.7]))
NOTHING = shapely.Polygon()


def compartment():
    """Return a compartment 0.8 m wide, 0.3 m deep and 0.35 m high."""
    state, cells = FaceState.OPEN, np.zeros((1, 1, 1), bool)
    grid = SpaceGrid(np.zeros(3), 0.03, cells, cells)
    return Compartment(1, 1, 2, FRONT, 0.8, 0.3, 0.35, state, state, state, state, 1.0, grid)


def hits(*points):
    """Return hits of 4 cm at points (N, 3) in the frame of the front."""
    ends = transform(FRONT, np.concatenate(points))
    count = len(ends)
    return Hits(ends, np.zeros((count, 3)), np.full(count, 0.02), np.zeros(count, int))


def leaf(hinge, angle, length, heights=(0.06, 0.32)):
    """Return points on a vertical leaf from a hinge, at an angle from the direction outwards."""
    along, z = np.arange(0.0, length + 1e-9, 0.04), np.arange(*heights, 0.04)
    a, z = (grid.ravel() for grid in np.meshgrid(along, z))
    wave = 0.004 * np.cos(5.0 * np.arange(len(a)))  # a fitting plane would have no thickness
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([hinge[0] - c * a + s * wave, hinge[1] - s * a - c * wave, z])


def test_a_door_is_a_thin_box_along_its_leaf():
    door = leaf((-0.07, 0.4), 0.4, 0.4)
    (part,) = open_parts(compartment(), hits(door), NOTHING)
    length, depth, height = part.size
    assert abs(length - 0.4) < 0.02
    assert depth < 0.03
    assert abs(height - 0.28) < 0.03
    local = inverse(FRONT) @ part.T_map_part
    np.testing.assert_allclose(local[:2, 3], door[:, :2].mean(axis=0), atol=0.01)
    assert abs(abs(local[:2, 0] @ [np.cos(0.4), np.sin(0.4)]) - 1.0) < 1e-3


def test_two_doors_are_two_parts_from_left_to_right():
    doors = leaf((-0.07, -0.38), 0.0, 0.3), leaf((-0.07, 0.38), 0.0, 0.3)
    left, right = open_parts(compartment(), hits(*doors), NOTHING)
    middles = [(inverse(FRONT) @ part.T_map_part)[1, 3] for part in (left, right)]
    np.testing.assert_allclose(middles, [0.38, -0.38], atol=0.01)


def test_open_parts_exclude_the_edge_the_content_and_neighbours():
    edge = leaf((0.0, 0.4), 0.5 * np.pi, 0.8)
    content = leaf((0.2, 0.1), 0.5 * np.pi, 0.2)
    beside = leaf((-0.1, 0.6), 0.0, 0.3)
    above = leaf((-0.1, 0.0), 0.5 * np.pi, 0.4, (0.4, 0.6))
    assert open_parts(compartment(), hits(edge, content, beside, above), NOTHING) == ()


def test_surfaces_and_objects_on_them_are_no_part():
    table = shapely.Polygon(
        transform(FRONT, [[-0.5, y, 0.0] for y in (-0.5, 0.5)])[:, :2].tolist()
        + transform(FRONT, [[-0.06, y, 0.0] for y in (0.5, -0.5)])[:, :2].tolist()
    )
    cup = leaf((-0.2, 0.1), 0.5 * np.pi, 0.2)
    assert open_parts(compartment(), hits(cup), table) == ()
    assert len(open_parts(compartment(), hits(cup), NOTHING)) == 1


def test_a_few_mixed_pixels_are_no_part():
    assert open_parts(compartment(), hits(leaf((-0.1, 0.1), 0.0, 0.08, (0.1, 0.2))), NOTHING) != ()
    assert open_parts(compartment(), hits(leaf((-0.1, 0.1), 0.0, 0.08, (0.1, 0.16))), NOTHING) == ()
