"""Two nodes in one process share one robot: what is known is received once, events go to both."""

import pytest
from live_robot import START_NS, Listener, end_input, recording, settle, slam, tccm
from std_srvs.srv import SetBool

from tccm_ros.errors import ConfigError


def pair(ros, **values):
    mapper = tccm(ros, context=ros.context, **values)
    return mapper, slam(ros, context=ros.context, shared=mapper.robot, **values)


def test_each_record_is_received_and_judged_once(ros):
    nodes, robot = pair(ros), ros.robot()
    mapper, node = nodes
    robot.play(recording(4, speed=0.2), mapper, node)
    end_input(mapper)
    settle(ros, node)
    assert mapper.robot is node.robot
    assert not {"/odom", "/joint_states", "/robot_description"} & set(node.inputs.counts())
    sensors = mapper.robot.robot.sensors
    assert sensors["tilt_scan"].received == robot.sent["tilt_scan"]
    assert sensors["scan"].received == robot.sent["scan"]
    # The joint turns at the last scan: too short a sweep follows.
    assert mapper.processor.counts["scans used"] == robot.sent["tilt_scan"] - 1
    assert node.processor.counts["level scans"] == robot.sent["scan"]
    assert mapper.dropped == {"short tilt cycle": 1}
    assert not node.dropped
    ros.spin_until(lambda: node.processor.counts["clouds"] >= 3)


def test_a_pause_of_one_does_not_hold_the_other(ros):
    (mapper, node), robot, caller = pair(ros), ros.robot(), Listener(ros).node
    pause = caller.create_client(SetBool, "/tccm/pause")
    ros.call(pause, SetBool.Request(data=True))
    robot.play(recording(3), mapper, node)
    assert mapper.processor.counts["cycles"] == 0
    assert node.processor.counts["level scans"] > 20


def test_a_problem_is_told_by_the_node_that_it_concerns(ros):
    (mapper, node), robot = pair(ros), ros.robot()
    records = [r for r in recording(3) if r[0] != "joint_states"]
    robot.play(records, mapper, node)
    end_input(mapper)
    assert mapper.dropped["no joint samples"] > 3
    assert not node.dropped
    assert "joint" in "\n".join(mapper.all_problems())
    assert "joint" not in "\n".join(node.all_problems())


def test_stamps_that_go_back_begin_both_maps_anew_once(ros):
    (mapper, node), robot = pair(ros), ros.robot()
    robot.play(recording(3, start_ns=START_NS + 60_000_000_000), mapper, node)
    robot.play(recording(3), mapper, node)
    assert mapper.processor.counts["resets"] == node.processor.counts["resets"] == 1


def test_parameters_of_the_robot_must_agree(ros):
    mapper = tccm(ros, rig__tilt_offset=0.02)
    with pytest.raises(ConfigError, match="rig: nodes in one process share one robot"):
        slam(ros, shared=mapper.robot)
