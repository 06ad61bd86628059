"""Surfaces and objects as MoveIt's collision objects, and as tables of object_recognition_msgs."""

from dataclasses import replace

import numpy as np
import pytest
from message_families import to_bag_message
from outlined_surfaces import RECTANGLE_WITH_HOLE, surface
from scipy.spatial.transform import Rotation
from shapely import Polygon, affinity
from shapely.geometry import box

from tccm_ros.nodes.ros_types import is_installed
from tccm_ros.ros.collision_messages import (
    ADD,
    COLLISION_OBJECT,
    REMOVE,
    collision_messages,
    collision_shapes,
)
from tccm_ros.ros.table_messages import TABLES, tables_message
from tccm_ros.surfaces.scene_objects import SceneObject

TABLE = surface(box(0.0, 0.0, 1.2, 0.8), height=0.7, number=4)
FLOOR = surface(box(-3.0, -3.0, 3.0, 3.0), height=0.0, label="floor", number=1)
CUP = SceneObject(3, 4, np.array([0.5, 0.4, 0.75]), np.array([0.12, 0.08, 0.1]), 0.3)


def need(types, kind):
    if type(types).__name__ == "RosidlMessages" and not is_installed(kind):
        pytest.skip(f"{kind} is not installed")


def collision(types, surfaces=(), objects=(), gone=()):
    """Return collision objects as they are read from a bag."""
    need(types, COLLISION_OBJECT)
    shapes = collision_shapes(surfaces, objects)
    made = collision_messages(types, 5, "map", shapes, gone)
    return [to_bag_message(types, COLLISION_OBJECT, message) for message in made]


def tables(types, *surfaces):
    need(types, TABLES)
    return to_bag_message(types, TABLES, tables_message(types, 5, "map", surfaces))


def matrix(pose):
    p, q = pose.position, pose.orientation
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    T[:3, 3] = p.x, p.y, p.z
    return T


def test_the_top_of_the_box_is_the_surface(types):
    (message,) = collision(types, [TABLE, FLOOR])
    assert (message.id, message.operation) == ("tccm_surface_4", ADD)
    assert (message.header.frame_id, message.header.stamp.nanosec) == ("map", 5)
    (solid,), (pose,) = message.primitives, message.primitive_poses
    assert sorted(solid.dimensions[:2]) == pytest.approx([0.8, 1.2])
    T = matrix(pose)
    assert T[:3, 3] == pytest.approx([0.6, 0.4, 0.7 - 0.5 * solid.dimensions[2]])
    assert T[2, 2] == pytest.approx(1.0), "turned about z alone"
    assert np.abs(T[0, int(np.argmax(solid.dimensions[:2]))]) == pytest.approx(1.0)


def test_a_bent_counter_is_a_mesh_that_leaves_the_room_before_it(types):
    ring = [[0, 0], [2, 0], [2, 2], [1.4, 2], [1.4, 0.6], [0, 0.6]]
    (message,) = collision(types, [surface(Polygon(ring), height=0.9)])
    (mesh,), (pose,) = message.meshes, message.mesh_poses
    assert not message.primitives
    corners = np.array([[p.x, p.y, p.z] for p in mesh.vertices])
    faces = corners[np.array([t.vertex_indices for t in mesh.triangles])]
    a, b, c = faces.transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    assert volume == pytest.approx(0.02 * 2.04), "counter-clockwise from outside, 2 cm thick"
    assert corners[:, 2].max() == pytest.approx(0.9)
    assert (pose.position.z, pose.orientation.w) == (0.0, 1.0)


def test_an_object_is_its_box_where_it_stands(types):
    (message,) = collision(types, objects=[CUP])
    assert (message.id, message.operation) == ("tccm_object_3", ADD)
    (solid,), (pose,) = message.primitives, message.primitive_poses
    assert (solid.type, list(solid.dimensions)) == (1, [0.12, 0.08, 0.1])
    T = matrix(pose)
    assert T[:3, 3] == pytest.approx(CUP.center)
    assert T[:2, 0] == pytest.approx([np.cos(0.3), np.sin(0.3)])


def test_what_is_gone_is_removed_before_anything_is_added(types):
    told = collision(types, [TABLE], gone=["tccm_object_9", "tccm_object_3"])
    assert [(m.id, m.operation) for m in told] == [
        ("tccm_object_3", REMOVE),
        ("tccm_object_9", REMOVE),
        ("tccm_surface_4", ADD),
    ]


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, -70.0])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.03, -0.02)])
def test_a_table_is_a_plane_with_its_hull_in_its_own_pose(types, yaw_deg, slope):
    polygon = affinity.rotate(RECTANGLE_WITH_HOLE, yaw_deg)
    tilted = surface(polygon, slope)
    array = tables(types, FLOOR, tilted)
    (table,) = array.tables
    for header in (array.header, table.header):
        assert (header.frame_id, header.stamp.nanosec) == ("map", 5)
    T = matrix(table.pose)
    assert T[:3, 2] == pytest.approx(tilted.normal), "z is the normal"
    along = np.array([np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))])
    heading = T[:2, 0] / np.linalg.norm(T[:2, 0])
    assert abs(heading @ along) == pytest.approx(1.0, abs=1e-3), "x lies along the longer edge"
    hull = np.array([[p.x, p.y, p.z] for p in table.convex_hull])
    assert hull[:, 2] == pytest.approx(0.0)
    in_map = hull @ T[:3, :3].T + T[:3, 3]
    assert in_map @ tilted.normal == pytest.approx(tilted.offset)
    outline = Polygon(polygon.exterior)
    assert Polygon(in_map[:, :2]).symmetric_difference(outline).area < 1e-9
    assert Polygon(hull[:, :2]).exterior.is_ccw


def test_the_hull_of_a_table_is_what_was_seen_of_it(types):
    half = TABLE.boundary * [0.5, 1.0, 1.0]
    (table,) = tables(types, replace(TABLE, boundary_seen=half)).tables
    xy = np.array([[p.x, p.y] for p in table.convex_hull])
    assert np.ptp(xy, axis=0) == pytest.approx([0.6, 0.8])
