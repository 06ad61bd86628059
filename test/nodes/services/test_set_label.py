"""A person corrects a label over DDS: it holds in the map, in the saved map and after loading."""

import json

import numpy as np
import pytest
from asker import Asker
from live_robot import Listener, recording, slam, tccm

from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.surface_messages import SURFACE_MAP

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")


def test_a_label_is_corrected_saved_and_loaded(ros, tmp_path):
    tilt_node, node = tccm(ros), slam(ros, save__directory=str(tmp_path))
    robot, viewer, asker = ros.robot(), Listener(ros), Asker(ros)
    maps = viewer.listen(message_class(SURFACE_MAP), "/surface_slam/surface_map", latched=True)

    def set_label(surface, label):
        return asker.ask("SetLabel", "/surface_slam/set_label", surface_id=surface, label=label)

    def labels():
        return {s.id: s.label for s in maps[-1].surfaces} if maps else {}

    early = set_label(0, "table")
    assert (early.success, "no map yet" in early.message) == (False, True)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: "table" in labels().values())
    (table,) = (k for k, label in labels().items() if label == "table")
    for surface, label, problem in (
        (99, "bed", "no surface 99"),
        (table, "throne", "no label 'throne'"),
        (table, "floor", "no label 'floor'"),
    ):
        refused = set_label(surface, label)
        assert (refused.success, problem in refused.message) == (False, True), refused.message
    floors = [k for k, label in labels().items() if label == "floor"]
    assert all("is the floor" in set_label(k, "table").message for k in floors)
    answer = set_label(table, "counter")
    assert (answer.success, answer.message) == (True, f"surface {table} was 'table'")
    ros.spin_until(lambda: labels().get(table) == "counter")
    saved = asker.ask("SaveMap", "/surface_slam/save_named_map", name="home")
    assert saved.success, saved.message
    written = json.loads((tmp_path / "home" / "labels.json").read_text())
    assert written["labels"] == [{"surface": table, "label": "counter"}]
    _check_placements(asker, json.loads((tmp_path / "home" / "objects.json").read_text()))
    assert set_label(table, "").success
    ros.spin_until(lambda: labels().get(table) == "table")
    loaded = asker.ask("LoadMap", "/surface_slam/load_named_map", name="home")
    assert loaded.success, loaded.message
    ros.spin_until(lambda: labels().get(table) == "counter")


def _check_placements(asker, written):
    """The saved placements are those that the service answers."""
    x, y, height = written["placements"]["size"]
    ranked = written["placements"]["ranked"]
    answer = asker.find_placements(size_x=x, size_y=y, height=height, max_count=len(ranked))
    found = [p.pose.position for p in answer.placements]
    expected = np.array([entry["position"] for entry in ranked])
    assert np.abs(np.array([[p.x, p.y, p.z] for p in found]) - expected).max() < 1e-6
    assert [p.surface_id for p in answer.placements] == [entry["surface"] for entry in ranked]
