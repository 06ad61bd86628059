"""surface_<id> on /tf: where the simulated table truly is, as long as it is in the map."""

import numpy as np
import pytest
from live_robot import TABLE, Listener, recording, slam, tccm
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation

from tccm_ros.nodes.ros_types import is_installed, message_class

TF = "tf2_msgs/msg/TFMessage"
pytestmark = pytest.mark.skipif(not is_installed(TF), reason="tf2_msgs is not installed")


def matrix(transform):
    t, q = transform.translation, transform.rotation
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    T[:3, 3] = t.x, t.y, t.z
    return T


def surfaces_of(message) -> list:
    return [t for t in message.transforms if "surface_" in t.child_frame_id]


def test_the_frame_of_a_table_has_the_stamp_of_the_robots_pose(ros):
    tilt_node, node = tccm(ros), slam(ros, tf__surfaces=True, frames__prefix="bot1_")
    robot, viewer = ros.robot(prefix="bot1_"), Listener(ros)
    heard = viewer.listen(message_class(TF), "/tf")
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    robot.play(recording(6, prefix="bot1_"), tilt_node, node)
    ros.spin_until(lambda: heard and surfaces_of(heard[-1]), what="a frame of the table")
    odom, *surfaces = heard[-1].transforms
    (table,) = surfaces
    assert (table.header.frame_id, odom.header.frame_id) == ("bot1_map", "bot1_map")
    assert table.child_frame_id.startswith("bot1_surface_")
    assert table.header.stamp == odom.header.stamp, "tf places both at one time"
    T = matrix(table.transform)
    assert T[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=0.02), "z along the normal"
    assert abs(T[1, 0]) == pytest.approx(1.0, abs=0.02), "x along the longer edge, which is y here"
    x, y, z = T[:3, 3]
    assert (y, z) == pytest.approx((0.0, TABLE), abs=0.02), "the middle"
    assert 0.4 < x < 1.2
    node.set_parameters([Parameter("tf.surfaces", value=False)])
    heard.clear()
    ros.spin_until(lambda: heard and not surfaces_of(heard[-1]), what="/tf without surfaces")
    assert [t.child_frame_id for t in heard[-1].transforms] == ["bot1_odom"]
