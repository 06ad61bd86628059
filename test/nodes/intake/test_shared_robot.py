"""Two nodes in one process share one robot: what is known is received once, events go to both."""

import pytest
from live_robot import START_NS, Listener, end_input, recording, slam, tccm, wait_until_done
from std_srvs.srv import SetBool

from tccm_ros.errors import ConfigError


def pair(ros, **values):
    tilt_node = tccm(ros, context=ros.context, **values)
    return tilt_node, slam(ros, context=ros.context, shared=tilt_node.robot, **values)


def test_each_record_is_received_and_checked_once(ros):
    nodes, robot = pair(ros), ros.robot()
    tilt_node, node = nodes
    robot.play(recording(4, speed=0.2), tilt_node, node)
    end_input(tilt_node)
    wait_until_done(ros, node)
    assert tilt_node.robot is node.robot
    assert not {"/odom", "/joint_states", "/robot_description"} & set(node.inputs.counts())
    sensors = tilt_node.robot.robot.sensors
    assert sensors["tilt_scan"].received == robot.sent["tilt_scan"]
    assert sensors["scan"].received == robot.sent["scan"]
    # The joint turns at the last scan: too short a tilt cycle follows.
    assert tilt_node.processor.counts["scans used"] == robot.sent["tilt_scan"] - 1
    assert node.processor.counts["level scans"] == robot.sent["scan"]
    assert tilt_node.dropped == {"short tilt cycle": 1}
    assert not node.dropped
    ros.spin_until(lambda: node.processor.counts["clouds"] >= 3)


def test_a_pause_of_one_does_not_hold_the_other(ros):
    (tilt_node, node), robot, caller = pair(ros), ros.robot(), Listener(ros).node
    pause = caller.create_client(SetBool, "/tccm/pause")
    ros.call(pause, SetBool.Request(data=True))
    robot.play(recording(3), tilt_node, node)
    assert tilt_node.processor.counts["cycles"] == 0
    assert node.processor.counts["level scans"] > 20


def test_a_problem_is_reported_by_the_node_that_it_concerns(ros):
    (tilt_node, node), robot = pair(ros), ros.robot()
    records = [r for r in recording(3) if r[0] != "joint_states"]
    robot.play(records, tilt_node, node)
    end_input(tilt_node)
    assert tilt_node.dropped["no joint samples"] > 3
    assert not node.dropped
    assert "joint" in "\n".join(tilt_node.all_problems())
    assert "joint" not in "\n".join(node.all_problems())


def test_stamps_that_go_back_begin_both_maps_anew_once(ros):
    (tilt_node, node), robot = pair(ros), ros.robot()
    robot.play(recording(3, start_ns=START_NS + 60_000_000_000), tilt_node, node)
    robot.play(recording(3), tilt_node, node)
    assert tilt_node.processor.counts["resets"] == node.processor.counts["resets"] == 1


def test_parameters_of_the_robot_must_agree(ros):
    tilt_node = tccm(ros, rig__tilt_offset=0.02)
    with pytest.raises(ConfigError, match="rig: nodes in one process share one robot"):
        slam(ros, shared=tilt_node.robot)
    assert tilt_node.get_node_names() == ["tccm"], "a node that cannot be made is not there"
