"""Nodes with a parameter file: what `tccm calibrate` writes, and a rig without a URDF."""

from types import SimpleNamespace

import numpy as np
import pytest
from fed import fed_tccm
from live_robot import HEIGHT, URDF, end_input, recording, slam, tccm
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import LaserScan

from tccm_ros.calibrate.calibration import Calibration
from tccm_ros.calibrate.observability import Observability
from tccm_ros.config import Config, RigConfig
from tccm_ros.config.reader import read_config
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records import RobotDescription
from tccm_ros.ros.writing import scan_message
from tccm_ros.sensors.laser_scan import scan_from_message

CALIBRATED = RigConfig(
    tilt_offset=0.021,
    tilt_scale=0.9950,
    joint_time_offset=9.3e-05,
    mount_correction=(0.0, 0.000206, -0.0156, 0.02, 0.0, 0.0),
    level_correction=(-0.002186, 4e-06, 0.0, 0.0, 0.0, -2e-05),
)
WITHOUT_URDF = f"""
/**:
  ros__parameters:
    frames: {{base: base, tilt_joint: tilt}}
    rig:
      kinematics: rig
      tilt_laser: [0.0, 0.0, {HEIGHT}, 0.0, 0.0, 0.0]
      level_laser: [0.0, 0.0, 0.3, 0.0, 0.0, 0.0]
"""


@pytest.fixture
def rig_file(tmp_path):
    """Return rig.yaml as `tccm calibrate` writes it."""
    observability = Observability(None, (), np.zeros((0, 0)))
    path = tmp_path / "rig.yaml"
    laser = SimpleNamespace(cycles=[SimpleNamespace(is_image=False)])
    found = Calibration(("room",), CALIBRATED, RigConfig(), observability, laser, (), None, ("x",))
    path.write_text(found.yaml())
    return path


def offline(config):
    fed = fed_tccm(config)
    fed.add(RobotDescription(URDF.format(p="", kind="revolute")))
    for topic, record in recording(3):
        if topic == "tilt_scan":  # what is sent has angles in single precision
            sent = serialize_message(scan_message(RosidlMessages(), record))
            record = scan_from_message(deserialize_message(sent, LaserScan))
        if topic != "scan":
            fed.add(record)
    fed.finish()
    return fed.processor.map.cuboids()


def test_a_calibrated_rig_is_used_by_both_nodes_as_by_a_replay(ros, rig_file):
    words = ["--params-file", str(rig_file)]
    nodes, robot = [tccm(ros, words=words), slam(ros, words=words)], ros.robot()
    for node in nodes:
        assert node.config.rig == CALIBRATED == read_config(rig_file).rig
    robot.play(recording(3), *nodes)
    end_input(nodes[0])
    live, expected = nodes[0].processor.map.cuboids(), offline(read_config(rig_file))
    for name in ("ix", "iy", "top", "bottom", "count"):
        assert np.array_equal(getattr(live, name), getattr(expected, name)), name
    assert not np.array_equal(live.top, offline(Config()).top)


def test_a_rig_file_replaces_the_robot_description(ros, tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(WITHOUT_URDF)
    words = ["--params-file", str(path)]
    nodes, robot = [tccm(ros, words=words), slam(ros, words=words)], ros.robot(described=False)
    robot.play(recording(3, speed=0.2), *nodes)
    tilt_node, node = nodes
    assert tilt_node.processor.counts["cycles"] >= 2
    assert node.processor.counts["level scans"] > 20
    for each in nodes:
        assert not each.dropped
        assert not each.robot.problems(each.roles)
