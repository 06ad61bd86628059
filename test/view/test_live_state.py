"""What pages are told: all at first, then what has changed, within a budget."""

import json

import numpy as np

from tccm_ros.view.live_state import LiveState, path_entity, surface_entity

SQUARE = np.array([[0.0, 0, 0.7], [1, 0, 0.7], [1, 1, 0.7], [0, 1, 0.7]])
UP = np.array([0.0, 0, 1])


def applied(deltas):
    """Return the entities that a page has after a snapshot and deltas."""
    entities = {}
    for delta in deltas:
        for name in delta.get("gone", []):
            del entities[name]
        entities |= delta.get("set", {})
    return entities


def test_delta_has_changes_alone():
    state = LiveState()
    state.entities = {"surface/1": {"a": 1}, "surface/2": {"a": 2}}
    assert state.delta(1000)["set"] == state.entities
    assert state.delta(1000) == {}
    state.entities = {"surface/2": {"a": 3}}
    assert state.delta(1000) == {"gone": ["surface/1"], "set": {"surface/2": {"a": 3}}}
    state.pose = [1.0, 2.0, 0.5]
    state.add_event("appeared: table 2")
    assert state.delta(1000) == {"pose": [1.0, 2.0, 0.5], "events": ["appeared: table 2"]}


def test_new_page_gets_the_state_of_the_others():
    state = LiveState()
    state.entities = {f"surface/{k}": {"text": "x" * 100} for k in range(10)}
    state.add_event("one")
    deltas = [state.delta(300)]
    late = state.snapshot()
    assert late["set"] == deltas[0]["set"]
    assert late["events"] == ["one"]
    while delta := state.delta(300):
        deltas.append(delta)
    assert applied(deltas) == applied([late, *deltas[1:]]) == state.entities


def test_the_budget_bounds_each_delta_and_an_entity_beyond_it_comes_alone():
    state = LiveState()
    state.entities = {f"surface/{k}": {"text": "x" * (500 if k == 3 else 50)} for k in range(6)}
    sizes = []
    while delta := state.delta(200):
        texts = [len(json.dumps(value)) for value in delta["set"].values()]
        sizes.append(sum(texts))
        assert sizes[-1] <= 200 or len(texts) == 1
    assert len(sizes) > 2


def test_a_surface_has_triangles_of_its_outline():
    entity = surface_entity(
        {"id": 3, "label": "table", "height": 0.7}, SQUARE, [], UP, [0.5, 0.5, 0.7]
    )
    corners = np.array(entity["shape"]["v"]).reshape(-1, 3)[entity["shape"]["t"]].reshape(-1, 3, 3)
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert areas.sum() / 2 == 1.0
    assert entity["floor"] is False
    assert entity["at"] == [0.5, 0.5, 0.7]


def test_a_long_path_is_thinned_and_keeps_its_length_and_its_end():
    xy = np.column_stack([np.linspace(0, 10, 5001), np.zeros(5001)])
    path = path_entity(xy)
    assert path["length"] == 10.0
    assert len(path["xy"]) <= 2 * 502
    assert path["xy"][-2:] == [10.0, 0.0]
