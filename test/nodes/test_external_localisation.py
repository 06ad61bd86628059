"""slam_node where another program localises the robot: it listens to map -> odom, and is quiet."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from live_robot import START_NS, Listener, recording, slam, tccm, topics_of, wait_until_done

from tccm_ros.geometry import planar, spatial
from tccm_ros.nodes.ros_types import has_tf2_msgs
from tccm_ros.records import Odometry, PoseCovariance, TransformSample

pytestmark = pytest.mark.skipif(not has_tf2_msgs(), reason="tf2_msgs is not installed")

T_MAP_ODOM = spatial(np.array([5.0, -3.0, 1.2]))

COV = np.diag([0.04, 0.05, 0.06])


def localised(records):
    """Yield a recording with map -> odom on /tf beside each odometry sample."""
    for topic, record in records:
        yield topic, record
        if isinstance(record, Odometry):
            sample = TransformSample(record.stamp_ns, "map", "odom", T_MAP_ODOM, False)
            yield "tf", sample
            yield "external_pose", PoseCovariance(record.stamp_ns, "map", COV)


def test_the_pose_and_the_surfaces_are_in_the_map_of_the_other_program(ros):
    both = {"localisation__source": "tf"}
    node, other = slam(ros, **both), tccm(ros, **both)
    robot, viewer = ros.robot(), Listener(ros)
    assert not {"/map", "/initialpose"} & topics_of(node)
    poses = viewer.listen(PoseWithCovarianceStamped, "/pose")
    ros.connect(node, viewer.node, "/pose")
    ros.connect(other, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    robot.play(recording(0.2), node, other)
    assert [p for p in node.problems() if "start your localisation" in p]
    robot.play(localised(recording(3, start_ns=START_NS + 10**9)), node, other)
    ros.spin_until(lambda: poses, what="a pose")
    cov = np.array(poses[-1].pose.covariance).reshape(6, 6)
    assert np.diag(cov)[[0, 1, 5]] == pytest.approx([0.04, 0.05, 0.06])
    p = poses[-1].pose.pose.position
    assert (p.x, p.y) == pytest.approx((5.0, -3.0))
    assert not [p for p in node.problems() if "start your localisation" in p]
    assert node.live._transforms() == []
    ros.spin_until(lambda: node.processor.counts["clouds"], what="a surface message")
    wait_until_done(ros, node)
    ros.spin_until(lambda: node.solver.newest is not None, what="a solution")
    assert planar(T_MAP_ODOM) == pytest.approx(node.processor.current_pose().map_odom)
