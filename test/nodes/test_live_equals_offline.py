"""A bag played through DDS into both nodes gives the files of its replay, byte for byte.

The topics are reliable: everything has to arrive for the files to be equal.
"""

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from bag_player import play_bag
from depth_room import write_recording
from detections import seen_from_base, write_with_detections
from live_robot import slam, tccm
from rclpy.node import Node
from std_srvs.srv import Trigger

from tccm_ros.bags.reader import BagReader
from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.nodes.slam_node import SlamNode
from tccm_ros.nodes.tccm_node import TccmNode
from tccm_ros.replay.replay import replay
from tccm_sim.options import Options
from tccm_sim.recording import simulate

SYNC_S = 5.0
"""Played far faster than on a robot, one topic may be a second of message time behind another: with
the default of `sync_timeout` what comes so late counts as lost, live alone."""

SLOW_RATE = 3.0
"""For images: they wait in short queues, and may not come seconds after odometry."""

ROOT = Path(__file__).resolve().parents[2]
BAGS, PAPER = ROOT / "bags", ROOT / "config" / "paper.yaml"
OTHER_NAMES = (
    "tilt_scan:=/nod_lidar/scan",
    "scan:=/front_lidar/scan",
    "joint_states:=/dynamixel/joint_states",
    "odom:=/wheel_odom",
)
LONG = pytest.mark.skipif(
    "TCCM_LONG" not in os.environ, reason="a long recording: TCCM_LONG=1 pytest test/nodes"
)
SURFACE_MESSAGES = ("/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
EQUAL = (
    "surfaces.json",
    "objects.json",
    "racks.json",
    "surfaces.ply",
    "walls.json",
    "graph.json",
    "trajectory.tum",
    "cuboids.npz",
)


@pytest.mark.parametrize(
    ("bag", "remap", "config"),
    [
        pytest.param("walkthrough", (), None, marks=pytest.mark.every_distro),
        ("walkthrough", (), PAPER),
        ("upside_down", OTHER_NAMES, None),
        pytest.param("flat", (), None, marks=LONG),
    ],
)
def test_files_saved_by_live_nodes_equal_those_of_a_replay(
    ros, session_files, tmp_path, bag, remap, config
):
    """With a robot for both nodes: in the walkthrough with detections, below."""
    offline = session_files.replayed(bag) if config is None else session_files.once(
        f"offline_{bag}_{config.stem}",
        lambda out: replay(BAGS / bag, out, read_config(config), pictures=False),
    )  # fmt: skip
    words = [word for rule in remap for word in ("-r", rule)]
    words += [] if config is None else ["--params-file", str(config)]
    nodes = nodes_that_save(ros, tmp_path / "live", is_shared=False, words=words)
    play_and_save(ros, BAGS / bag, *nodes)
    assert_all_came(BAGS / bag, nodes)
    assert_equal(tmp_path / "live", offline)


def recorded_and_replayed(session_files, name: str, record) -> tuple[Path, Path]:
    """Return a recording that `record` writes to a path, and the results of its replay."""
    bag = session_files.once(f"recording_{name}", record)
    config = Config(sync_timeout=SYNC_S)
    return bag, session_files.once(
        f"offline_{name}", lambda out: replay(bag, out, config, pictures=False)
    )


def nodes_that_save(ros, folder: Path, is_shared: bool, words=()) -> tuple[TccmNode, SlamNode]:
    """Add both nodes, with one robot for both or one each."""
    common = {
        "context": ros.context,
        "words": words,
        "save__directory": str(folder),
        "sync_timeout": SYNC_S,
    }
    tilt_node = tccm(ros, **common)
    return tilt_node, slam(ros, shared=tilt_node.robot if is_shared else None, **common)


def play_and_save(
    ros, bag: Path, tilt_node: TccmNode, node: SlamNode, topics=SURFACE_MESSAGES, **player
) -> None:
    """Play a bag into both nodes, and save when all has come, of which nothing was dropped.

    `topics` are those of the surface message; `player` are parameters of the player.
    """
    ros.connect(tilt_node, node, *topics)
    play_bag(ros, bag, tilt_node, node, **player)
    ask = ros.add(Node("asker", context=ros.context))
    save(ros, ask, "/tccm/save_map")
    cycles = tilt_node.processor.counts["cycles"]
    for topic in topics:
        ros.spin_until(lambda t=topic: node.inputs.counts()[t] == cycles, what=topic)
    save(ros, ask, "/surface_slam/save_map")
    assert cycles > 0
    for each in (tilt_node, node):
        assert each.inputs.lost() == {}
        assert not each.overload


def assert_equal(live: Path, offline: Path) -> None:
    """Assert that the files of two folders have the same bytes."""
    for name in EQUAL:
        assert (live / name).read_bytes() == (offline / name).read_bytes(), name


def assert_all_came(bag: Path, nodes: tuple[TccmNode, SlamNode]) -> None:
    """Assert that both nodes together have received each message of a bag."""
    with BagReader(bag) as reader:
        sent = {topic.name: topic.count for topic in reader.topics()}
    counts = Counter(nodes[0].inputs.counts()) | Counter(nodes[1].inputs.counts())
    assert {topic: counts[topic] for topic in sent} == sent


def save(ros, node, service: str) -> None:
    """Save until the map has all that has come: a save does not wait long for a solution."""
    while True:
        answer = ros.call(node.create_client(Trigger, service), Trigger.Request())
        assert answer.success, answer.message
        if "not in it" not in answer.message:
            return


@pytest.mark.parametrize("is_shared", [False, True])
def test_a_depth_camera_and_a_lidar_are_mapped_live_as_offline(
    ros, session_files, tmp_path, is_shared
):
    bag, offline = recorded_and_replayed(session_files, "depth_room", write_recording)
    nodes = nodes_that_save(ros, tmp_path / "live", is_shared)
    play_and_save(ros, bag, *nodes, topics=("/tccm/surfaces", "/tccm/view"), rate=SLOW_RATE)
    assert nodes[0].processor.counts["cycles"] >= 3
    assert_equal(tmp_path / "live", offline)


@pytest.mark.parametrize("is_shared", [False, True])
def test_roll_and_pitch_by_an_imu_are_those_of_a_replay(ros, session_files, tmp_path, is_shared):
    options = Options(imu=True, stop_tilt=0.02, tilt_beams=181, people=False)
    bag, offline = recorded_and_replayed(
        session_files, "imu", lambda out: simulate("moved", out, options=options)
    )
    nodes = nodes_that_save(ros, tmp_path / "live", is_shared)
    play_and_save(ros, bag, *nodes)
    node = nodes[1]
    roll_pitch = node.robot.robot.roll_pitch.at(np.array([node.session.newest_ns]))
    assert np.abs(roll_pitch).max() > 0.005, "the base stood level in the end"
    assert_equal(tmp_path / "live", offline)


@pytest.mark.parametrize("is_shared", [False, True])
def test_recognised_objects_have_the_same_labels_live_and_offline(
    ros, session_files, tmp_path, is_shared
):
    pytest.importorskip("vision_msgs.msg", reason="vision_msgs is not installed")
    pytest.importorskip("tccm_interfaces.msg", reason="tccm_interfaces is not installed")
    from tccm_ros.client import SurfaceMapClient

    classes = {"box that stays": [("mug", 0.8), ("bowl", 0.1)], "box that comes": [("crate", 0.6)]}
    walkthrough = BAGS / "walkthrough"
    bag, offline = recorded_and_replayed(
        session_files, "detections",
        lambda out: write_with_detections(walkthrough, out, seen_from_base(walkthrough, classes)),
    )  # fmt: skip
    nodes = nodes_that_save(ros, tmp_path / "live", is_shared)
    client = SurfaceMapClient(ros.add(Node("program", context=ros.context)))
    play_and_save(ros, bag, *nodes)
    assert_all_came(bag, nodes)
    assert_equal(tmp_path / "live", offline)
    ros.spin_until(lambda: client.is_ready and client.objects_of_class("crate"), what="the crate")
    (mug,) = client.objects_of_class("mug")
    assert mug.confidence == pytest.approx(0.8)
    assert found_by(ros, client, "MUG table") == [mug.surface_id]
    assert found_by(ros, client, "bowl") == []
    before = "unused detection: no object of the map there"
    assert nodes[1].values()[before] > 0, "the crate was not there from the beginning"


def found_by(ros, client, text: str) -> list[int]:
    """Return the ids of the surfaces that a program finds by words."""
    from tccm_interfaces.msg import SurfaceFilter

    future = client.find_surfaces(SurfaceFilter(text=text))
    ros.spin_until(future.done, what=f"the answer to {text}")
    return [surface.id for surface in future.result()]
