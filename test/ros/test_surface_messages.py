from dataclasses import replace

import numpy as np
import pytest
from message_families import family
from outlined_surfaces import surface
from shapely.geometry import box

from tccm_ros.records import EdgeState, SurfaceEdge, SurfaceShape
from tccm_ros.ros.surface_messages import (
    EDGE_STATES,
    NOTHING,
    SHAPES,
    surface_message,
    surface_pose,
)

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
def test_a_surface_tells_its_shape_and_how_each_side_is_known(name, table):
    message = surface_message(family(name), STAMP, "map", table, 0.0)
    assert message.shape == message.SHAPE_RECTANGLE
    assert list(message.edges) == [
        message.EDGE_SEEN,
        message.EDGE_HIDDEN,
        message.EDGE_CUT,
        message.EDGE_CUT,
    ]
    assert list(message.hidden_by_surfaces) == [NOTHING, 7, NOTHING, NOTHING]
    assert list(message.hidden_by_objects) == [NOTHING] * 4
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
