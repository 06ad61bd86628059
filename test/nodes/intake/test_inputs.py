"""Inputs that give nothing are named, with what to do."""

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, LaserScan

from tccm_ros.nodes.intake.inputs import Inputs
from tccm_ros.nodes.qos import sensor_qos

SCAN = "sensor_msgs/msg/LaserScan"


def watched(ros, reliability="best_effort", silence=0.0):
    node = ros.add(Node("probe", context=ros.context))
    inputs = Inputs(node, silence)
    received = []
    inputs.subscribe(SCAN, "tilt_scan", received.append, sensor_qos(reliability))
    return inputs, received


def test_a_topic_without_publisher_is_a_problem_that_names_it(ros):
    inputs, _ = watched(ros)
    inputs.problems()
    ros.spin_until(lambda: any("nobody publishes '/tilt_scan'" in p for p in inputs.problems()))
    assert len(inputs.problems()) == 1


def test_an_input_that_is_not_needed_may_be_absent(ros):
    node = ros.add(Node("probe", context=ros.context))
    inputs = Inputs(node, 0.0)
    inputs.subscribe(SCAN, "extra", lambda _: None, sensor_qos(), watch="event")
    assert inputs.problems() == []
    assert inputs.problems() == []


def test_a_publisher_of_another_type_is_a_problem_that_names_it(ros):
    inputs, received = watched(ros)
    # One participant cannot have two types on a topic; another process can.
    talker = ros.add(Node("talker", context=ros.another_context()))
    talker.create_publisher(JointState, "tilt_scan", 10)
    ros.spin_until(
        lambda: any("published as sensor_msgs/msg/JointState" in p for p in inputs.problems())
    )
    assert inputs.problems() == [
        f"'/tilt_scan' is published as sensor_msgs/msg/JointState, {SCAN} is expected; remap the "
        "topic"
    ]
    assert received == []


def test_an_incompatible_qos_is_a_problem_that_names_it(ros):
    inputs, received = watched(ros, "reliable")
    talker = ros.add(Node("talker", context=ros.context))
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = talker.create_publisher(LaserScan, "tilt_scan", best_effort)
    ros.spin_until(lambda: any("incompatible reliability" in p for p in inputs.problems()))
    (problem,) = inputs.problems()
    assert "a publisher of '/tilt_scan'" in problem
    assert "qos.reliability" in problem
    publisher.publish(LaserScan())
    for _ in range(5):
        ros.executor.spin_once(timeout_sec=0.02)
    assert received == []


def test_the_problem_of_a_silent_input_ends_with_a_message(ros):
    inputs, received = watched(ros, silence=20.0)
    talker = ros.add(Node("talker", context=ros.context))
    publisher = talker.create_publisher(LaserScan, "tilt_scan", 10)
    ros.connect(talker, inputs._node, "/tilt_scan")
    publisher.publish(LaserScan())
    ros.spin_until(lambda: len(received) == 1)
    assert inputs.problems() == []
    assert inputs.counts() == {"/tilt_scan": 1}


def test_inputs_that_pause_one_after_the_other_are_not_silent(ros, monkeypatch):
    inputs, scans = watched(ros, silence=5.0)
    joints, now_s = [], [0.0]
    joint_type = "sensor_msgs/msg/JointState"
    inputs.subscribe(joint_type, "joint_states", joints.append, sensor_qos(), watch="stream")
    monkeypatch.setattr(inputs, "_now", lambda: round(now_s[0] * 1e9))
    talker = ros.add(Node("talker", context=ros.context))
    scan = talker.create_publisher(LaserScan, "tilt_scan", 10)
    joint = talker.create_publisher(JointState, "joint_states", 10)
    ros.connect(talker, inputs._node, "/tilt_scan", "/joint_states")
    inputs.problems()
    for now_s[0], publisher, message in ((1.0, joint, JointState()), (2.0, scan, LaserScan())):
        before = len(scans) + len(joints)
        publisher.publish(message)
        ros.spin_until(lambda b=before: len(scans) + len(joints) > b)
    now_s[0] = 6.5  # only the joints are older than 5 s
    assert inputs.problems() == []
    scan.publish(LaserScan())
    ros.spin_until(lambda: len(scans) == 2)
    (problem,) = inputs.problems()
    assert problem.startswith("'/joint_states' is silent")
