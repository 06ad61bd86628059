"""What MoveIt hears: surfaces and objects, removed when they have left."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from live_robot import Listener
from outlined_surfaces import surface
from rclpy.node import Node
from shapely.geometry import box

from tccm_ros.nodes.ros_types import RosidlMessages, is_installed
from tccm_ros.nodes.services import collision
from tccm_ros.nodes.services.collision import CollisionObjects
from tccm_ros.ros.collision_messages import PLANNING_SCENE
from tccm_ros.scene.scene import KnownSurface, Scene
from tccm_ros.surfaces.objects.scene_objects import SceneObject

CollisionObject = pytest.importorskip("moveit_msgs.msg").CollisionObject

ADD, REMOVE = CollisionObject.ADD, CollisionObject.REMOVE
TYPES = RosidlMessages()
TABLE = surface(box(0.0, 0.0, 1.2, 0.8), number=4)
SHELF = surface(box(2.0, 0.0, 3.0, 0.3), number=7, label="shelf")
FLOOR = replace(TABLE, id=1, label="floor")
CUP = SceneObject(3, 4, np.array([0.5, 0.4, 0.79]), np.array([0.08, 0.08, 0.1]), 0.3)


class Publisher:
    def __init__(self):
        self.messages, self.listeners = [], 1

    def get_subscription_count(self):
        return self.listeners

    def publish(self, message):
        self.messages.append(message)


@pytest.fixture
def publisher():
    return Publisher()


def objects_of(publisher) -> CollisionObjects:
    return CollisionObjects(node_of(collision_object=publisher), TYPES)


def node_of(services=None, **publishers):
    """Return a node with publishers by topic; its services are added to a dict."""
    return SimpleNamespace(
        create_publisher=lambda kind, topic, profile: publishers.get(topic, Publisher()),
        create_service=lambda kind, name, call: (services or {}).update({name: call}),
        context=SimpleNamespace(ok=lambda: True),
    )


def scene(stamp_ns, *surfaces, objects=()) -> Scene:
    known = tuple(KnownSurface(surface, 2) for surface in surfaces)
    return Scene(stamp_ns, "map", 0.0, tuple(objects), None, known)


def test_surfaces_and_objects_are_added_and_removed(publisher):
    objects = objects_of(publisher)
    objects.publish(scene(1, FLOOR, TABLE, SHELF, objects=[CUP]))
    objects.publish(scene(2, FLOOR, SHELF))
    published = [(m.id, m.operation, m.header.stamp.nanosec) for m in publisher.messages]
    assert published == [
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


@pytest.mark.skipif(not is_installed(PLANNING_SCENE), reason="moveit_msgs has no PlanningScene")
def test_solution_is_published_as_a_diff_and_whole_to_new_listeners():
    scenes = Publisher()
    objects = CollisionObjects(node_of(planning_scene=scenes), TYPES)
    objects.publish(scene(1, FLOOR, TABLE, SHELF, objects=[CUP]))
    objects.publish(scene(2, FLOOR, TABLE, SHELF, objects=[CUP]))
    assert len(scenes.messages) == 1, "nothing has changed"
    objects.publish(scene(3, FLOOR, SHELF))
    published = [
        (o.id, o.operation, o.header.stamp.nanosec)
        for o in scenes.messages[-1].world.collision_objects
    ]
    assert published == [("tccm_object_3", REMOVE, 3), ("tccm_surface_4", REMOVE, 3)]
    scenes.listeners = 2
    objects.publish(scene(4, FLOOR, SHELF))
    (shelf,) = scenes.messages[-1].world.collision_objects
    assert (shelf.id, shelf.operation) == ("tccm_surface_7", ADD)


@pytest.mark.skipif(not is_installed(PLANNING_SCENE), reason="moveit_msgs has no PlanningScene")
def test_a_target_is_attached_by_the_service_and_leaves_both_topics():
    scenes, whole, services = Publisher(), Publisher(), {"none": None}
    node = node_of(services, planning_scene=scenes, collision_object=whole)
    objects = CollisionObjects(node, TYPES)
    objects.publish(scene(1, TABLE, objects=[CUP]))
    request = SimpleNamespace(object_id=3, state=2, link_name="gripper", touch_links=["finger"])
    answer = services["~/set_scene_object"](request, SimpleNamespace())
    assert (answer.success, answer.message) == (True, "object 3 is attached")
    (held,) = scenes.messages[-1].robot_state.attached_collision_objects
    assert (held.object.id, held.link_name, held.touch_links) == (
        "tccm_object_3",
        "gripper",
        ["finger"],
    )
    objects.publish(scene(2, TABLE, objects=[CUP]))
    assert ("tccm_object_3", REMOVE) in [(m.id, m.operation) for m in whole.messages]
    request.object_id = 9
    answer = services["~/set_scene_object"](request, SimpleNamespace())
    assert not answer.success
    assert "no object 9" in answer.message


def test_without_moveit_nothing_is_published(monkeypatch):
    monkeypatch.setattr(collision, "is_installed", lambda kind: False)
    made = []
    node = SimpleNamespace(create_publisher=lambda *arguments: made.append(arguments), context=None)
    CollisionObjects(node, TYPES).publish(scene(1, TABLE))
    assert made == []
