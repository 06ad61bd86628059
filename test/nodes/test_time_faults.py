"""Stamps that are late, early, doubled or wrong; clocks that jump; joints that wrap."""

from dataclasses import replace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from fed import fed_slam
from live_robot import START_NS, Listener, end_input, recording, slam, tccm, wait_until_done
from rosgraph_msgs.msg import Clock

from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records import JointSample
from tccm_ros.ros.types import stamp_message

SECOND = 1_000_000_000


def cuboids(node):
    found = node.processor.map.cuboids()
    return found.ix, found.iy, found.top, found.bottom, found.count


def same_map(a, b) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(cuboids(a), cuboids(b)))


def delayed(records, topic, delay_ns):
    """Return a recording in which one topic arrives later."""
    arrivals = [
        (r.stamp_ns + (delay_ns if t == topic else 0), k, t, r) for k, (t, r) in enumerate(records)
    ]
    return [(t, r) for _, _, t, r in sorted(arrivals, key=lambda item: item[:2])]


def played(ros, records, **values):
    node, robot = tccm(ros, **values), ros.robot()
    robot.play(records, node)
    end_input(node)
    # Only its result is looked at: it must not hear what the next robot says.
    ros.remove(robot.node)
    ros.remove(node)
    return node


@pytest.mark.parametrize("topic", ["joint_states", "odom", "tilt_scan"])
def test_result_is_independent_of_a_late_topic(ros, topic):
    records = list(recording(3))
    straight = played(ros, records)
    late = played(ros, delayed(records, topic, 200_000_000))
    assert late.processor.counts["scans used"] == straight.processor.counts["scans used"]
    assert same_map(straight, late)


def test_duplicates_and_disorder_are_counted_and_do_not_show(ros):
    records = list(recording(3))
    straight = played(ros, records)
    scans = [k for k, (t, _) in enumerate(records) if t == "tilt_scan"]
    doubled = list(records)
    doubled.insert(scans[30] + 1, records[scans[30]])
    doubled.insert(scans[45] + 1, records[scans[20]])
    node = played(ros, doubled)
    assert node.dropped["duplicate stamp"] == 1
    assert node.dropped["out of order"] == 1
    assert same_map(straight, node)


def hastened(records, factor):
    """Return a recording in less time: its laser measures so much more often."""
    return [
        (t, replace(r, stamp_ns=START_NS + round((r.stamp_ns - START_NS) / factor)))
        for t, r in records
    ]


@pytest.mark.parametrize("setting", [{}, {"reorder_window": 0.12}])
def test_scans_out_of_order_within_the_window_are_all_used(ros, setting):
    """Those of a laser of 40 Hz that are late by up to 50 ms, with nothing set."""
    window_s = setting.get("reorder_window", 0.05)
    records = hastened(recording(3), 2.0)
    delays_ns = np.random.default_rng(1).integers(0, window_s * SECOND, len(records))
    arrivals = [r.stamp_ns + d * (t == "tilt_scan") for d, (t, r) in zip(delays_ns, records)]
    mixed = [records[k] for k in np.argsort(arrivals, kind="stable")]
    assert np.any(np.diff([r.stamp_ns for t, r in mixed if t == "tilt_scan"]) < 0)
    straight, node = played(ros, records), played(ros, mixed, **setting)
    assert not node.dropped["out of order"]
    assert node.processor.counts["scans used"] == straight.processor.counts["scans used"]
    assert same_map(straight, node)


def test_scans_beyond_the_window_are_counted_with_the_parameter(ros):
    records = list(recording(3))
    mixed = delayed_each_second_scan(records, 400_000_000)
    node, robot = tccm(ros), ros.robot()
    robot.play(mixed, node)
    dropped = node.dropped["out of order"]
    assert dropped > 10
    assert any("reorder_window" in text for text in node.all_problems())
    end_input(node)
    assert node.dropped["out of order"] == dropped


def delayed_each_second_scan(records, delay_ns):
    """Return a recording in which each second scan is overtaken."""
    scans = [r.stamp_ns for t, r in records if t == "tilt_scan"]
    late = set(scans[::2])
    arrivals = [
        r.stamp_ns + delay_ns * (t == "tilt_scan" and r.stamp_ns in late) for t, r in records
    ]
    return [records[k] for k in np.argsort(arrivals, kind="stable")]


def test_a_stamp_from_the_future_is_dropped_alone(ros):
    records = list(recording(3))
    k = [i for i, (t, _) in enumerate(records) if t == "tilt_scan"][30]
    wrong = replace(records[k][1], stamp_ns=records[k][1].stamp_ns + 3600 * SECOND)
    node = played(ros, [*records[:k], ("tilt_scan", wrong), *records[k + 1 :]])
    assert node.dropped["future stamp"] == 1
    assert node.processor.counts["resets"] == 0
    assert node.processor.counts["cycles"] >= 2


def test_odometry_from_the_future_does_not_move_the_robot():
    records = [(t, r) for t, r in recording(3, speed=0.3) if t == "odom"]
    wrong = replace(records[20][1], stamp_ns=records[20][1].stamp_ns + 3600 * SECOND)
    poses = []
    for sent in (records, [*records[:20], ("odom", wrong), *records[20:]]):
        fed = fed_slam()
        slam = fed.processor
        for _, record in sent:
            fed.add(record)
        for stamp_ns in (START_NS + SECOND, records[-1][1].stamp_ns):
            slam.add_pose_stamp(stamp_ns)
        fed.finish()
        poses.append(slam.solve().trajectory)
    assert np.array_equal(*poses)
    assert poses[0][0, 0] == pytest.approx(0.3, abs=1e-6)


def test_all_stamps_that_go_back_begin_a_new_map(ros):
    node, robot = tccm(ros), ros.robot()
    robot.play(recording(3, start_ns=START_NS + 60 * SECOND), node)
    assert node.processor.counts["resets"] == 0
    robot.play(recording(3), node)
    assert node.processor.counts["resets"] == 1
    assert node.processor.counts["cycles"] >= 4


def test_a_map_continues_after_stamps_jump_far_ahead(ros):
    node, robot = tccm(ros), ros.robot()
    robot.play(recording(3), node)
    cycles = node.processor.counts["cycles"]
    robot.play(recording(3, start_ns=START_NS + 3600 * SECOND), node)
    assert node.processor.counts["cycles"] >= cycles + 2
    assert node.processor.counts["resets"] == 0


def test_a_sensor_that_stops_and_comes_back_is_used_again(ros):
    records = list(recording(8))
    gap = (START_NS + 2 * SECOND, START_NS + 4 * SECOND)
    for topic in ("tilt_scan", "joint_states"):
        broken = [(t, r) for t, r in records if t != topic or not gap[0] < r.stamp_ns < gap[1]]
        node = played(ros, broken)
        used = node.processor.counts["scans used"]
        dropped = sum(node.dropped.values())
        sent = sum(t == "tilt_scan" for t, _ in broken)
        assert used + dropped == sent, topic
        assert used >= 80, topic


def test_a_joint_that_wraps_gives_the_same_cycles(ros):
    turned = [
        (t, replace(r, positions=wrapped(r.positions + np.pi - 0.7)) if t == "joint_states" else r)
        for t, r in recording(3)
    ]
    straight = played(ros, recording(3))
    node, robot = tccm(ros, rig__tilt_offset=0.7 - np.pi), ros.robot(described=False)
    robot.describe("continuous")
    robot.play(turned, node)
    end_input(node)
    assert node.processor.counts["scans used"] == straight.processor.counts["scans used"]
    assert node.processor.counts["cycles"] == straight.processor.counts["cycles"]


def wrapped(angles):
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


class SimTime:
    """Publishes /clock and waits until a node has it."""

    def __init__(self, ros):
        self.ros, self.types = ros, RosidlMessages()
        self.node = Listener(ros, "clock").node
        self.publisher = self.node.create_publisher(Clock, "/clock", 10)

    def set(self, stamp_ns, *nodes):
        for node in nodes:
            self.ros.connect(self.node, node, "/clock")
        self.publisher.publish(Clock(clock=stamp_message(self.types, stamp_ns)))
        for node in nodes:
            self.ros.spin_until(lambda n=node: n.get_clock().now().nanoseconds == stamp_ns)


def test_drivers_without_a_clock_can_be_stamped_on_arrival(ros):
    node = tccm(ros, qos__stamp="receive", use_sim_time=True)
    robot, clock = ros.robot(), SimTime(ros)
    ros.spin_until(lambda: node.robot.robot.frames.model)
    for topic, record in recording(2):
        if topic == "scan":
            continue
        clock.set(record.stamp_ns, node)
        message = robot.message(record)
        message.header.stamp = Time()
        before = node.inputs.counts()[f"/{topic}"]
        robot.publish(topic, message, node)
        ros.spin_until(lambda t=topic, n=before: node.inputs.counts()[f"/{t}"] == n + 1)
    wait_until_done(ros, node)
    assert node.processor.counts["cycles"] >= 1
    assert node.dropped["future stamp"] == 0


def test_clock_jumps_back_reset_the_map_and_a_missing_clock_is_named(ros):
    nodes = [tccm(ros, use_sim_time=True), slam(ros, use_sim_time=True)]
    for node in nodes:
        assert any("nobody publishes /clock" in text for text in node.all_problems())
    robot, clock = ros.robot(), SimTime(ros)
    clock.set(START_NS + 10 * SECOND, *nodes)
    robot.play(recording(3, start_ns=START_NS + 10 * SECOND), *nodes)
    for node in nodes:
        assert not any("/clock" in text for text in node.all_problems())
    assert nodes[0].processor.counts["cycles"] >= 2
    assert nodes[1].processor.counts["level scans"] > 0
    # A jump forward, as of a player that skips, is a pause: nothing is forgotten.
    clock.set(START_NS + 3600 * SECOND, *nodes)
    for node in nodes:
        wait_until_done(ros, node)
    assert nodes[0].processor.counts["resets"] == 0
    assert nodes[1].processor.counts["level scans"] > 0
    clock.set(START_NS, *nodes)
    for node in nodes:
        ros.spin_until(lambda n=node: n.processor.counts["resets"] == 1)
        wait_until_done(ros, node)
    assert len(nodes[0].processor.map.cuboids()) == 0
    scans = nodes[1].processor.counts["level scans"]
    assert nodes[1].processor.current_pose().stamp_ns < START_NS
    robot.play(recording(3), *nodes)
    assert nodes[0].processor.counts["cycles"] >= 4
    assert nodes[1].processor.counts["level scans"] > scans


def test_empty_joint_messages_and_other_joints_do_no_harm(ros):
    records = []
    for topic, record in recording(3):
        if topic == "joint_states":
            stamp = record.stamp_ns
            records.append((topic, JointSample(stamp, (), np.zeros(0))))
            records.append((topic, JointSample(stamp, ("wheel",), np.array([np.nan]))))
        records.append((topic, record))
    assert same_map(played(ros, recording(3)), played(ros, records))
