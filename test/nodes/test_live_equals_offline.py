"""A bag played through DDS into both nodes gives the files of its replay, byte for byte.

The topics are reliable: everything has to arrive for the files to be equal.
"""

import os
from pathlib import Path

import pytest
from depth_room import write_recording
from live_bag import EQUAL, SLOW_RATE, messages, play, save
from live_robot import slam, tccm
from rclpy.node import Node

from tccm_ros.config import Config
from tccm_ros.pipeline.replay import replay

BAGS = Path(__file__).resolve().parents[2] / "bags"
OTHER_NAMES = (
    "tilt_scan:=/nod_lidar/scan",
    "scan:=/front_lidar/scan",
    "joint_states:=/dynamixel/joint_states",
    "odom:=/wheel_odom",
)
LONG = pytest.mark.skipif(
    "TCCM_LONG" not in os.environ, reason="a long recording: TCCM_LONG=1 pytest test/nodes"
)


@pytest.mark.parametrize(
    ("bag", "remap", "is_shared"),
    [
        ("walkthrough", (), False),
        ("walkthrough", (), True),
        ("upside_down", OTHER_NAMES, False),
        pytest.param("flat", (), False, marks=LONG),
    ],
)
def test_what_live_nodes_save_equals_the_files_of_a_replay(ros, tmp_path, bag, remap, is_shared):
    live, offline = tmp_path / "live", tmp_path / "offline"
    replay(BAGS / bag, offline, Config(), pictures=False, remap=remap)
    words = [word for rule in remap for word in ("-r", rule)]
    common = {"context": ros.context, "words": words, "save__directory": str(live)}
    tilt_node = tccm(ros, **common)
    node = slam(ros, shared=tilt_node.robot if is_shared else None, **common)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    player = play(ros, BAGS / bag, tilt_node, node)
    assert player.published == messages(BAGS / bag)
    ask = ros.add(Node("asker", context=ros.context))
    save(ros, ask, "/tccm/save_map")
    cycles = tilt_node.processor.counts["cycles"]
    for topic in ("/tccm/surfaces", "/tccm/view", "/tccm/object_boxes"):
        ros.spin_until(lambda t=topic: node.inputs.counts()[t] == cycles, what=topic)
    save(ros, ask, "/surface_slam/save_map")
    assert cycles > 0
    for each in (tilt_node, node):
        assert each.inputs.lost() == {}
        assert not each.overload
    for name in EQUAL:
        assert (live / name).read_bytes() == (offline / name).read_bytes(), name


@pytest.mark.parametrize("is_shared", [False, True])
def test_a_depth_camera_and_a_lidar_are_mapped_live_as_offline(ros, tmp_path, is_shared):
    bag, live, offline = tmp_path / "bag", tmp_path / "live", tmp_path / "offline"
    write_recording(bag)
    replay(bag, offline, Config(), pictures=False)
    common = {"context": ros.context, "save__directory": str(live)}
    tccm_node = tccm(ros, **common)
    node = slam(ros, shared=tccm_node.robot if is_shared else None, **common)
    ros.connect(tccm_node, node, "/tccm/surfaces", "/tccm/view")
    play(ros, bag, tccm_node, node, rate=SLOW_RATE)
    ask = ros.add(Node("asker", context=ros.context))
    save(ros, ask, "/tccm/save_map")
    cycles = tccm_node.processor.counts["cycles"]
    for topic in ("/tccm/surfaces", "/tccm/view"):
        ros.spin_until(lambda t=topic: node.inputs.counts()[t] == cycles, what=topic)
    save(ros, ask, "/surface_slam/save_map")
    assert cycles >= 3
    for each in (tccm_node, node):
        assert each.inputs.lost() == {}
        assert not each.overload
    for name in EQUAL:
        assert (live / name).read_bytes() == (offline / name).read_bytes(), name
