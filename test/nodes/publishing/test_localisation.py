"""~/localisation over DDS, and poses that are told on /initialpose and ~/set_pose."""

import numpy as np
import plan
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from live_robot import START_NS, Listener, recording, slam, wait_until_done
from std_srvs.srv import Trigger
from written_map import write_map

from tccm_ros.config import Config
from tccm_ros.errors import FrameError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.nodes.publishing.localisation import guess_of

pytest.importorskip("tccm_interfaces", reason="tccm_interfaces is not generated")

from tccm_interfaces.msg import Localisation
from tccm_interfaces.srv import SetPose


def supplied(x, y, yaw, frame="map"):
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z = float(np.sin(yaw / 2))
    message.pose.pose.orientation.w = float(np.cos(yaw / 2))
    return message


def test_pose_without_covariance_is_rough_and_in_another_frame_refused():
    guess = guess_of(supplied(1.0, 2.0, 0.5), "map")
    assert guess.pose == pytest.approx([1.0, 2.0, 0.5])
    assert np.sqrt(np.diag(guess.cov)) == pytest.approx([0.5, 0.5, np.radians(15.0)])
    with pytest.raises(FrameError, match=r"'odom'.*'map'"):
        guess_of(supplied(1.0, 2.0, 0.5, "odom"), "map")
    with pytest.raises(FrameError, match="not finite"):
        guess_of(supplied(float("nan"), 2.0, 0.5), "map")


def test_supplied_pose_replaces_the_known_one_once_a_scan_fits(ros):
    node, robot, viewer = slam(ros), ros.robot(), Listener(ros)
    states = viewer.listen(Localisation, "/surface_slam/localisation", latched=True)
    client = viewer.node.create_client(SetPose, "/surface_slam/set_pose")
    answer = ros.call(client, SetPose.Request(pose=supplied(0.0, 0.0, 0.0)))
    assert not answer.success
    assert "there is no map yet" in answer.message
    robot.play(recording(3, speed=0.3), node)
    ros.spin_until(lambda: states and states[-1].state == Localisation.TRACKING)
    assert states[-1].placed_by == Localisation.PLACED_BY_START
    # It is put back to the middle of the room, and its pose is supplied to 0.1 m.
    before = len(states)
    answer = ros.call(client, SetPose.Request(pose=supplied(0.1, 0.05, 0.02)))
    assert (answer.success, answer.localisation.state) == (True, Localisation.TRACKING)
    start_ns = START_NS + 3_200_000_000
    robot.play(recording(1, start_ns=start_ns, speed=0.0), node)
    wait_until_done(ros, node)
    ros.spin_until(
        lambda: (
            states[-1].state == Localisation.TRACKING
            and states[-1].placed_by == Localisation.PLACED_BY_REQUEST
        ),
        what="the supplied pose",
    )
    assert {s.state for s in states[before:]} == {Localisation.TRACKING}
    assert states[-1].reason == ""
    place = states[-1].pose.pose.position
    assert np.hypot(place.x, place.y) < 0.03


def test_a_robot_that_stands_is_found_in_a_loaded_map(ros, tmp_path):
    """One keyframe and one scan are enough, and the map is loaded before the solver is there."""
    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    robot.play(recording(2, tilt=False), node)
    caller = Listener(ros, "caller").node
    answer = ros.call(caller.create_client(Trigger, "/surface_slam/save_map"), Trigger.Request())
    assert answer.success, answer.message
    ros.remove(node)
    node, viewer = slam(ros, save__directory=str(tmp_path / "map")), Listener(ros, "viewer")
    states = viewer.listen(Localisation, "/surface_slam/localisation", latched=True)
    answer = ros.call(caller.create_client(Trigger, "/surface_slam/load_map"), Trigger.Request())
    assert answer.success, answer.message
    start_ns = START_NS + 60_000_000_000
    robot.play(recording(1, start_ns=start_ns, speed=0.0, tilt=False), node)
    ros.spin_until(
        lambda: states and states[-1].state == Localisation.TRACKING, what="the robot is found"
    )
    assert node.processor.counts["keyframes"] == 1
    assert states[-1].placed_by == Localisation.PLACED_BY_SCAN
    place = states[-1].pose.pose.position
    assert np.hypot(place.x, place.y) < 0.05


def test_robot_in_an_unmapped_room_begins_a_trajectory_beside_the_map(ros, tmp_path):
    """By stamps: it stands for 10 s in a room; the map is that of a ring of corridors."""
    ring = SurfaceSlam(Config())
    for scan in plan.drive(plan.ring(), plan.route([(0, 0), (12, 0), (12, 5)])).scans:
        ring.add(scan)
    write_map(tmp_path / "map", ring, ring.solve())
    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    viewer = Listener(ros, "viewer")
    states = viewer.listen(Localisation, "/surface_slam/localisation", latched=True)
    corrections = viewer.listen(TransformStamped, "/surface_slam/map_to_odom")
    client = viewer.node.create_client(Trigger, "/surface_slam/load_map")
    answer = ros.call(client, Trigger.Request())
    assert answer.success, answer.message
    robot.play(recording(8, tilt=False), node)
    wait_until_done(ros, node)
    assert not corrections
    robot.play(recording(3, start_ns=START_NS + 8_200_000_000, tilt=False), node)
    ros.spin_until(lambda: node.processor.is_unjoined, what="the trajectory")
    robot.play(recording(1, start_ns=START_NS + 11_400_000_000, tilt=False), node)
    ros.spin_until(
        lambda: corrections and "beside the map" in states[-1].reason, what="map -> odom, reason"
    )
    assert states[-1].state == Localisation.SEARCHING
    assert corrections[-1].transform.translation.x > 12.0 + 30.0
    assert any("beside the map" in problem for problem in node.problems())
