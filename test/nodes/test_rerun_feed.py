"""Measurements of running nodes in a Rerun server, over DDS."""

from itertools import islice

import depth_room
import numpy as np
import pytest
from depth_room import MS, START_NS, URDF
from live_robot import TABLE as TABLE_TOP_M
from live_robot import WALL, overrides, recording, slam, tccm

from tccm_ros.geometry import inverse
from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.qos import latched_qos
from tccm_ros.records import JointSample, Odometry, RobotDescription, TransformSample
from tccm_ros.ros.pointcloud import MAP_ROW
from tccm_ros.ros.writing import transform_message
from tccm_sim.sensor_messages import (
    camera_info_message,
    depth_image_message,
    joint_sample_message,
    odometry_message,
    point_cloud_message,
    robot_description_message,
)

pytest.importorskip("aiohttp", reason="aiohttp (the extra 'view') is missing")
pytest.importorskip("datafusion", reason="rerun's dataframes need rerun-sdk[catalog]")
pytestmark = [
    pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed"),
    pytest.mark.filterwarnings("ignore:RRD file has no footer"),
]

from rerun_server import (  # noqa: E402
    RerunServer,
    depth_points,
    free_port,
    in_map,
    rows,
    transforms,
    views,
)

from tccm_ros.nodes import rerun_feed  # noqa: E402
from tccm_ros.view import rerun_stream  # noqa: E402

IMAGE, CLOUD = "depth/image_rect_raw", "points"
MAX_BOXES = 20_000  # of a part
MIN_CELL_SIZE_M = 0.05  # m, edge of the smallest boxes


@pytest.fixture
def written(monkeypatch):
    """The roles and stamps of the records that were sent to the viewer."""
    found, write = set(), rerun_stream._log_record

    def note(log, event):
        write(log, event)
        found.add((event.role, event.stamp_ns))

    monkeypatch.setattr(rerun_stream, "_log_record", note)
    return found


@pytest.fixture
def server(tmp_path):
    made = RerunServer(free_port(), tmp_path / "live.rrd")
    yield made
    made.close()


def show(ros, server):
    """Return a view node that feeds a server."""
    from tccm_ros.nodes.view_node import ViewNode

    values = {"view.port": 0, "view.rerun": f"rerun+http://127.0.0.1:{server.port}/proxy"}
    return ros.add(ViewNode(context=ros.another_context(), parameter_overrides=overrides(values)))


@pytest.mark.parametrize("start_m", [0.0, 50_000.0])
def test_images_with_their_camera_and_clouds_are_on_the_table(ros, server, written, start_m):
    """Also where odometry starts far from its origin."""
    view, robot = show(ros, server), ros.robot(described=False)
    T_odom_start = np.eye(4)
    T_odom_start[0, 3] = start_m
    described = robot_description_message(robot.types, RobotDescription(URDF))
    latched_topic = robot.node.create_publisher(type(described), "robot_description", latched_qos())
    latched_topic.publish(described)
    ros.connect(robot.node, view, "/robot_description")

    def send(topic, build, record):
        robot.publish(topic, build(robot.types, record), view)

    for ms in range(0, 1800, 20):
        now = START_NS + ms * MS
        T_odom_base = T_odom_start @ depth_room.base_at(ms)
        send("odom", odometry_message, Odometry(now, "odom", "base", T_odom_base))
        pan = np.array([depth_room.pan_at(ms)])
        send("joint_states", joint_sample_message, JointSample(now, ("pan",), pan))
        if ms % 200 == 0:
            send(CLOUD, point_cloud_message, depth_room.cloud_at(ms))
        if ms % 200 == 100:
            send("depth/camera_info", camera_info_message, depth_room.camera(now))
            send(IMAGE, depth_image_message, depth_room.image_at(ms))
        if ms % 200 == 180 and ms > 200:
            # A record may wait for the next one of its sensor.
            sent = {(CLOUD, now - 380 * MS), (IMAGE, now - 280 * MS)}
            ros.spin_until(lambda sent=sent: sent <= written, what=f"{sent} in {written}")
        if ms % 200 == 180:
            sample = TransformSample(now, "map", "odom", inverse(T_odom_start), False)
            send("surface_slam/map_to_odom", transform_message, sample)
    view.close()
    server.close()
    store = server.store()
    known_s = transforms(store, "/map/odom")[0][0]
    assert known_s == pytest.approx((START_NS + 180 * MS) * 1e-9, abs=1e-3)
    stamps, images = depth_points(store, f"/map/odom/base/{IMAGE}")
    expected = START_NS * 1e-9 + np.arange(0.1, 1.8, 0.2)
    assert set(np.round(stamps, 3)) <= set(np.round(expected, 3))
    assert len(stamps) >= 7
    for stamp, seen in zip(stamps, images):
        if stamp > known_s:
            points = in_map(store, f"/map/odom/base/{IMAGE}", stamp, seen)
            depth_room.assert_on_table_or_floor(points)
    stamps, clouds = rows(store, f"/map/odom/base/{CLOUD}", "Points3D:positions")
    assert len(stamps) >= 7
    for stamp, seen in zip(stamps, clouds):
        if stamp > known_s:
            points = in_map(store, f"/map/odom/base/{CLOUD}", stamp, np.array(seen))
            assert (np.abs(points[:, 2] - depth_room.TOP) < 0.01).any()
    layout = {"Map", "Newest tilt cycle", "Events"}
    assert sorted(views(server.file), key=len) == [layout, layout | {IMAGE}]


def test_scans_planes_and_part_maps_are_in_the_room(ros, server, written):
    tilt_node, node, view = tccm(ros), slam(ros), show(ros, server)
    robot = ros.robot()
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.connect(tilt_node, view, "/tccm/planes", "/tccm/map_cloud")
    ros.connect(node, view, "/surface_slam/map_to_odom", "/surface_slam/surface_map", "/pose")
    for topic, record in islice(recording(1), 8):
        robot.publisher(topic, robot.message(record))
    for topic in ("robot_description", "odom", "joint_states", "tilt_scan", "scan"):
        ros.connect(robot.node, view, f"/{topic}")
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: {"scan", "tilt_scan"} <= {role for role, _ in written})
    view.close()
    server.close()
    store = server.store()
    stamps, scans = rows(store, "/map/odom/scan", "Points3D:positions")
    assert {("scan", round(s * 1e9 / 1e6) * 1_000_000) for s in stamps} <= written
    for scan in scans:  # the room is the square of the four walls, and the robot stands in it
        assert np.abs(np.array(scan)[:, :2]).max(axis=1) == pytest.approx(WALL, abs=0.01)
    _, tilted = rows(store, "/map/odom/tilt_scan", "Points3D:positions")
    assert all(np.abs(np.array(scan)).max() < WALL + 0.01 for scan in tilted)
    _, poses = transforms(store, "/map/odom")
    np.testing.assert_allclose(poses, np.broadcast_to(np.eye(4), poses.shape), atol=0.02)
    stamps, outlines = rows(store, "/map/odom/planes", "LineStrips3D:strips")
    heights = [np.mean(np.array(line)[:, 2]) for line in outlines[-1]]
    assert any(abs(height - TABLE_TOP_M) < 0.01 for height in heights), heights
    same, boxes = rows(store, "/map/odom/part_map", "Boxes3D:centers")
    assert same[-1] == pytest.approx(stamps[-1], abs=1e-6)
    centers = np.array(boxes[-1])
    assert len(centers) > 100
    assert np.abs(centers[:, :2]).max() < WALL + MIN_CELL_SIZE_M
    assert (np.abs(centers[:, 2] - TABLE_TOP_M) < 0.03).any()


def cuboids(count, cycle, top=0.7):
    """Return rows of ~/map_cloud along x, 2 cm from one to the next."""
    made = np.zeros(count, MAP_ROW)
    made["x"] = 0.01 + 0.02 * np.arange(count)
    made["z"], made["depth"], made["cycle"] = top, 0.03, cycle
    return made


def test_the_newest_part_has_the_cuboids_of_the_newest_cycle_alone():
    both = np.concatenate([cuboids(10, 4), cuboids(5, 5, top=0.405)])
    table, cell_size = rerun_feed.newest_part(both, np.eye(4))
    assert cell_size == MIN_CELL_SIZE_M
    assert table.tolist() == [[0, 1], [0, 0], [37, 37], [41, 41]]


def test_an_empty_map_has_an_empty_part():
    table, _ = rerun_feed.newest_part(cuboids(0, 0), np.eye(4))
    assert table.shape == (4, 0)


def test_cells_grow_until_a_part_is_small():
    rows = cuboids(6 * MAX_BOXES, 1)
    table, cell_size = rerun_feed.newest_part(rows, np.eye(4))
    assert MAX_BOXES / 2 < table.shape[1] <= MAX_BOXES
    length = table.shape[1] * cell_size
    assert length == pytest.approx(0.02 * len(rows), abs=cell_size)
