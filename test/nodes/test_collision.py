"""What MoveIt hears: surfaces and objects, removed when they have left."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from live_robot import Listener
from outlined_surfaces import surface
from rclpy.node import Node
from shapely.geometry import box

from tccm_ros.nodes import collision
from tccm_ros.nodes.collision import CollisionObjects
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.surfaces.scene import KnownSurface, Scene
from tccm_ros.surfaces.scene_objects import SceneObject

CollisionObject = pytest.importorskip("moveit_msgs.msg").CollisionObject

ADD, REMOVE = CollisionObject.ADD, CollisionObject.REMOVE
TYPES = RosidlMessages()
TABLE = surface(box(0.0, 0.0, 1.2, 0.8), number=4)
SHELF = surface(box(2.0, 0.0, 3.0, 0.3), number=7, label="shelf")
FLOOR = replace(TABLE, id=1, label="floor")
CUP = SceneObject(3, 4, np.array([0.5, 0.4, 0.79]), np.array([0.08, 0.08, 0.1]), 0.3)


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
    return CollisionObjects(node, TYPES)


def scene(stamp_ns, *surfaces, objects=()) -> Scene:
    known = tuple(KnownSurface(surface, 2) for surface in surfaces)
    return Scene(stamp_ns, "map", 0.0, tuple(objects), None, known)


def test_surfaces_and_objects_are_shown_and_what_has_left_is_removed(publisher):
    objects = objects_of(publisher)
    objects.publish(scene(1, FLOOR, TABLE, SHELF, objects=[CUP]))
    objects.publish(scene(2, FLOOR, SHELF))
    told = [(m.id, m.operation, m.header.stamp.nanosec) for m in publisher.messages]
    assert told == [
        ("tccm_surface_4", ADD, 1),
        ("tccm_surface_7", ADD, 1),
        ("tccm_object_3", ADD, 1),
        ("tccm_object_3", REMOVE, 2),
        ("tccm_surface_4", REMOVE, 2),
        ("tccm_surface_7", ADD, 2),
    ]
    assert {m.header.frame_id for m in publisher.messages} == {"map"}


def test_a_late_listener_gets_all(ros):
    speaker = ros.add(Node("speaker", context=ros.context))
    objects = CollisionObjects(speaker, TYPES)
    objects.publish(scene(1, TABLE, SHELF))
    objects.publish(scene(2, TABLE))
    late = Listener(ros, "late").listen(CollisionObject, "/collision_object", latched=True)
    ros.spin_until(lambda: len(late) == 4)
    known = {}
    for message in late:
        known[message.id] = message.operation
    assert known == {"tccm_surface_4": ADD, "tccm_surface_7": REMOVE}


def test_without_moveit_nothing_is_published(monkeypatch):
    monkeypatch.setattr(collision, "is_installed", lambda kind: False)
    made = []
    node = SimpleNamespace(create_publisher=lambda *arguments: made.append(arguments), context=None)
    CollisionObjects(node, TYPES).publish(scene(1, TABLE))
    assert made == []
