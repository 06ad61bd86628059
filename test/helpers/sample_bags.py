"""Small bags for the tests of this folder."""

import numpy as np

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan, TransformSample
from tccm_ros.ros.writing import scan_message, transforms_message
from tccm_sim.sensor_messages import (
    joint_sample_message,
    odometry_message,
    robot_description_message,
)

TYPES = TypestoreMessages()
START = 1_700_000_000_000_000_000
SCAN, ODOM, JOINTS = (
    "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/JointState",
)
STRING, TF = "std_msgs/msg/String", "tf2_msgs/msg/TFMessage"


def sample_messages(n=20, beams=30):
    """Return (topic, type, log_ns, message) in log order: a robot that drives and tilts."""
    rng = np.random.default_rng(0)
    mount = TransformSample(START, "base_link", "laser", pose_from_rpy([0, 0, 1, 0, 0, 0]), True)
    arm = TransformSample(START, "base_link", "arm", np.eye(4), True)
    messages = [
        ("/robot_description", STRING, START, robot_description_message(
            TYPES, RobotDescription("<robot/>"))),
        ("/tf_static", TF, START, transforms_message(TYPES, [mount, arm])),
    ]  # fmt: skip
    for k in range(n):
        stamp = START + k * 20_000_000
        ranges = (2 + rng.normal(size=beams) * 0.01).astype(np.float32)
        scan = Scan(stamp, "laser", -1.0, 0.05, 1e-5, 0.1, 30.0, ranges)
        pose = pose_from_rpy([0.1 * k, 0, 0, 0, 0, 0.01 * k])
        joint = JointSample(stamp, ("tilt",), np.array([0.1 * k]))
        messages += [
            ("/odom", ODOM, stamp, odometry_message(
                TYPES, Odometry(stamp, "odom", "base_link", pose))),
            ("/joint_states", JOINTS, stamp + 1000, joint_sample_message(TYPES, joint)),
            ("/tilt_scan", SCAN, stamp + 2000, scan_message(TYPES, scan)),
        ]  # fmt: skip
    return messages


def write_sample(path, n=20, beams=30, **options):
    """Write the sample with the package's writer."""
    with BagWriter(path, typestore=TYPES, **options) as writer:
        for topic, msgtype, stamp, message in sample_messages(n, beams):
            writer.write(topic, msgtype, stamp, message)
    return path


def expected_records(n=20):
    """Return the number of records of each role in the sample."""
    return {
        "robot_description": 1,
        "tf_static": 2,
        "odom": n,
        "joint_states": n,
        "tilt_scan": n,
    }
