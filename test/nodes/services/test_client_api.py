"""What slam_node offers programs, of the solutions in turn, without DDS."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from outlined_surfaces import surface
from shapely.geometry import box

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.config import Config
from tccm_ros.nodes.interfaces import MISSING, has_interfaces, service_class
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.services import client_api
from tccm_ros.nodes.services.client_api import ClientApi, offered
from tccm_ros.ros.surface_messages import SURFACE, surface_message
from tccm_ros.scene.scene import KnownSurface, Scene
from tccm_ros.surfaces.objects.scene_objects import SceneObject

TABLE = surface(box(0.0, 0.0, 1.2, 0.8), number=4)
DESK = surface(box(2.0, 0.0, 3.0, 0.8), number=7)

needs_interfaces = pytest.mark.skipif(not has_interfaces(), reason="no tccm_interfaces")


def known(surface_) -> KnownSurface:
    types = TypestoreMessages()
    message = types.serialize(SURFACE, surface_message(types, 1, "map", surface_, 0.0))
    return KnownSurface(replace(surface_, views=()), 2, bytes(message))


class Offering:
    """Programs of a node that keeps what it offers, and what it publishes."""

    def __init__(self, monkeypatch):
        self.services, self.published = {}, Counter()
        logger = SimpleNamespace(info=lambda text: None)
        self.node = SimpleNamespace(
            types=RosidlMessages(),
            config=Config(),
            robot=None,
            context=SimpleNamespace(ok=lambda: True),
            resolve_topic_name=lambda name: name.replace("~", "/surface_slam"),
            create_service=self._serve,
            create_publisher=self._publisher,
            create_client=lambda kind, name: SimpleNamespace(service_is_ready=lambda: False),
            get_logger=lambda: logger,
        )
        self.shown = []
        live = SimpleNamespace(show_surfaces=self.shown.append, map_frame="map")
        monkeypatch.setattr(client_api, "offer_scan_here", lambda *_: None)
        monkeypatch.setattr(client_api, "unpack_scene", lambda scene: scene)
        self.client_api = ClientApi(self.node, live, None, None, None)

    def _serve(self, kind, name, answer):
        self.services[name] = answer

    def _publisher(self, kind, name, qos):
        return SimpleNamespace(
            publish=lambda message: self.published.update([name]),
            get_subscription_count=lambda: 0,
        )

    def receive(self, number, *surfaces):
        scene = Scene(number, "map", 0.0, (), None, tuple(map(known, surfaces)), number, number - 1)
        self.client_api.receive(SimpleNamespace(number=number, scene=scene))
        return scene

    def show(self, number):
        self.client_api.show(number, lambda scene: scene)

    def found(self):
        kind = service_class("FindSurfaces")
        answer = self.services["~/find_surfaces"](kind.Request(), kind.Response())
        assert answer.success, answer.message
        return [s.id for s in answer.surfaces.surfaces]


@pytest.fixture
def offering(monkeypatch):
    return Offering(monkeypatch)


def test_topics_whose_types_are_missing_are_not_offered():
    topics = {"path": "nav_msgs/msg/Path", "tables": "no_such_msgs/msg/Tables"}
    assert offered(topics) == {"path": "nav_msgs/msg/Path"}


@needs_interfaces
def test_questions_are_answered_from_the_solution_that_is_shown(offering):
    """Not from one that is received before it is published; those before it are let go."""
    offering.receive(2, TABLE)
    offering.show(2)
    assert offering.found() == [4]
    offering.receive(3, TABLE)
    newest = offering.receive(4, TABLE, DESK)
    assert offering.found() == [4]
    offering.show(4)
    assert offering.found() == [4, 7]
    assert offering.shown[-1] is newest
    with pytest.raises(KeyError):
        offering.show(3)


@needs_interfaces
def test_each_change_is_published_once(offering):
    for number in (2, 3, 4):
        offering.receive(number, TABLE)
        offering.show(number)
    assert offering.published["~/events"] == 1


@needs_interfaces
def test_after_a_reset_queries_find_nothing_and_the_next_map_begins(offering):
    for number, is_map_loaded, events in ((2, False, 1), (3, False, 2), (4, True, 2)):
        offering.client_api.forget(is_map_loaded=is_map_loaded)
        kind = service_class("FindSurfaces")
        answer = offering.services["~/find_surfaces"](kind.Request(), kind.Response())
        assert (answer.success, "no map yet" in answer.message) == (False, True)
        offering.receive(number, TABLE)
        offering.show(number)
        assert offering.published["~/events"] == events
    assert list(offering.client_api.problems()) == []


def test_planners_get_the_newest_scene_and_queries_that_of_the_solution(offering):
    shown, cup = [], SceneObject(3, 4, np.zeros(3), np.ones(3), 0.0)
    offering.client_api._boxes = SimpleNamespace(publish=shown.append)
    solution = offering.receive(4, TABLE)
    newer = solution._replace(objects=(cup,), stamp_ns=5)
    offering.client_api.show(4, lambda scene: newer)
    assert shown == [newer]
    assert offering.shown == [solution]
    offering.client_api.show_objects(newer)
    assert shown == [newer, newer]


def test_missing_interfaces_are_reported_and_solutions_are_shown(monkeypatch):
    monkeypatch.setattr(client_api, "has_interfaces", lambda: False)
    monkeypatch.setattr(client_api, "missing_interfaces", lambda: MISSING)
    monkeypatch.setattr("tccm_ros.nodes.services.collision.has_interfaces", lambda: False)
    offering = Offering(monkeypatch)
    offering.receive(2, TABLE)
    offering.show(2)
    assert (offering.services, len(offering.shown)) == ({}, 1)
    assert list(offering.client_api.problems()) == [MISSING]
    offering.client_api.note_view_message(1, 1)
    offering.client_api.close()
