"""The parts of a view, which come as three messages in any order."""

from itertools import permutations

import numpy as np
import pytest
from empty_view import empty_view
from live_robot import slam

from tccm_ros.nodes.services.client_api import ClientApi
from tccm_ros.nodes.solver.schedule import ViewMessages
from tccm_ros.scene.scene import Scene


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_the_rest_of_a_view_is_waited_for(order):
    view = ViewMessages()
    assert not view.are_coming(0.0)
    for stamp_ns, now_s in ((1, 10.0), (2, 20.0)):
        *first, last = (empty_view(stamp_ns)[k] for k in order)
        for part in first:
            view.note(part, now_s)
            assert view.are_coming(now_s)
        view.note(last, now_s)
        assert not view.are_coming(now_s)


def test_a_part_that_never_comes_is_not_waited_for_long():
    view = ViewMessages()
    view.note(empty_view(1)[0], 10.0)
    assert view.are_coming(10.45)
    assert not view.are_coming(10.5)


def test_a_node_asks_for_no_solution_between_them(ros, monkeypatch):
    node, asked = slam(ros), []
    monkeypatch.setattr(node.solver, "solve", lambda listened, **_: asked.append(listened) or 1)
    for k, part in enumerate(empty_view(1_700_000_000_000_000_000)):
        assert not asked, k
        node.worker.wait(lambda p=part: node.process_event(p))
    assert len(asked) == 1


def test_late_views_of_a_stationary_robot_are_solved(ros, monkeypatch):
    monkeypatch.setattr("tccm_ros.nodes.solver.schedule.PATIENCE_S", 0.0)
    monkeypatch.setattr("tccm_ros.nodes.solver.schedule.PERIOD_S", 0.0)
    node, asked = slam(ros), []
    monkeypatch.setattr(node.solver, "solve", lambda listened, **_: asked.append(listened) or 1)
    for number, part in enumerate(empty_view(1_700_000_000_000_000_000), start=1):
        node.worker.wait(lambda p=part: node.process_event(p))
        assert len(asked) == number


def test_a_node_shows_the_objects_once_a_view_is_whole_if_anybody_listens(ros, monkeypatch):
    node, shown = slam(ros), []
    monkeypatch.setattr(ClientApi, "show_objects", lambda _, scene: shown.append(scene.stamp_ns))
    live = node.session._objects
    live.add_pose(1, np.zeros(3))
    live.take(Scene(1, "map", None, (), None))
    for stamp_ns, has_listeners in (
        (1_700_000_000_000_000_000, False),
        (1_700_000_005_000_000_000, True),
    ):
        monkeypatch.setattr(ClientApi, "has_scene_listeners", has_listeners)
        for part in empty_view(stamp_ns):
            assert not shown
            node.worker.wait(lambda p=part: node.process_event(p))
    assert shown == [1_700_000_005_000_000_000]
