"""An IMU over DDS: both nodes take it."""

import numpy as np
from live_robot import Odometry, recording, slam, tccm, topics_of

from tccm_ros.records import Imu

BIAS = 0.01


def with_imu(records):
    """Yield records, and a sample of a gyroscope in the base with each of odometry."""
    for topic, record in records:
        yield topic, record
        if isinstance(record, Odometry):
            yield "imu", Imu(record.stamp_ns, record.child_frame_id, np.array([0.0, 0.0, BIAS]))


def test_the_bias_is_learnt_while_the_robot_stands(ros):
    node, robot = slam(ros), ros.robot()
    robot.play(with_imu(recording(8)), node)
    gyro = node.robot.robot.gyro
    assert len(gyro.track) == robot.sent["imu"] > 50
    assert abs(gyro.bias - BIAS) < 1e-6


def test_both_nodes_use_the_imu(ros):
    assert "/imu" in topics_of(slam(ros))
    assert "/imu" in topics_of(tccm(ros))
