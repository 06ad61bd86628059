"""The SLAM node over DDS: tf and pose, map and grid, save, load and reset."""

import json
from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from live_robot import START_NS, Listener, recording, slam, tccm, wait_until_done
from nav_msgs.msg import OccupancyGrid, Path
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from tccm_ros.geometry import compose2
from tccm_ros.nodes.ros_types import has_tf2_msgs, message_class
from tccm_ros.nodes.slam_node import raw_stamp_ns
from tccm_ros.nodes.solver.schedule import SolveSchedule
from tccm_ros.records import Odometry
from tccm_ros.records.building import stamp_ns_from_message

SECOND = 1_000_000_000
needs_tf = pytest.mark.skipif(not has_tf2_msgs(), reason="tf2_msgs is not installed")


def later(seconds: float) -> int:
    return START_NS + round(seconds * SECOND)


def trigger(ros, name):
    client = Listener(ros, "caller").node.create_client(Trigger, name)
    return ros.call(client, Trigger.Request())


@needs_tf
def test_map_to_odom_is_on_tf_from_the_first_scan_on(ros):
    node, robot, viewer = slam(ros), ros.robot(), Listener(ros)
    tf = viewer.listen(message_class("tf2_msgs/msg/TFMessage"), "/tf")
    ros.connect(node, viewer.node, "/tf")
    node.live._publish_tf()
    records = list(recording(1))
    robot.play(((t, r) for t, r in records if "scan" not in t), node)
    node.live._publish_tf()
    # Pending transforms would have arrived before this pose is asked for and answered.
    trigger(ros, "/surface_slam/save_map")
    assert node.processor.counts["level scans"] == 0
    assert not [m for m in tf if any(t.header.frame_id == "map" for t in m.transforms)]
    robot.play(recording(1, start_ns=later(2)), node)
    newest = max(r.stamp_ns for t, r in recording(1, start_ns=later(2)) if t == "scan")
    ros.spin_until(
        lambda: (
            tf and stamp_ns_from_message(tf[-1].transforms[0].header.stamp) == newest + SECOND // 10
        )
    )
    transform = tf[-1].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "odom")


def test_pose_and_map_to_odom_are_published_also_without_tf(ros, monkeypatch):
    node, robot, viewer = slam(ros, tf__publish=False), ros.robot(), Listener(ros)
    poses = viewer.listen(PoseWithCovarianceStamped, "/pose")
    odom = viewer.listen(TransformStamped, "/surface_slam/map_to_odom")
    ros.connect(node, viewer.node, "/pose", "/surface_slam/map_to_odom")
    # The covariance grows from scan to scan; a solution would know the pose better.
    monkeypatch.setattr(SolveSchedule, "is_due", lambda *_: False)
    monkeypatch.setattr(SolveSchedule, "is_final_due", lambda *_, **__: False)
    robot.play(recording(3, speed=0.3, tilt=False), node)
    last_ns = node.processor.current_pose().stamp_ns
    ros.spin_until(lambda: poses and stamp_ns_from_message(poses[-1].header.stamp) == last_ns)
    ros.spin_until(
        lambda: odom and stamp_ns_from_message(odom[-1].header.stamp) == last_ns + SECOND // 10
    )
    covs = [np.array(p.pose.covariance).reshape(6, 6) for p in poses]
    for cov in covs:
        assert np.allclose(cov, cov.T)
        assert (np.linalg.eigvalsh(cov) >= -1e-12).all()
    # The first scan is where the map begins.
    assert covs[-1][0, 0] > covs[1][0, 0] > 0.0
    # A metre of driving without noise: matching is as good as its grid.
    assert abs(poses[-1].pose.pose.position.x - 0.3 * 0.05 * 59) < 0.02
    assert poses[-1].header.frame_id == odom[-1].header.frame_id == "map"


def test_map_to_odom_is_of_the_odometry_as_it_was_sent(ros):
    """Odometry that begins far away is kept near an origin inside, and nobody outside knows it."""
    node, robot, viewer = slam(ros, tf__publish=False), ros.robot(), Listener(ros)
    odom = viewer.listen(TransformStamped, "/surface_slam/map_to_odom")
    ros.connect(node, viewer.node, "/surface_slam/map_to_odom")
    far = np.eye(4)
    far[:2, 3] = 450_000.0, 5_400_000.0
    records = [
        (topic, replace(r, T_odom_base=far @ r.T_odom_base) if isinstance(r, Odometry) else r)
        for topic, r in recording(3, speed=0.3)
    ]
    robot.play(records, node)
    last_ns = node.processor.current_pose().stamp_ns
    ros.spin_until(
        lambda: odom and stamp_ns_from_message(odom[-1].header.stamp) == last_ns + SECOND // 10
    )
    found = odom[-1].transform.translation
    # The map's origin is the first pose of the base, and wheels without noise do not drift.
    assert found.x == pytest.approx(-450_000.0, abs=0.02)
    assert found.y == pytest.approx(-5_400_000.0, abs=0.02)


def test_the_pose_has_the_height_of_odometry_and_map_to_odom_has_none(ros):
    node, robot, viewer = slam(ros, tf__publish=False), ros.robot(), Listener(ros)
    poses = viewer.listen(PoseWithCovarianceStamped, "/pose")
    odom = viewer.listen(TransformStamped, "/surface_slam/map_to_odom")
    ros.connect(node, viewer.node, "/pose", "/surface_slam/map_to_odom")
    high = np.eye(4)
    high[2, 3] = 0.76
    records = [
        (topic, replace(r, T_odom_base=high @ r.T_odom_base) if isinstance(r, Odometry) else r)
        for topic, r in recording(1, speed=0.3)
    ]
    robot.play(records, node)
    ros.spin_until(lambda: poses and odom)
    assert poses[-1].pose.pose.position.z == 0.76
    assert odom[-1].transform.translation.z == 0.0


def test_pose_and_map_to_odom_take_the_correction_of_a_solution(ros):
    node, robot = slam(ros), ros.robot()
    robot.play(recording(3, speed=0.3), node)
    wait_until_done(ros, node)
    node.worker.wait(node.session.ask_solution)
    ros.spin_until(lambda: node.solver.newest is not None and not node.solver.is_solving)
    before, solved = node.live._live, node.solver.newest
    shift = np.array([1.0, 2.0, 0.5])
    newest = solved.map.keyframe
    moved = solved.map._replace(
        p_map_tracking=compose2(shift, solved.map.p_map_tracking),
        keyframe=newest._replace(pose=compose2(shift, newest.pose)),
        walls=solved.map.walls._make(a[:0] for a in solved.map.walls),
    )
    node.worker.wait(lambda: node.session.take_solved(solved._replace(map=moved)))
    # At once, and with the next scan.
    assert np.allclose(node.live._live.map_odom, compose2(shift, before.map_odom), atol=0.005)
    robot.play(recording(1, start_ns=later(3.1)), node)
    wait_until_done(ros, node)
    assert node.live._live.stamp_ns > before.stamp_ns
    expected = compose2(shift, before.map_odom)
    assert np.allclose(node.live._live.map_odom, expected, atol=0.05)


@pytest.mark.every_distro
def test_both_nodes_make_one_map_which_is_saved_loaded_and_reset(ros, tmp_path):
    folder = tmp_path / "map"
    tilt_node, node = tccm(ros), slam(ros, save__directory=str(folder))
    robot, viewer = ros.robot(), Listener(ros)
    surfaces = viewer.listen(MarkerArray, "/surface_slam/surfaces", latched=True)
    grids = viewer.listen(OccupancyGrid, "/map", latched=True)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view")
    robot.play(recording(4), tilt_node, node)
    cycles = tilt_node.processor.counts["cycles"]
    ros.spin_until(lambda: node.processor.counts["clouds"] == cycles)
    answer = trigger(ros, "/surface_slam/save_map")
    assert answer.success, answer.message
    assert {p.name for p in folder.iterdir()} >= {
        "surfaces.json", "walls.json", "graph.json", "trajectory.tum", "map.pgm", "map.yaml",
        "map.mcap",
    }  # fmt: skip
    (floor,) = (
        f"{s['area']:.2f} m2"
        for s in json.loads((folder / "surfaces.json").read_text())["surfaces"]
        if s["label"] == "floor"
    )
    # The markers of the solution that was saved may come after the answer.
    ros.spin_until(
        lambda: grids and surfaces and any(floor in m.text for m in surfaces[-1].markers)
    )
    grid = grids[-1]
    cells = np.array(grid.data, np.int8).reshape(grid.info.height, grid.info.width)
    assert set(np.unique(cells)) == {-1, 0, 100}
    texts = [m.text for m in surfaces[-1].markers if m.text]
    assert texts

    shown = len(surfaces)
    assert trigger(ros, "/surface_slam/reset").success
    assert node.solver.newest is None
    answer = trigger(ros, "/surface_slam/load_map")
    assert answer.success, answer.message
    ros.spin_until(lambda: len(surfaces) > shown)
    assert [m.text for m in surfaces[-1].markers if m.text] == texts
    robot.play(recording(2, start_ns=later(20)), tilt_node, node)
    assert node.processor.counts["level scans"] > 0


def test_loading_a_map_that_is_not_there_is_answered_with_an_error(ros, tmp_path):
    node = slam(ros, save__directory=str(tmp_path / "nowhere"))
    answer = trigger(ros, "/surface_slam/load_map")
    assert not answer.success
    assert "no such map" in answer.message
    assert node.context.ok()


def test_without_a_level_laser_tilt_stamps_make_the_trajectory(ros):
    node, robot, viewer = slam(ros), ros.robot(), Listener(ros)
    path = viewer.listen(Path, "/surface_slam/path", latched=True)
    records = [(t, r) for t, r in recording(3, speed=0.3) if t != "scan"]
    robot.play(records, node)
    trigger(ros, "/surface_slam/save_map")
    ros.spin_until(lambda: path)
    stamps = [r.stamp_ns for t, r in records if t == "tilt_scan"]
    assert [stamp_ns_from_message(p.header.stamp) for p in path[-1].poses] == stamps
    assert path[-1].poses[-1].pose.position.x == pytest.approx(0.3 * 0.05 * 60, abs=1e-6)


def test_the_stamp_of_a_serialised_scan_is_read_from_its_bytes(ros):
    robot = ros.robot()
    scan = next(r for t, r in recording(1) if t == "scan")
    from rclpy.serialization import serialize_message

    assert raw_stamp_ns(serialize_message(robot.message(scan))) == scan.stamp_ns


def test_autosave_writes_the_map_at_intervals_and_drops_no_scan(ros, tmp_path):
    folder = tmp_path / "auto"
    node = slam(ros, save__directory=str(folder), save__autosave_minutes=0.01)
    # A scan that waits for what brackets it is not given up for it.
    ahead = [(t, r) for t, r in recording(1) if r.stamp_ns < later(0.5) or t == "scan"]
    ros.robot().play(ahead, node)
    ros.spin_until(lambda: (folder / "map.mcap").exists())
    assert json.loads((folder / "surfaces.json").read_text())["surfaces"] == []
    (folder / "map.mcap").unlink()
    ros.spin_until(lambda: (folder / "map.mcap").exists())
    wait_until_done(ros, node)
    assert not node.dropped
