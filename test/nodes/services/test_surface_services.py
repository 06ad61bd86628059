"""Questions over DDS while both nodes map: which surfaces, where there is room, and wrong ones."""

import numpy as np
import pytest
from asker import Asker
from geometry_msgs.msg import Point, PointStamped
from live_robot import Listener, recording, slam, tccm
from std_msgs.msg import Header

from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.surface_messages import SURFACE_EVENT, SURFACE_MAP

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

WRONG_PLACEMENTS = [
    ({"size_x": -0.1}, "size_x"),
    ({"size_y": float("nan")}, "size_y"),
    ({"height": 0.0}, "height"),
    ({"height": 1e9}, "height"),
    ({"clearance": -1.0}, "clearance"),
    ({"base": 9}, "base"),
    ({"base": 2}, "reach is 0"),
    ({"approach": 3}, "approach"),
    ({"hand_width": -0.1}, "hand_width"),
]
WRONG_OBJECTS = [
    ({"min_size": -0.1}, "min_size"),
    ({"max_size": float("nan")}, "max_size"),
    ({"hand_height": 1e9}, "hand_height"),
    ({"max_distance": 1.0}, "near has no frame_id"),
]
UNKNOWN, FREE, OCCUPIED = range(3)


def test_questions_are_answered_while_both_nodes_map(ros, tmp_path):
    tilt_node, node = tccm(ros), slam(ros, save__directory=str(tmp_path / "maps"))
    robot, viewer, asker = ros.robot(), Listener(ros), Asker(ros)
    maps = viewer.listen(message_class(SURFACE_MAP), "/surface_slam/surface_map", latched=True)
    events = viewer.listen(message_class(SURFACE_EVENT), "/surface_slam/events")
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.connect(node, viewer.node, "/surface_slam/events")
    assert "no map yet" in asker.surfaces().message
    assert not asker.box((0, 0, 1), (0.1, 0.1, 0.1)).success
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: maps and maps[-1].surfaces)
    answer = asker.surfaces()
    assert answer.success
    (table,) = answer.surfaces.surfaces
    assert table.label == "table"
    assert table.header.frame_id == "map"
    assert len(table.view_stamps) == len(table.view_points) > 0
    _check_surfaces(asker, table.id)
    _check_placements(asker, table.id)
    _check_objects(asker, table.id)
    _check_boxes(asker)
    _check_maps(asker, tmp_path)
    ros.spin_until(lambda: events)
    assert [(e.kind, e.label) for e in events] == [(1, "table")]
    assert list(events[0].surface_ids_after) == [table.id]
    assert np.isnan(events[0].pose_before.position.x)


def _check_surfaces(asker, table):
    near = PointStamped(header=Header(frame_id="base"), point=Point(x=1.0))
    assert [s.id for s in asker.surfaces(near=near, max_distance=2.0).surfaces.surfaces] == [table]
    assert asker.surfaces(near=near, max_distance=0.1).success
    assert not asker.surfaces(labels=["shelf"]).surfaces.surfaces
    near.header.frame_id = "bases"
    wrong = asker.surfaces(near=near)
    assert not wrong.success
    assert "no frame 'bases'" in wrong.message
    assert not asker.surfaces(min_area=float("nan")).success
    assert not asker.surfaces(max_distance=1.0).success


def _check_placements(asker, table):
    found = asker.find_placements(max_count=3)
    assert found.success, found.message
    assert [p.surface_id for p in found.placements] == [table] * 3
    assert all(abs(p.pose.position.z - 0.70) < 0.01 for p in found.placements)
    based = asker.find_placements(base=2, reach=1.0, robot_radius=0.2, max_count=1)
    for base in based.placements[0].base_poses:
        at = base.pose.position
        assert not (0.4 < at.x < 1.2 and abs(at.y) < 0.5), "not under the table"
        assert base.distance <= 1.0
    assert asker.find_placements(base=1, reach=1.2).placements
    none = asker.find_placements(base=1, reach=0.1)
    assert none.success
    assert not none.placements
    assert "within reach" in none.message
    for fields, word in WRONG_PLACEMENTS:
        wrong = asker.find_placements(**fields)
        assert not wrong.success
        assert word in wrong.message


def _check_objects(asker, table):
    """Nothing stands on the table, and it is in no rack."""
    found = asker.find_objects(surface_ids=[table], hand_width=0.1, hand_height=0.15)
    assert found.success, found.message
    assert (list(found.objects), found.message) == ([], "0 of 0 objects")
    near = PointStamped(header=Header(frame_id="base"), point=Point(x=1.0))
    assert asker.find_objects(near=near, max_distance=2.0).success
    for fields, word in WRONG_OBJECTS:
        wrong = asker.find_objects(**fields)
        assert not wrong.success
        assert word in wrong.message
    assert not asker.find_placements(approach=2, hand_width=0.1).placements
    assert asker.find_placements(approach=1, hand_height=0.2).placements


def _check_boxes(asker):
    top = asker.box((0.8, 0.0, 0.70), (0.2, 0.2, 0.1))
    assert (top.success, top.state) == (True, OCCUPIED), top.message
    assert top.cycle >= 0
    above = asker.box((0.8, 0.0, 0.85), (0.05, 0.05, 0.05), frame="base")
    assert (above.success, above.state) == (True, FREE), above.message
    assert asker.box((-2.0, 0.0, 0.5), (0.2, 0.2, 0.2)).state == UNKNOWN
    for size in ((-1, 1, 1), (0, 1, 1), (9, 9, 9), (float("nan"), 1, 1)):
        assert not asker.box((0, 0, 1), size).success
    assert not asker.box((0, 0, 1), (1, 1, 1), frame="nowhere").success


def _check_maps(asker, tmp_path):
    def save(name, **fields):
        return asker.ask("SaveMap", "/surface_slam/save_named_map", name=name, **fields)

    before = set(tmp_path.rglob("*"))
    for name in ("../x", "", ".x", "a/b", "a" * 101, "x.previous", "/absolute", "x\n"):
        assert not save(name).success
    assert set(tmp_path.rglob("*")) == before
    saved = save("home")
    assert saved.success, saved.message
    assert (saved.map.name, saved.map.sessions) == ("home", 1)
    assert not save("home").success
    assert save("home", overwrite=True).success
    listed = asker.ask("ListMaps", "/surface_slam/list_maps")
    assert [m.name for m in listed.maps] == ["home"]
    assert not asker.ask("LoadMap", "/surface_slam/load_named_map", name="away").success
    assert asker.ask("LoadMap", "/surface_slam/load_named_map", name="home").success
