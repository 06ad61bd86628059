"""Recordings of depth cameras and lidars: what is taken, what is in doubt, and what is missing."""

import json
from dataclasses import replace

import numpy as np
import plan
import pytest
from bag_copies import foreign_bag
from depth_room import TOP, camera, write_recording
from sample_bags import SCAN, START, TYPES

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import choose_topics
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.errors import TccmError, TopicError
from tccm_ros.replay.info import bag_info
from tccm_ros.replay.replay import replay
from tccm_ros.ros.writing import scan_message


def mapped(bag, out, *settings, **options):
    summary = replay(bag, out, read_config(None, settings), pictures=False, **options)
    surfaces = json.loads((out / "surfaces.json").read_text())["surfaces"]
    return summary, [s["height"] for s in surfaces if s["label"] != "floor"]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("room") / "bag"
    write_recording(path)
    return path


@pytest.mark.parametrize(
    "settings",
    [(), ("sensors.point_clouds=[]",), ("sensors.depth_images=[]",)],
    ids=["both", "camera", "lidar"],
)
def test_the_table_is_found_at_its_height(bag, tmp_path, settings):
    summary, heights = mapped(bag, tmp_path / "out", *settings)
    assert summary.content.counts.cycles >= 3
    np.testing.assert_allclose(heights, [TOP], atol=0.003)


def test_a_run_is_repeatable_byte_for_byte(bag, tmp_path):
    for name in ("a", "b"):
        mapped(bag, tmp_path / name)
    for file in ("surfaces.json", "surfaces.ply", "cuboids.npz", "planes.json", "result.mcap"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_topics_of_other_names_are_taken_by_their_type(tmp_path):
    path = tmp_path / "bag"
    write_recording(path, images=("/head/depth/image/compressedDepth",), clouds=("/velodyne",))
    summary, heights = mapped(path, tmp_path / "out")
    taken = "\n".join(summary.found_topics)
    assert "/head/depth/image/compressedDepth is taken for depth/image_rect_raw" in taken
    assert "/velodyne is taken for points" in taken
    np.testing.assert_allclose(heights, [TOP], atol=0.003)


def test_doubt_is_an_error_that_names_the_candidates(tmp_path):
    path, images = tmp_path / "bag", ("/left/depth/image", "/right/depth/image")
    write_recording(path, seconds=1.0, images=images, clouds=())
    with BagReader(path) as reader, pytest.raises(TopicError) as error:
        choose_topics(reader, read_config(None))
    for topic in images:
        assert f"--remap depth/image_rect_raw:={topic}" in str(error.value)
    remap = [f"depth/image_rect_raw:={images[1]}"]
    with BagReader(path) as reader:
        choice = choose_topics(reader, read_config(None), remap)
    assert choice.topics["depth/camera_info"] == "/right/depth/camera_info"
    notes = "\n".join(bag_info(path).notes)
    assert f"--remap depth/image_rect_raw:={images[0]}" in notes


def test_a_cloud_that_is_made_of_the_depth_image_is_not_taken(tmp_path):
    path = tmp_path / "bag"
    write_recording(path, seconds=1.0, clouds=("/velodyne",))
    with BagReader(path) as reader:
        choice = choose_topics(reader, read_config(None))
    assert choice.topics["points"] == "/velodyne"  # of another frame: a sensor of its own


def spoiled(image):
    """Spoil every other image: nothing is seen in it."""
    if image.stamp_ns // 100_000_000 % 4 == 1:
        return replace(image, depth=np.zeros_like(image.depth))
    return image


def test_bad_images_are_counted_and_the_rest_is_mapped(tmp_path):
    write_recording(tmp_path / "bag", clouds=(), change=spoiled)
    summary, heights = mapped(tmp_path / "bag", tmp_path / "out")
    assert summary.content.counts.dropped == {"no depths": 10}
    np.testing.assert_allclose(heights, [TOP], atol=0.003)


@pytest.mark.parametrize(
    ("info", "why", "note"),
    [
        (None, "no camera info", "no /depth/camera_info: its images cannot be used"),
        (lambda t: replace(camera(t), width=32), "different sizes", "/depth/camera_info says 32 x"),
        (
            lambda t: replace(camera(t), K=np.zeros((3, 3)), P=np.zeros((3, 4))),
            "no camera info",
            "not calibrated",
        ),
        (lambda t: replace(camera(t), frame_id="else"), "camera info of another frame", ""),
    ],
)
def test_images_without_a_calibration_that_fits_have_a_reason(tmp_path, info, why, note):
    path = tmp_path / "bag"
    write_recording(path, seconds=1.0, clouds=(), info=info)
    remap = ["depth/image_rect_raw:=depth/image_rect_raw"]
    with pytest.raises(TccmError, match=why):
        mapped(path, tmp_path / "out", remap=remap)
    assert note in "\n".join(bag_info(path).notes)


def test_info_names_a_frame_that_the_robot_does_not_have(tmp_path):
    path = tmp_path / "bag"
    write_recording(
        path, seconds=1.0, clouds=(), change=lambda image: replace(image, frame_id="elsewhere")
    )
    assert "elsewhere" in "\n".join(bag_info(path).notes)


def test_a_bare_laser_is_the_base_and_moves_as_matching_says(tmp_path):
    path, types = tmp_path / "bag", TypestoreMessages()
    poses = plan.route([(0, 0), (6, 0), (6, 0.5)], step=0.05)
    run = plan.drive(plan.ring(), poses, beams=361, mount=(0, 0, 0), start_ns=1_700_000_000 * 10**9)
    with BagWriter(path, typestore=types) as writer:
        for posed in run.scans:
            scan = posed.scan
            message = scan_message(types, scan)
            writer.write("/laser/scan", "sensor_msgs/msg/LaserScan", scan.stamp_ns, message)
    notes = bag_info(path).notes
    assert any("/laser/scan without frames and odometry: the laser is the base" in n for n in notes)
    assert not any("assumed not to move" in note for note in notes)
    summary, _ = mapped(path, tmp_path / "out")
    assert any("the laser is the base" in line for line in summary.found_topics)
    assert summary.content.counts.walls >= 3
    found = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    assert len(found) == len(run.scans)
    # 1 cm of range noise; the corridor has a niche and two corners in sight.
    assert np.hypot(*(found[:, 1:3] - run.truth[:, :2]).T).max() < 0.05


def test_unreadable_topic_of_a_role_is_reported_and_others_are_tried(tmp_path):
    cloud = "sensor_msgs/msg/PointCloud2"
    foreign_bag(tmp_path / "bag" / "a.mcap", [
        ("/scan", cloud, START, TYPES.make(cloud)),
        ("/base_scan", SCAN, START, TYPES.make(SCAN)),
        ("/odom", "geometry_msgs/msg/PoseStamped", START, b""),
    ])  # fmt: skip
    foreign = [("/imu", "sensor_msgs/msg/Imu", START, b"{}")]
    foreign_bag(tmp_path / "bag" / "b.mcap", foreign, encoding="json")
    with BagReader(tmp_path / "bag") as reader:
        choice = choose_topics(reader, Config())
    assert choice.topics["scan"] == "/base_scan"
    assert choice.counts["scan"] == 1
    assert choice.counts["odom"] == choice.counts["imu"] == 0
    assert choice.unread == {
        "/odom is geometry_msgs/msg/PoseStamped, expected nav_msgs/msg/Odometry": 1,
        "/imu is serialised as 'json', expected cdr": 1,
    }


def test_a_laser_on_the_configured_rig_is_the_tilting_one(tmp_path):
    foreign_bag(tmp_path / "a.mcap", [("/laser", SCAN, START, TYPES.make(SCAN))])
    pose = "rig.tilt_laser=[0.0, 0.0, 1.2, 0.0, 0.0, 0.0]"
    rig = read_config(None, (pose, "frames.tilt_joint=tilt"))
    with BagReader(tmp_path / "a.mcap") as reader:
        assert choose_topics(reader, Config()).counts["scan"] == 1
        assert choose_topics(reader, rig).counts["tilt_scan"] == 1
        named = choose_topics(reader, rig, ["scan:=/laser"])
    assert (named.counts["scan"], named.counts["tilt_scan"]) == (1, 0)


def test_a_topic_that_is_named_as_it_is_by_default_is_not_replaced(tmp_path):
    foreign_bag(tmp_path / "a.mcap", [("/laser", SCAN, START, TYPES.make(SCAN))])
    with BagReader(tmp_path / "a.mcap") as reader:
        assert choose_topics(reader, Config()).topics["scan"] == "/laser"
        assert choose_topics(reader, Config(), ["scan:=/scan"]).topics["scan"] == "/scan"
