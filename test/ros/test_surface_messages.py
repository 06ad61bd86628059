from dataclasses import replace

import numpy as np
import pytest
from message_families import family
from outlined_surfaces import surface
from shapely.geometry import box

from tccm_ros.geometry import spatial
from tccm_ros.racks.compartment import Compartment, FaceState, OpenPart, SpaceGrid
from tccm_ros.racks.insertions import Access, AccessState
from tccm_ros.records import EdgeState, SurfaceEdge, SurfaceShape
from tccm_ros.ros.surface_messages import (
    ACCESS_STATES,
    EDGE_STATES,
    FACE_STATES,
    SHAPES,
    compartment_message,
    found_object_message,
    object_message,
    surface_message,
    surface_pose,
)
from tccm_ros.surfaces.objects.scene_objects import SceneObject

STAMP = 1_700_000_000_000_000_005


@pytest.fixture
def table():
    """A rectangle of which the first edge was seen, the second hidden, the others cut off."""
    plain = surface(box(0.0, 0.0, 1.2, 0.8))
    ends = np.roll(plain.boundary, -1, axis=0)
    states = [EdgeState.SEEN, EdgeState.HIDDEN, EdgeState.CUT, EdgeState.CUT]
    edges = tuple(
        SurfaceEdge(a, b, state, 0.004, 7 if state is EdgeState.HIDDEN else None)
        for a, b, state in zip(plain.boundary, ends, states, strict=True)
    )
    seen = plain.boundary * [0.5, 1.0, 1.0]
    return replace(
        plain, shape=SurfaceShape.RECTANGLE, edges=edges, area_seen=0.48, boundary_seen=seen
    )


@pytest.mark.parametrize("name", ["typestore", "rosidl"])
def test_surface_message_has_shape_and_edge_states(name, table):
    message = surface_message(family(name), STAMP, "map", table, 0.0)
    assert message.shape == message.SHAPE_RECTANGLE
    assert list(message.edges) == [
        message.EDGE_SEEN,
        message.EDGE_HIDDEN,
        message.EDGE_CUT,
        message.EDGE_CUT,
    ]
    assert list(message.hidden_by_surfaces) == [-1, 7, -1, -1]
    assert list(message.hidden_by_objects) == [-1] * 4
    assert list(message.edge_sigmas) == [0.004] * 4
    assert message.area_seen == 0.48
    assert len(message.boundary_seen.points) == 4
    if name == "rosidl":
        assert max(p.x for p in message.boundary_seen.points) == pytest.approx(0.6)


@pytest.mark.parametrize("name", ["typestore", "rosidl"])
def test_numbers_of_shapes_and_edges_are_those_of_the_definition(name, table):
    message = surface_message(family(name), STAMP, "map", table, None)
    for shape, number in SHAPES.items():
        assert getattr(message, f"SHAPE_{shape.name}") == number
    for state, number in EDGE_STATES.items():
        assert getattr(message, f"EDGE_{state.name}") == number


def test_the_covariance_of_a_plane_is_that_of_its_errors_about_the_pose(table):
    """By samples: planes that err, seen at the pose of the message."""
    L = np.array([[0.002, 0.0, 0.0], [0.001, 0.01, 0.0], [-0.002, 0.003, 0.02]])
    moved = replace(table, cov_plane=L @ L.T, centroid=np.array([0.3, 0.1, 0.0]))
    T, _ = surface_pose(moved)
    rng = np.random.default_rng(1)
    z, a, b = L @ rng.normal(size=(3, 40_000))
    slope = np.array([a, b])
    samples = [
        T[:2, 1] @ slope, -T[:2, 0] @ slope, z + (T[:2, 3] - moved.centroid[:2]) @ slope
    ]  # fmt: skip
    message = surface_message(family("typestore"), STAMP, "map", moved, 0.0)
    found = np.array(message.plane.covariance).reshape(3, 3)
    assert found == pytest.approx(np.cov(samples), rel=0.05, abs=3e-6)


def test_the_covariance_of_a_plane_is_nan_where_it_is_not_known(table):
    message = surface_message(family("typestore"), STAMP, "map", table, 0.0)
    assert np.isnan(message.plane.covariance).all()


DOOR = OpenPart(spatial(np.array([1.0, 1.5, 1.2])), np.array([0.4, 0.02, 0.3]))


def space():
    """A compartment that is open to the right, with an unknown back, and a door before it."""
    cells = np.zeros((1, 1, 1), bool)
    return Compartment(
        2, 3, None, spatial(np.array([1.0, 2.0, 0.5])), 0.8, 0.3, 0.35, FaceState.MEASURED,
        FaceState.OPEN, FaceState.UNKNOWN, FaceState.MEASURED, 0.9,
        SpaceGrid(np.zeros(3), 0.03, cells, cells), (DOOR,),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["typestore", "rosidl"])
def test_compartment_message_has_lengths_front_and_face_states(name):
    message = compartment_message(family(name), space())
    assert (message.rack_id, message.board_id, message.above_id) == (2, 3, -1)
    assert (message.width, message.depth, message.height, message.front_seen) == (
        0.8,
        0.3,
        0.35,
        0.9,
    )
    faces = message.left, message.right, message.back, message.ceiling
    known = message.FACE_MEASURED, message.FACE_OPEN, message.FACE_UNKNOWN, message.FACE_MEASURED
    assert faces == known
    (part,), (size,) = message.open_parts, message.open_part_sizes
    np.testing.assert_allclose([part.position.x, part.position.y], [1.0, 1.5])
    assert part.orientation.z == pytest.approx(np.sin(0.6))
    assert (size.x, size.y, size.z) == (0.4, 0.02, 0.3)
    for state, number in FACE_STATES.items():
        assert getattr(message, f"FACE_{state.name}") == number


@pytest.mark.parametrize("name", ["typestore", "rosidl"])
def test_found_object_names_obstacles_of_the_hand(name):
    types, box_on = family(name), SceneObject(5, 1, np.ones(3), np.full(3, 0.1), 0.0)
    item = object_message(types, STAMP, "map", box_on)
    above = Access(AccessState.BLOCKED, (), 8)
    front = Access(AccessState.BLOCKED, (6, 7), open_parts=(DOOR,))
    message = found_object_message(types, item, above, front)
    assert (message.above, message.above_blocked_by) == (message.ACCESS_BLOCKED, 8)
    assert (message.front, list(message.front_blocked_by)) == (message.ACCESS_BLOCKED, [6, 7])
    assert message.front_blocked_by_surface == -1
    (door,) = message.front_blocked_by_open_parts
    np.testing.assert_allclose([door.position.x, door.position.y], DOOR.T_map_part[:2, 3])
    for state, number in ACCESS_STATES.items():
        assert getattr(message, f"ACCESS_{state.name}") == number


def test_clients_read_compartments_and_found_objects_as_plain_objects():
    from tccm_ros.ros.map_records import MapCompartment, MapFoundObject

    types = family("rosidl")
    read = MapCompartment.of(compartment_message(types, space()))
    np.testing.assert_allclose(read.T_map_front, space().T_map_front, atol=1e-12)
    assert (read.rack_id, read.board_id) == (2, 3)
    assert (read.width, read.depth, read.height) == (0.8, 0.3, 0.35)
    faces = (read.left, read.right, read.back, read.ceiling)
    assert faces == ("measured", "open", "unknown", "measured")
    (door,) = read.open_parts
    np.testing.assert_allclose(door.T_map_part, DOOR.T_map_part, atol=1e-12)
    np.testing.assert_allclose(door.size, DOOR.size)
    item = object_message(types, STAMP, "map", SceneObject(5, 1, np.ones(3), np.ones(3), 0.0))
    access = Access(AccessState.FREE), Access(AccessState.BLOCKED, (6,))
    found = MapFoundObject.of(found_object_message(types, item, *access))
    assert (found.item.id, found.above, found.front) == (5, "free", "blocked")
