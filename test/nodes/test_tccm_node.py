"""The TCCM node over DDS: topics, services, pause, reset, late viewers, nothing for nobody."""

from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_robot import START_NS, TABLE, Listener, recording, tccm, wait_until_done
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from tccm_ros.records import Odometry
from tccm_ros.ros.reading import surface_cloud_from_message, view_from_message

SECOND = 1_000_000_000


def later(seconds: float) -> int:
    return START_NS + round(seconds * SECOND)


@pytest.mark.every_distro
def test_a_tilt_cycle_gives_the_surface_message_and_the_markers(ros):
    node, robot, viewer = tccm(ros), ros.robot(), Listener(ros)
    surfaces = viewer.listen(PointCloud2, "/tccm/surfaces")
    view = viewer.listen(PointCloud2, "/tccm/view")
    planes = viewer.listen(MarkerArray, "/tccm/planes", latched=True)
    cloud = viewer.listen(PointCloud2, "/tccm/map_cloud", latched=True)
    ros.connect(node, viewer.node, "/tccm/surfaces", "/tccm/view")
    robot.play(recording(3), node)
    cycles = node.processor.counts["cycles"]
    assert cycles >= 2
    ros.spin_until(lambda: len(surfaces) == len(view) == cycles)
    ros.spin_until(lambda: planes and cloud)
    first = surface_cloud_from_message(surfaces[0])
    assert first.frame_id == "base"
    assert first.stamp_ns == view_from_message(view[0]).stamp_ns
    heights = [np.median(first.points[first.surface == k, 2]) for k in np.unique(first.surface)]
    # The room is free of noise: a surface is as high as float32 ranges can say.
    assert min(abs(np.array(heights) - TABLE)) < 1e-3
    assert [f.name for f in cloud[-1].fields] == ["x", "y", "z", "depth", "count", "cycle"]
    assert cloud[-1].header.frame_id == "odom"
    assert {m.action for m in planes[-1].markers} <= {Marker.ADD, Marker.DELETE}


def test_markers_and_clouds_are_in_the_frame_of_odometry_as_it_was_sent(ros):
    """Odometry that begins far away is kept near an origin inside, and nobody outside knows it."""
    node, robot, viewer = tccm(ros), ros.robot(), Listener(ros)
    planes = viewer.listen(MarkerArray, "/tccm/planes", latched=True)
    cloud = viewer.listen(PointCloud2, "/tccm/map_cloud", latched=True)
    far = np.eye(4)
    far[:2, 3] = 450_000.0, 5_400_000.0
    robot.play(
        [
            (t, replace(r, T_odom_base=far @ r.T_odom_base) if isinstance(r, Odometry) else r)
            for t, r in recording(3)
        ],
        node,
    )
    ros.spin_until(lambda: planes and cloud)
    at = [m.pose.position for m in planes[-1].markers if m.action == Marker.ADD and m.points]
    # Multiples of 1024 m.
    assert {(p.x, p.y, p.z) for p in at} == {(449_536.0, 5_399_552.0, 0.0)}
    rows = np.frombuffer(bytes(cloud[-1].data), np.uint8).reshape(-1, cloud[-1].point_step)
    y = rows[:, 4:8].copy().view(np.float32)
    assert abs(np.median(y) - 5_400_000.0) < 5.0


def test_obstacles_mark_a_costmap_as_a_laser_at_each_height_would(ros):
    node, robot, viewer = tccm(ros), ros.robot(), Listener(ros)
    clouds = viewer.listen(PointCloud2, "/tccm/obstacles", latched=True)
    robot.play(recording(3), node)
    ros.spin_until(lambda: clouds)
    cloud = clouds[-1]
    assert [(f.name, f.datatype) for f in cloud.fields] == [("x", 7), ("y", 7), ("z", 7)]
    assert cloud.header.frame_id == "odom"
    points = np.frombuffer(bytes(cloud.data), np.float32).reshape(-1, 3)
    # What an obstacle layer does: of the points between two heights, each marks its cell.
    high = points[(points[:, 2] > 0.1) & (points[:, 2] < 1.8)]
    marked = {(int(i), int(j)) for i, j in np.floor(high[:, :2] / 0.1)}
    assert (8, 0) in marked  # the table
    assert {(30, 0), (30, 5)} <= marked or {(29, 0), (29, 5)} <= marked  # the wall, at 3.0 m
    assert not {(20, j) for j in range(-5, 6)} & marked  # the floor between them
    # tf is asked for the stamp: that of the newest scan in it, for which odometry has come.
    stamp_ns = cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec
    scans = [r.stamp_ns for t, r in recording(3) if t == "tilt_scan"]
    assert stamp_ns in scans
    assert scans[-1] - stamp_ns <= 20 * 50_000_000


def test_markers_are_built_for_listeners_only_and_latched(ros, monkeypatch):
    node, robot, built = tccm(ros), ros.robot(), []
    serialize = node.bulk_types.serialize

    def counted(msgtype, message):
        built.append(msgtype)
        return serialize(msgtype, message)

    monkeypatch.setattr(node.bulk_types, "serialize", counted)
    robot.play(recording(3), node)
    published = 3 * node.processor.counts["cycles"]  # surfaces, view, boxes of objects
    assert len(built) == published
    viewer = Listener(ros)
    planes = viewer.listen(MarkerArray, "/tccm/planes", latched=True)
    cuboids = viewer.listen(MarkerArray, "/tccm/cuboids", latched=True)
    ros.spin_until(lambda: planes and cuboids)
    assert planes[-1].markers
    assert cuboids[-1].markers
    cores = Listener(ros, "cores").listen(MarkerArray, "/tccm/center_cores", latched=True)
    ros.spin_until(lambda: cores)
    assert [m.type for m in cores[-1].markers] == [Marker.LINE_LIST]
    another = Listener(ros, "another").listen(MarkerArray, "/tccm/planes", latched=True)
    ros.spin_until(lambda: another)
    assert another[-1].markers == planes[-1].markers
    assert len(built) == published + 3


def test_a_paused_node_keeps_its_map_and_continues_after_the_pause(ros):
    node, robot, caller = tccm(ros), ros.robot(), Listener(ros).node
    pause = caller.create_client(SetBool, "/tccm/pause")
    robot.play(recording(2.5), node)
    before = dict(node.processor.counts)
    cuboids = len(node.processor.map.cuboids())
    ros.call(pause, SetBool.Request(data=True))
    robot.play(recording(3, start_ns=later(4)), node)
    assert dict(node.processor.counts) == before
    assert len(node.processor.map.cuboids()) == cuboids > 0
    ros.call(pause, SetBool.Request(data=False))
    robot.play(recording(3, start_ns=later(10)), node)
    assert node.processor.counts["cycles"] >= before["cycles"] + 2


def test_reset_forgets_the_map_but_knows_the_robot(ros):
    node, robot, caller = tccm(ros), ros.robot(), Listener(ros).node
    robot.play(recording(3), node)
    assert len(node.processor.map.cuboids()) > 0
    ros.call(caller.create_client(Trigger, "/tccm/reset"), Trigger.Request())
    assert len(node.processor.map.cuboids()) == 0
    cycles, dropped = node.processor.counts["cycles"], node.dropped
    # The description is latched: it does not come again.
    robot.play(recording(3, start_ns=later(20)), node)
    assert node.processor.counts["cycles"] >= cycles + 2
    assert node.dropped == dropped


def test_views_are_taken_when_the_base_stands_still_or_when_asked(ros):
    node, robot, viewer = tccm(ros, views__when="still"), ros.robot(), Listener(ros)
    surfaces = viewer.listen(PointCloud2, "/tccm/surfaces")
    ros.connect(node, viewer.node, "/tccm/surfaces")
    robot.play(recording(3, speed=0.2), node)
    cycles = node.processor.counts["cycles"]
    ros.spin_until(lambda: len(surfaces) == cycles)
    assert [cloud.width for cloud in surfaces] == [0] * cycles
    taken = ros.call(viewer.node.create_client(Trigger, "/tccm/take_view"), Trigger.Request())
    assert taken.success
    wait_until_done(ros, node)
    robot.play(recording(3, start_ns=later(4), speed=0.2), node)
    ros.spin_until(lambda: len(surfaces) == node.processor.counts["cycles"])
    assert sum(cloud.width > 0 for cloud in surfaces) == 1
    robot.play(recording(3, start_ns=later(20)), node)
    ros.spin_until(lambda: len(surfaces) == node.processor.counts["cycles"])
    assert surfaces[-1].width > 0


def test_save_map_writes_the_cuboids(ros, tmp_path):
    node = tccm(ros, save__directory=str(tmp_path / "map"))
    robot, caller = ros.robot(), Listener(ros).node
    robot.play(recording(3), node)
    saved = ros.call(caller.create_client(Trigger, "/tccm/save_map"), Trigger.Request())
    assert saved.success, saved.message
    with np.load(tmp_path / "map" / "cuboids.npz") as archive:
        assert len(archive["ix"]) == len(node.processor.map.cuboids())


def test_autosave_writes_the_map_and_cuts_no_tilt_cycle(ros, tmp_path):
    records = list(recording(4))
    quiet, robot = tccm(ros), ros.robot()
    robot.play(records, quiet)
    ros.remove(quiet)
    node = tccm(ros, save__directory=str(tmp_path / "auto"), save__autosave_minutes=0.005)
    half = next(i for i, (_, r) in enumerate(records) if r.stamp_ns > later(2.5))
    robot.play(records[:half], node)
    cycles = node.processor.counts["cycles"]
    assert cycles >= 1
    (tmp_path / "auto" / "cuboids.npz").unlink(missing_ok=True)
    ros.spin_until((tmp_path / "auto" / "cuboids.npz").exists)
    wait_until_done(ros, node)
    assert node.processor.counts["cycles"] == cycles
    robot.play(records[half:], node)
    assert node.processor.counts == quiet.processor.counts
    assert not node.dropped


def test_saving_to_a_read_only_folder_is_answered_with_an_error(ros, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    node = tccm(ros, save__directory=str(blocked))
    answer = ros.call(
        Listener(ros).node.create_client(Trigger, "/tccm/save_map"), Trigger.Request()
    )
    assert not answer.success
    assert "file" in answer.message
    assert node.worker.backlog == 0


def test_diagnostics_count_messages_and_warn_of_drops(ros):
    node, robot, viewer = tccm(ros), ros.robot(), Listener(ros)
    reports = viewer.listen(DiagnosticArray, "/diagnostics")
    robot.play(recording(3), node)
    # Reports come once a second: some may have come while the robot was still sending.
    expected = {
        "received /tilt_scan": str(robot.sent["tilt_scan"]),
        "cycles": str(node.processor.counts["cycles"]),
    }
    ros.spin_until(lambda: reports and expected.items() <= figures(reports[-1]).items())
    assert reports[-1].status[0].name == "tccm"
    assert float(figures(reports[-1])["longest step [s]"]) > 0.0


def figures(report: DiagnosticArray) -> dict[str, str]:
    return {item.key: item.value for item in report.status[0].values}


@pytest.mark.parametrize("reliability", ["best_effort", "reliable"])
def test_sensor_subscriptions_match_the_offered_qos(ros, reliability):
    node = tccm(ros, qos__reliability=reliability)
    robot = ros.robot(reliable=reliability == "reliable")
    robot.play(recording(0.5), node)
    assert node.inputs.counts()["/tilt_scan"] == robot.sent["tilt_scan"]
