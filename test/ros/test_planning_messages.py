"""Surfaces and objects as MoveIt's collision objects, and as tables of object_recognition_msgs."""

from dataclasses import replace

import numpy as np
import pytest
from message_families import to_bag_message
from outlined_surfaces import RECTANGLE_WITH_HOLE, surface
from scipy.spatial.transform import Rotation
from shapely import Polygon, affinity
from shapely.geometry import box

from tccm_ros.errors import MessageError
from tccm_ros.nodes.ros_types import is_installed
from tccm_ros.ros.collision_messages import (
    COLLISION_OBJECT,
    PLANNING_SCENE,
    collision_messages,
    planning_scene_message,
)
from tccm_ros.ros.table_messages import TABLES, tables_message
from tccm_ros.scene.planning_shapes import scene_shapes
from tccm_ros.scene.published_scene import ObjectState, PublishedScene
from tccm_ros.surfaces.objects.scene_objects import SceneObject

ADD, REMOVE, MOVE = 0, 1, 3
"""Operations of a moveit_msgs/CollisionObject."""

TABLE = surface(box(0.0, 0.0, 1.2, 0.8), height=0.7, number=4)
FLOOR = surface(box(-3.0, -3.0, 3.0, 3.0), height=0.0, label="floor", number=1)
CUP = SceneObject(3, 4, np.array([0.5, 0.4, 0.75]), np.array([0.12, 0.08, 0.1]), 0.3)
CAN = replace(CUP, size=np.array([0.08, 0.08, 0.1]), is_round=True)


def need(types, kind):
    if type(types).__name__ == "RosidlMessages" and not is_installed(kind):
        pytest.skip(f"{kind} is not installed")


def collision(types, surfaces=(), objects=(), gone=()):
    """Return collision objects as they are read from a bag."""
    need(types, COLLISION_OBJECT)
    shapes = scene_shapes(surfaces, objects)
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
    (solid,), pose = message.primitives, message.pose
    assert matrix(message.primitive_poses[0]) == pytest.approx(np.eye(4))
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
    (solid,), pose = message.primitives, message.pose
    assert matrix(message.primitive_poses[0]) == pytest.approx(np.eye(4))
    assert (solid.type, list(solid.dimensions)) == (1, [0.12, 0.08, 0.1])
    T = matrix(pose)
    assert T[:3, 3] == pytest.approx(CUP.center)
    assert T[:2, 0] == pytest.approx([np.cos(0.3), np.sin(0.3)])


def test_a_round_object_is_a_cylinder(types):
    (message,) = collision(types, objects=[CAN])
    (solid,) = message.primitives
    assert (solid.type, list(solid.dimensions)) == (3, [0.1, 0.04]), "height and radius"
    assert matrix(message.pose)[:3, 3] == pytest.approx(CAN.center)


def test_removals_precede_additions(types):
    messages = collision(types, [TABLE], gone=["tccm_object_9", "tccm_object_3"])
    assert [(m.id, m.operation) for m in messages] == [
        ("tccm_object_3", REMOVE),
        ("tccm_object_9", REMOVE),
        ("tccm_surface_4", ADD),
    ]


class Listener:
    """A world and a hand that follow the rules of MoveIt's planning scene for diffs."""

    def __init__(self, types):
        self.types, self.messages, self.world, self.hand = types, PublishedScene(), {}, {}

    def take(self, changes):
        need(self.types, PLANNING_SCENE)
        made = planning_scene_message(self.types, 5, "map", changes)
        scene = to_bag_message(self.types, PLANNING_SCENE, made)
        assert (scene.is_diff, scene.robot_state.is_diff) == (True, True), "the rest stays"
        for attached in scene.robot_state.attached_collision_objects:
            name = attached.object.id
            if attached.object.operation == ADD:
                self.hand[name] = attached.link_name, self.world.pop(name, None)
            else:
                self.world[name] = self.hand.pop(name)[1]
        for item in scene.world.collision_objects:
            assert item.header.frame_id == "map"
            if item.operation == ADD:
                assert len(item.primitives) == len(item.primitive_poses)
                sizes = [tuple(solid.dimensions) for solid in item.primitives]
                self.world[item.id] = (*matrix(item.pose)[:3, 3], *sizes)
            elif item.operation == MOVE:
                assert not len(item.primitives)
                self.world[item.id] = (*matrix(item.pose)[:3, 3], *self.world[item.id][3:])
            else:
                del self.world[item.id]
        return [(item.id, item.operation) for item in scene.world.collision_objects]

    def solve(self, surfaces, objects):
        return self.take(self.messages.update(scene_shapes(surfaces, objects)))


@pytest.fixture
def listener(types):
    return Listener(types)


def moved(item, x):
    return replace(item, center=item.center + np.array([x, 0.0, 0.0]))


def test_diff_contains_only_new_moved_and_removed_shapes(listener):
    added = listener.solve([TABLE, FLOOR], [CUP])
    assert sorted(added) == [("tccm_object_3", ADD), ("tccm_surface_4", ADD)]
    assert listener.solve([TABLE, FLOOR], [moved(CUP, 0.001)]) == []
    assert listener.solve([TABLE, FLOOR], [moved(CUP, 0.1)]) == [("tccm_object_3", MOVE)]
    assert listener.world["tccm_object_3"][0] == pytest.approx(0.6)
    wider = replace(moved(CUP, 0.1), size=CUP.size + 0.01)
    assert listener.solve([TABLE, FLOOR], [wider]) == [("tccm_object_3", ADD)]
    assert listener.solve([TABLE, FLOOR], []) == [("tccm_object_3", REMOVE)]
    assert list(listener.world) == ["tccm_surface_4"]


def test_an_object_that_is_found_to_be_round_is_a_new_shape(listener):
    listener.solve([TABLE], [replace(CAN, is_round=False)])
    assert listener.solve([TABLE], [CAN]) == [("tccm_object_3", ADD)]


def test_small_changes_do_not_accumulate(listener):
    for k in range(20):
        listener.solve([TABLE], [moved(CUP, 0.001 * k)])
    assert listener.world["tccm_object_3"][0] == pytest.approx(CUP.center[0] + 0.019, abs=0.0021)


def test_a_target_is_left_out_and_shown_again(listener):
    listener.solve([TABLE], [CUP])
    listener.take(listener.messages.set_state(3, ObjectState.LEFT_OUT))
    assert list(listener.world) == ["tccm_surface_4"]
    assert listener.solve([TABLE], [moved(CUP, 0.1)]) == [], "it stays left out"
    listener.take(listener.messages.set_state(3, ObjectState.SHOWN))
    assert listener.world["tccm_object_3"][0] == pytest.approx(0.6)


def test_a_target_is_attached_and_put_down_where_the_hand_is(listener):
    listener.solve([TABLE], [CUP])
    listener.take(listener.messages.set_state(3, ObjectState.ATTACHED, "gripper", ("finger",)))
    assert listener.hand["tccm_object_3"][0] == "gripper"
    assert list(listener.world) == ["tccm_surface_4"]
    assert listener.solve([TABLE], []) == [], "it is not on the table, but in the hand"
    assert listener.take(listener.messages.set_state(3, ObjectState.SHOWN)) == []
    assert not listener.hand
    assert "tccm_object_3" in listener.world, "it stays where the hand was"
    new = replace(moved(CUP, 0.4), id=8)
    messages = listener.solve([TABLE], [new])
    assert messages == [("tccm_object_3", REMOVE), ("tccm_object_8", ADD)]


def test_new_listener_gets_all_shapes_and_attached_objects(listener, types):
    listener.solve([TABLE], [CUP, replace(moved(CUP, 0.4), id=8)])
    listener.take(listener.messages.set_state(3, ObjectState.ATTACHED, "gripper"))
    late = Listener(types)
    late.take(listener.messages.repeat())
    assert set(late.world) == {"tccm_surface_4", "tccm_object_8"}
    assert set(late.hand) == {"tccm_object_3"}


def test_an_unknown_object_or_link_is_one_sentence():
    messages = PublishedScene()
    messages.update(scene_shapes([TABLE], [CUP]))
    with pytest.raises(MessageError, match="no object 7"):
        messages.set_state(7, ObjectState.LEFT_OUT)
    with pytest.raises(MessageError, match="link_name is empty"):
        messages.set_state(3, ObjectState.ATTACHED)
    with pytest.raises(MessageError, match="state is 9"):
        messages.set_state(3, 9)


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


def test_hull_of_a_table_covers_its_observed_part(types):
    half = TABLE.boundary * [0.5, 1.0, 1.0]
    (table,) = tables(types, replace(TABLE, boundary_seen=half)).tables
    xy = np.array([[p.x, p.y] for p in table.convex_hull])
    assert np.ptp(xy, axis=0) == pytest.approx([0.6, 0.8])
