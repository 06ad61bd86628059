"""Recordings that lack something: info and replay agree, and an empty map has a reason."""

import numpy as np
from bag_copies import foreign_bag
from depth_room import START_NS, camera, image_at
from sample_bags import SCAN, TYPES

from tccm_ros.config.reader import read_config
from tccm_ros.records import PointCloud, Scan
from tccm_ros.replay.info import bag_info
from tccm_ros.replay.replay import replay
from tccm_ros.ros.writing import scan_message
from tccm_sim.sensor_messages import camera_info_message, depth_image_message, point_cloud_message

CLOUD, STEP_NS = "sensor_msgs/msg/PointCloud2", 200_000_000
ROOM, FLOOR, TOP, SPEED = (3.0, 2.0), -1.1, -0.4, 0.1
"""Half extents of the room, floor and table top below the lidar, m; m/s along x."""


def cloud_at(k):
    """Return what a level lidar sees in a room with a table along one wall."""
    e, a = np.meshgrid(np.radians(np.arange(-60, 21, 2.5)), np.radians(np.arange(0, 360, 1.0)))
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1).reshape(-1, 3)
    x = SPEED * k * STEP_NS * 1e-9
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = [(np.copysign(half, rays[:, i]) - at) / rays[:, i]
                 for i, half, at in ((0, ROOM[0], x), (1, ROOM[1], 0.0))]  # fmt: skip
        heights = [np.where(rays[:, 2] < 0, z / rays[:, 2], np.inf) for z in (FLOOR, TOP)]
    ranges = np.min([*walls, heights[0]], axis=0)
    top = rays * np.nan_to_num(heights[1], posinf=0.0)[:, None] + [x, 0, 0]
    on_top = (np.abs(top[:, 0]) < 0.8) & (top[:, 1] > 1.0) & (top[:, 1] < ROOM[1])
    ranges = np.where(on_top & (heights[1] < ranges), heights[1], ranges)
    points = (rays * ranges[:, None]).astype(np.float32)
    return PointCloud(START_NS + k * STEP_NS, "lidar", points, np.zeros(len(points), np.int64))


def write_clouds(path, count=20):
    clouds = [cloud_at(k) for k in range(count)]
    return foreign_bag(path / "bag.mcap", [
        ("/lidar_points", CLOUD, cloud.stamp_ns, point_cloud_message(TYPES, cloud))
        for cloud in clouds
    ])  # fmt: skip


def test_a_bare_cloud_is_mapped_as_info_says_and_moves_as_matching_says(tmp_path):
    bag = write_clouds(tmp_path)
    line = (
        "/lidar_points without frames and odometry: the sensor is the base, and moves as matching "
        "of level scans of it says"
    )
    info = bag_info(bag)
    assert line in info.notes
    assert info.notes[-1] == f"try tccm replay {bag} --out map --remap points:=/lidar_points"
    summary = replay(bag, tmp_path / "map", read_config(None), pictures=False)
    assert line in summary.found_topics
    assert summary.content.counts.surfaces >= 1
    path = np.loadtxt(tmp_path / "map" / "trajectory.tum")
    expected = SPEED * (path[:, 0] - path[0, 0])
    np.testing.assert_allclose(path[:, 1] - path[0, 1], expected, atol=0.03)


def test_info_names_every_doubt_and_a_line_that_is_accepted(tmp_path):
    scans = [Scan(START_NS + k, f"laser_{k}", -1.0, 0.1, 0.0, 0.1, 9.0, np.full(21, 2, np.float32))
             for k in range(2)]  # fmt: skip
    rows = [(f"/scan_{k}", SCAN, s.stamp_ns, scan_message(TYPES, s)) for k, s in enumerate(scans)]
    image, info = depth_image_message(TYPES, image_at(0)), camera_info_message
    rows += [
        ("/head/depth/image", "sensor_msgs/msg/Image", START_NS, image),
        ("/head/depth/camera_info", "sensor_msgs/msg/CameraInfo", START_NS,
         info(TYPES, camera(START_NS))),
    ]  # fmt: skip
    bag = foreign_bag(tmp_path / "bag.mcap", rows)
    notes = bag_info(bag).notes
    doubt = "no topic /scan, and several could be meant; use --remap scan:=/scan_0 or "
    assert any(note.startswith(doubt) for note in notes)
    assert any(note.startswith("/head/depth/image is taken for") for note in notes)
    assert notes[-1] == (
        f"try tccm replay {bag} --out map --remap scan:=/scan_0 "
        "--remap depth/image_rect_raw:=/head/depth/image"
    )


def test_an_empty_map_ends_with_its_reason(tmp_path):
    """Few of 40 beams measure a range: too few for a line."""
    ranges = np.full(40, np.inf, np.float32)
    ranges[::13] = [2.0, 5.0, 3.0, 7.0]
    rows = [
        Scan(START_NS + k * STEP_NS, "laser", -1.0, 0.05, 0.0, 0.1, 9.0, ranges) for k in range(9)
    ]
    bag = foreign_bag(tmp_path / "bag.mcap", [
        ("/scan", SCAN, scan.stamp_ns, scan_message(TYPES, scan)) for scan in rows
    ])  # fmt: skip
    summary = replay(bag, tmp_path / "map", read_config(None, []), pictures=False)
    assert summary.text().splitlines()[-2:] == [
        "no surfaces: there is no tilting laser, no depth image and no point cloud",
        "no walls: 9 level scans have no straight line of 0.5 m",
    ]
