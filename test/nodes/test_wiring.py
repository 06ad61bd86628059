"""Wiring that is wrong is named with what to do: "running but nothing published" has a reason."""

import threading
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from live_robot import Listener, end_input, recording, slam, tccm
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import JointState, LaserScan, PointCloud2
from visualization_msgs.msg import MarkerArray

from tccm_ros.nodes.intake.drops import ADVICE, DropWatch
from tccm_ros.nodes.process import worker as worker_module
from tccm_ros.nodes.ros_types import has_tf2_msgs
from tccm_ros.records import Odometry, TransformSample
from tccm_ros.robot import sensor, stamp_guard, stamp_order
from tccm_ros.robot.base_motion import MotionSource
from tccm_ros.sensors import depth_image, laser_scan, point_cloud

OF_A_MOMENT = {
    "/planning_scene",
    "/diagnostics",
    "/parameter_events",
    "/pose",
    "/rosout",
    "/surface_slam/events",
    "/surface_slam/map_to_odom",
    "/tccm/object_boxes",
    "/tccm/surfaces",
    "/tccm/view",
    "/tf",
}
"""Topics whose messages tell of one moment; all others show the whole map."""


def problems(node) -> str:
    return "\n".join(node.all_problems())


def moved(record: Odometry) -> TransformSample:
    return TransformSample(
        record.stamp_ns, record.frame_id, record.child_frame_id, record.T_odom_base, False
    )


def test_scans_without_joints_name_the_joint(ros):
    node, robot = tccm(ros), ros.robot()
    robot.play([(t, r) for t, r in recording(2) if t != "joint_states"], node)
    end_input(node)
    assert node.dropped["no joint samples"] > 3
    text = problems(node)
    assert "scans are dropped, no joint samples" in text
    assert "tilt" in text
    assert "joint_states" in text


def test_joints_without_scans_name_the_scan_topic(ros):
    node, robot = tccm(ros, qos__silence=0.001), ros.robot()
    robot.play([(t, r) for t, r in recording(2) if t != "tilt_scan"], node)
    node.all_problems()
    ros.spin_until(lambda: "nobody publishes '/tilt_scan'" in problems(node))
    assert "nobody publishes '/joint_states'" not in problems(node)


def test_missing_description_error_names_the_topic_and_the_parameter(ros):
    node, robot = tccm(ros), ros.robot(described=False)
    robot.play(recording(2), node)
    text = problems(node)
    assert "no way from base to sensor" in text
    assert "robot_description" in text


def test_scans_of_another_frame_name_it(ros):
    node, robot = tccm(ros), ros.robot()
    records = [
        (t, replace(r, frame_id="elsewhere") if t == "tilt_scan" else r) for t, r in recording(2)
    ]
    robot.play(records, node)
    assert "elsewhere" in problems(node)


def test_odometry_that_is_advertised_but_silent_is_waited_for_and_named(ros):
    node, robot = tccm(ros, qos__silence=0.001), ros.robot()
    talker = Listener(ros, "wheels").node
    talker.create_publisher(OdometryMessage, "odom", 10)
    ros.spin_until(lambda: node.count_publishers("odom") == 1)
    robot.play([(t, r) for t, r in recording(2) if t != "odom"], node)
    assert node.dropped["no odometry"] > 3
    text = problems(node)
    assert "no odometry" in text
    ros.spin_until(lambda: "waits for '/odom'" in problems(node))


def test_without_odometry_the_base_stands_still(ros):
    node, robot, viewer = tccm(ros, frames__prefix="r1/"), ros.robot(), Listener(ros)
    planes = viewer.listen(MarkerArray, "/tccm/planes", latched=True)
    cloud = viewer.listen(PointCloud2, "/tccm/map_cloud", latched=True)
    robot.play([(t, r) for t, r in recording(3) if t != "odom"], node)
    assert node.processor.counts["cycles"] >= 2
    assert not node.dropped
    # Nothing names the odometry frame: it is ours, and so has the prefix.
    ros.spin_until(lambda: planes and cloud)
    frames = {m.header.frame_id for m in planes[-1].markers} | {cloud[-1].header.frame_id}
    assert frames == {"r1/odom"}


@pytest.mark.skipif(not has_tf2_msgs(), reason="tf2_msgs is not installed")
def test_tf_gives_the_motion_of_the_base_where_no_odometry_is_published(ros):
    nodes, robot = [tccm(ros), slam(ros)], ros.robot()
    records = []
    for topic, record in recording(3, speed=0.2):
        if isinstance(record, Odometry):
            topic, record = "/tf", moved(record)
        records.append((topic, record))
    robot.play(records, *nodes)
    tilt_node, node = nodes
    assert tilt_node.processor.counts["cycles"] >= 2
    assert tilt_node.robot.robot.motion.source is MotionSource.TF
    assert not tilt_node.dropped["no odometry"]
    last = node.processor.current_pose()
    assert abs(last.pose[0] - 0.2 * 0.05 * 59) < 0.02


def test_malformed_message_is_refused_reported_and_counted(ros):
    node, robot = tccm(ros), ros.robot()
    bad = LaserScan(angle_increment=float("nan"))
    for _ in range(3):
        robot.publish("tilt_scan", bad, node)
    robot.publish("joint_states", JointState(name=["a"], position=[1.0, 2.0]), node)
    ros.spin_until(lambda: node.refusals.counts == {"tilt_scan": 3, "joint_states": 1})
    robot.play(recording(3), node)
    assert node.processor.counts["cycles"] >= 2


def test_overload_drops_whole_scans_counts_them_and_bounds_memory(ros, monkeypatch):
    monkeypatch.setattr(worker_module, "BACKLOG", 40)
    monkeypatch.setattr(worker_module, "CEILING", 100)
    node, robot = tccm(ros), ros.robot()
    gate, held = threading.Event(), []
    node.worker.post(lambda: hold(gate, held))
    ros.spin_until(lambda: held)
    sent = list(recording(8))
    robot.play(sent, node, until_done=False)
    assert node.worker.backlog <= 100
    assert node.overload["overload"] > 0
    assert node.overload["overload: samples"] > 0
    assert "more comes in than can be processed" in problems(node)
    gate.set()
    end_input(node)
    scans = sum(t == "tilt_scan" for t, _ in sent)
    counted = node.processor.counts["scans used"] + sum(node.dropped.values())
    assert counted + node.overload["overload"] == scans


def hold(gate, held) -> None:
    held.append(1)
    gate.wait()


def test_a_late_listener_gets_every_map(ros):
    nodes, robot = [tccm(ros), slam(ros)], ros.robot()
    ros.connect(*nodes, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    robot.play(recording(4), *nodes)
    ros.spin_until(lambda: nodes[1].solver.newest is not None and nodes[1].solver.newest.scene)
    late = Listener(ros, "late")
    heard = {
        publisher.topic_name: late.listen(publisher.msg_type, publisher.topic_name, latched=True)
        for node in nodes
        for publisher in node.publishers
        if publisher.topic_name not in OF_A_MOMENT
    }
    assert len(heard) >= 12
    for topic, messages in heard.items():
        ros.spin_until(lambda m=messages: m, what=topic)


def test_lost_messages_are_counted(ros):
    node, robot = tccm(ros, qos__reliability="best_effort"), ros.robot(reliable=False)
    scan = robot.message(next(r for t, r in recording(1) if t == "tilt_scan"))
    # What was lost before the first message that came cannot be told.
    robot.publish("tilt_scan", scan, node)
    ros.spin_until(lambda: node.inputs.counts()["/tilt_scan"] == 1)
    gate, add = threading.Event(), node.add_record
    node.add_record = lambda role, record: (gate.wait(), add(role, record))
    for _ in range(600):  # while the intake is held: the queue holds 200
        robot.publish("tilt_scan", scan)
    gate.set()
    ros.spin_until(lambda: node.inputs.lost().get("/tilt_scan", 0) > 0)
    assert node.inputs.counts()["/tilt_scan"] + node.inputs.lost()["/tilt_scan"] <= 601


def test_the_restart_of_a_publisher_is_no_loss(ros):
    node = tccm(ros)
    scan = next(r for t, r in recording(1) if t == "tilt_scan")
    for count in (20, 40):
        robot = ros.robot(name=f"until_{count}")
        for _ in range(20):
            robot.publish("tilt_scan", robot.message(scan), node)
        ros.spin_until(lambda c=count: node.inputs.counts()["/tilt_scan"] == c)
        ros.remove(robot.node)
    assert node.inputs.lost() == {}


def test_reason_for_drops_is_a_warning_after_several_scans():
    watch = DropWatch()
    assert watch.problems(Counter({"no odometry": 2})) == []
    (text,) = watch.problems(Counter({"no odometry": 9}))
    assert ADVICE["no odometry"] in text
    assert watch.problems(Counter({"no odometry": 9})) == []
    assert watch.problems(Counter({"short tilt cycle": 99, "no odometry": 9})) == []


REASONS = {
    stamp_order.LATE, stamp_order.TWICE, stamp_order.ZERO, stamp_guard.ANOTHER_CLOCK,
    laser_scan.NOTHING_SEEN, laser_scan.NO_LIMITS, laser_scan.OUT_OF_LIMITS,
    laser_scan.TOO_FAR, laser_scan.LIMITS_TOO_FAR, point_cloud.NOTHING_SEEN,
    point_cloud.TOO_FAR, depth_image.TOO_FAR, depth_image.TOO_FAR_MM, depth_image.NOT_OPTICAL,
    sensor.TOO_LONG, "empty",
    "malformed", "no depths", "future stamp", "too many streams", "overload", "no joint samples",
    "no odometry", "no transform", "no way from base to sensor", "no camera info",
    "camera info of another frame", "image and camera info of different sizes",
}  # fmt: skip


@pytest.mark.parametrize("why", sorted(REASONS))
def test_each_reason_for_drops_names_a_remedy(why):
    (text,) = DropWatch().problems(Counter({why: 9}))
    assert ADVICE.get(why, "") in text
    assert why in ADVICE or "?" in why or "look at" in why or "expected" in why


def test_a_node_maps_from_when_the_robot_description_comes(ros):
    node, robot = tccm(ros), ros.robot(described=False)
    records = list(recording(6))
    robot.play(records[: len(records) // 2], node)
    robot.describe()
    ros.spin_until(lambda: node.robot.robot.frames.model)
    robot.play(records[len(records) // 2 :], node)
    assert node.processor.counts["cycles"] >= 1
    assert np.isfinite(node.processor.map.cuboids().top).all()


def test_two_nodes_of_one_name_are_a_problem(ros):
    first = tccm(ros)
    assert not any("another node" in text for text in first.all_problems())
    second = tccm(ros)
    for node in (first, second):
        ros.spin_until(
            lambda n=node: any("another node is called /tccm" in t for t in n.all_problems())
        )
