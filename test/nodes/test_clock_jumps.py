"""Clocks that go back or ahead, over DDS: loops of a player, steps of NTP, restarts of a driver."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_robot import START_NS, URDF, Listener, recording, slam, tccm, wait_until_done
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.nodes.player_node import PlayerNode
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan, SurfaceCloud
from tccm_ros.ros.types import stamp_message
from tccm_ros.ros.writing import scan_message
from tccm_sim.sensor_messages import (
    joint_sample_message,
    odometry_message,
    robot_description_message,
)

SECOND = 1_000_000_000
MESSAGES = {
    JointSample: ("sensor_msgs/msg/JointState", joint_sample_message),
    Odometry: ("nav_msgs/msg/Odometry", odometry_message),
    Scan: ("sensor_msgs/msg/LaserScan", scan_message),
}


def shifted(records, seconds):
    """Return a recording with other stamps."""
    by = round(seconds * SECOND)
    return [(topic, replace(record, stamp_ns=record.stamp_ns + by)) for topic, record in records]


class Warnings:
    """What the nodes say on /rosout when they begin anew."""

    def __init__(self, ros):
        self._log = Listener(ros, "log").listen(Log, "/rosout", latched=True, depth=1000)

    def of(self, node) -> list[str]:
        return [m.msg for m in self._log if m.name == node.get_name() and "begins anew" in m.msg]


def any_says(statuses, *words) -> bool:
    return any(all(w in array.status[0].message for w in words) for array in statuses)


def both(ros, **values):
    return [tccm(ros, **values), slam(ros, **values)]


def resets(node) -> int:
    return node.processor.counts["resets"]


@pytest.mark.parametrize("back_s", [5.0, 30.0, 600.0])
def test_a_clock_set_back_begins_both_maps_anew_and_each_says_so_once(ros, back_s):
    nodes, robot, said = both(ros), ros.robot(), Warnings(ros)
    records = list(recording(6, speed=0.1))
    half = len(records) // 2
    robot.play(records[:half], *nodes)
    robot.play(shifted(records[half:], -back_s), *nodes)
    for node in nodes:
        assert resets(node) == 1
        ros.spin_until(lambda n=node: said.of(n))
        (text,) = said.of(node)
        assert f"went back by {back_s:.0f}" in text or f"went back by {back_s - 0.1:.1f}" in text
        assert not node.dropped["out of order"]
    assert nodes[0].processor.counts["cycles"] >= 4
    assert nodes[1].processor.current_pose().stamp_ns < records[half][1].stamp_ns


def test_a_clock_set_ahead_is_a_pause(ros):
    nodes, robot, said = both(ros), ros.robot(), Warnings(ros)
    records = list(recording(6, speed=0.1))
    half = len(records) // 2
    robot.play([*records[:half], *shifted(records[half:], 5.0)], *nodes)
    for node in nodes:
        assert resets(node) == 0
        assert not node.dropped["out of order"] + node.dropped["future stamp"]
        assert said.of(node) == []
    assert nodes[1].processor.counts["level scans"] >= 58
    assert nodes[0].processor.counts["cycles"] >= 4


def test_streams_go_back_one_after_the_other_while_one_has_ended(ros):
    """The last second before the step: one topic has just ended, the others overtake each other."""
    nodes, robot = both(ros), ros.robot()
    records = list(recording(6))
    half, end_ns = len(records) // 2, records[len(records) // 2][1].stamp_ns
    before = [
        (t, r) for t, r in records[:half] if not (t == "scan" and r.stamp_ns > end_ns - SECOND)
    ]
    after = [(t, r) for t, r in shifted(records[half:], -60.0) if t != "scan"]
    odometry = [k for k, (t, _) in enumerate(before) if t == "odom"]
    overtaken = [*before[: odometry[-2]], after[0], *before[odometry[-2] :], *after[1:]]
    robot.play(overtaken, *nodes)
    for node in nodes:
        assert resets(node) == 1


def test_driver_with_a_restarted_clock_is_reported_and_used_once_set(ros):
    node, robot, said = tccm(ros), ros.robot(), Warnings(ros)
    records = list(recording(20))
    wrong = range(len(records) // 3, 2 * len(records) // 3)
    sent = [
        (t, replace(r, stamp_ns=r.stamp_ns - START_NS) if t == "tilt_scan" and k in wrong else r)
        for k, (t, r) in enumerate(records)
    ]
    statuses = Listener(ros).listen(DiagnosticArray, "/diagnostics")
    robot.play(sent, node)
    assert resets(node) == 0
    assert said.of(node) == []
    is_reported = partial(any_says, statuses, "another clock", "qos.stamp")
    ros.spin_until(is_reported)
    bad = sum(t == "tilt_scan" for t, _ in sent[wrong.start : wrong.stop])
    assert node.dropped["another clock"] >= bad - 1
    assert not node.dropped["out of order"]
    assert node.processor.counts["cycles"] >= 11


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A short drive, as a recording."""
    types = TypestoreMessages()
    path = tmp_path_factory.mktemp("bags") / "drive"
    with BagWriter(path) as writer:
        model = RobotDescription(URDF.format(p="", kind="revolute"))
        message = robot_description_message(types, model)
        writer.write("/robot_description", "std_msgs/msg/String", START_NS, message)
        for topic, record in recording(4, speed=0.1):
            kind, build = MESSAGES[type(record)]
            writer.write(f"/{topic}", kind, record.stamp_ns, build(types, record))
    return path


@pytest.mark.parametrize("sim_time", [False, True])
def test_a_player_in_a_loop_begins_both_maps_anew_once_a_loop(ros, bag, sim_time):
    """The player's /clock goes back as that of `ros2 bag play --loop` does."""
    nodes, said = both(ros, use_sim_time=sim_time), Warnings(ros)
    values = {
        "bag": str(bag), "rate": 2.0, "loop": True, "reliable": True, "paused": True,
        "wait_for_subscribers": 20.0,
    }  # fmt: skip
    player = ros.add(
        PlayerNode(
            context=ros.another_context(),
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
    )
    topics = {publisher.topic_name for publisher in player.publishers}
    for node in nodes:
        ros.connect(player, node, *(topics & node.inputs.counts().keys()))
        if sim_time:
            ros.connect(player, node, "/clock")
    ros.call(player.create_client(SetBool, "/player/pause"), SetBool.Request(data=False))
    # A bit into the third run, where it stops: the second jump has been noticed.
    once = sum(1 for _ in recording(4)) + 1
    ros.spin_until(lambda: player.published > 2.3 * once)
    ros.executor.remove_node(player)
    for node in nodes:
        ros.spin_until(lambda n=node: len(said.of(n)) == 2)
        wait_until_done(ros, node)
        assert resets(node) == 2
        assert not node.dropped["out of order"] + node.dropped["another clock"]
    # Of each run the scans of whole tilt cycles are used; the jump cuts the last one.
    used, cut = nodes[0].processor.counts["scans used"], nodes[0].dropped["clock jump"]
    assert used >= 60, nodes[0].dropped
    assert used + cut >= 150, nodes[0].dropped
    assert nodes[1].processor.counts["level scans"] >= 80


def test_a_clock_that_goes_back_without_records_begins_anew_as_well(ros):
    nodes, robot, said = both(ros, use_sim_time=True), ros.robot(), Warnings(ros)
    clock = Listener(ros, "clock").node
    publisher = clock.create_publisher(Clock, "/clock", 10)
    for node in nodes:
        ros.connect(clock, node, "/clock")
    types = RosidlMessages()
    publisher.publish(Clock(clock=stamp_message(types, START_NS + 60 * SECOND)))
    robot.play(recording(2, start_ns=START_NS + 60 * SECOND), *nodes)
    publisher.publish(Clock(clock=stamp_message(types, START_NS)))
    for node in nodes:
        ros.spin_until(lambda n=node: resets(n) == 1 and said.of(n))
        assert "the clock stepped back by 60" in said.of(node)[0]


def test_surface_message_from_before_a_clock_jump_is_not_mapped(ros):
    node, robot = slam(ros), ros.robot()
    robot.play(recording(2, start_ns=START_NS + 60 * SECOND), node)
    robot.play(recording(2), node)
    assert resets(node) == 1
    points = np.zeros((0, 3), np.float32)
    late = SurfaceCloud(START_NS + 61 * SECOND, "base", points, np.zeros(0, np.uint32))
    node.queue_computed("surfaces", late)
    wait_until_done(ros, node)
    assert node.processor.counts["clouds"] == 0
    node.queue_computed("surfaces", replace(late, stamp_ns=START_NS + SECOND))
    wait_until_done(ros, node)
    assert node.processor.counts["clouds"] == 1
