"""Surfaces as MoveIt's collision objects: a box under each, gone when the surface is gone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from live_robot import Listener
from rclpy.node import Node

from tccm_ros.nodes import collision
from tccm_ros.nodes.collision import CollisionObjects, collision_messages
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records import Surface

CollisionObject = pytest.importorskip("moveit_msgs.msg").CollisionObject

ADD, REMOVE = CollisionObject.ADD, CollisionObject.REMOVE
TYPES = RosidlMessages()
SQUARE = np.array([[0.0, 0.0, 0.7], [1.2, 0.0, 0.7], [1.2, 0.8, 0.7], [0.0, 0.8, 0.7]])
TABLE = Surface(
    id=4, label="table", confidence=0.9, height=0.7, normal=np.array([0.0, 0.0, 1.0]), offset=0.7,
    area=0.96, centroid=SQUARE.mean(axis=0), boundary=SQUARE, holes=(), points=1000,
    height_std=0.002, first_seen_ns=1, last_seen_ns=2, views=(),
)  # fmt: skip
FLOOR = replace(TABLE, id=1, label="floor")


class Publisher:
    def __init__(self):
        self.messages = []

    def publish(self, message):
        self.messages.append(message)


@pytest.fixture
def publisher():
    return Publisher()


def objects_of(publisher) -> CollisionObjects:
    running = SimpleNamespace(ok=lambda: True)
    node = SimpleNamespace(create_publisher=lambda *_: publisher, context=running)
    return CollisionObjects(node, TYPES, "map")


def test_the_top_of_the_box_is_the_surface():
    (message,) = collision_messages(TYPES, 5, "map", [TABLE], set())
    assert (message.id, message.operation) == ("tccm_surface_4", ADD)
    assert (message.header.frame_id, message.header.stamp.nanosec) == ("map", 5)
    (solid,), (pose,) = message.primitives, message.primitive_poses
    position, q = pose.position, pose.orientation
    assert sorted(solid.dimensions[:2]) == pytest.approx([0.8, 1.2])
    assert position.z + 0.5 * solid.dimensions[2] == pytest.approx(0.7)
    assert (position.x, position.y) == pytest.approx((0.6, 0.4))
    # Turned about z alone, so that its long side lies along x.
    assert (q.x, q.y) == pytest.approx((0.0, 0.0))
    long_side = 2.0 * np.arctan2(q.z, q.w) + (0.0 if solid.dimensions[0] > 1.0 else np.pi / 2)
    assert np.sin(long_side) == pytest.approx(0.0, abs=1e-9)


def test_a_bent_counter_is_a_mesh_that_leaves_the_room_before_it():
    ring = [[0, 0], [2, 0], [2, 2], [1.4, 2], [1.4, 0.6], [0, 0.6]]
    boundary = np.column_stack([np.array(ring, float), np.full(6, 0.9)])
    bent = replace(TABLE, boundary=boundary, area=2.04, offset=0.9, centroid=boundary.mean(axis=0))
    (message,) = collision_messages(TYPES, 5, "map", [bent], set())
    (mesh,), (pose,) = message.meshes, message.mesh_poses
    assert not message.primitives
    corners = np.array([[p.x, p.y, p.z] for p in mesh.vertices])
    faces = corners[np.array([t.vertex_indices for t in mesh.triangles])]
    a, b, c = faces.transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    assert volume == pytest.approx(0.02 * 2.04), "counter-clockwise from outside, 2 cm thick"
    assert corners[:, 2].max() == pytest.approx(0.9)
    assert (pose.position.z, pose.orientation.w) == (0.0, 1.0)


def test_all_but_the_floor_are_shown_and_what_is_gone_is_removed(publisher):
    objects = objects_of(publisher)
    shelf = replace(TABLE, id=7, label="shelf")
    objects.publish([FLOOR, TABLE, shelf], 1)
    objects.publish([FLOOR, shelf], 2)
    told = [(m.id, m.operation) for m in publisher.messages]
    assert told == [
        ("tccm_surface_4", ADD),
        ("tccm_surface_7", ADD),
        ("tccm_surface_4", REMOVE),
        ("tccm_surface_7", ADD),
    ]


def test_a_late_listener_gets_all(ros):
    speaker = ros.add(Node("speaker", context=ros.context))
    objects = CollisionObjects(speaker, TYPES, "map")
    objects.publish([TABLE, replace(TABLE, id=7)], 1)
    objects.publish([TABLE], 2)
    late = Listener(ros, "late").listen(CollisionObject, "/collision_object", latched=True)
    ros.spin_until(lambda: len(late) == 4)
    scene = {}
    for message in late:
        scene[message.id] = message.operation
    assert scene == {"tccm_surface_4": ADD, "tccm_surface_7": REMOVE}


def test_without_moveit_nothing_is_published(monkeypatch):
    def absent(kind):
        raise ModuleNotFoundError(kind)

    monkeypatch.setattr(collision, "message_class", absent)
    made = []
    node = SimpleNamespace(create_publisher=lambda *arguments: made.append(arguments), context=None)
    CollisionObjects(node, TYPES, "map").publish([TABLE], 1)
    assert made == []
