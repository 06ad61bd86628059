"""Recordings as drivers and users write them: the table of the small room is found in each."""

import json
from pathlib import Path

import edited_bag as eb
import numpy as np
import pytest
from depth_room import TOP, write_recording

from tccm_ros.config.reader import read_config
from tccm_ros.errors import TccmError
from tccm_ros.replay.info import bag_info
from tccm_ros.replay.replay import replay

BUNDLED = Path(__file__).resolve().parents[2] / "bags"

SECONDS, IMAGES = 2.0, 10
"""Length of the recording, and its number of images and of clouds."""

RECORDINGS = {
    "depths in m with nan": eb.of_camera(eb.in_metres),
    "big-endian, lines with padding": eb.of_camera(eb.big_endian_with_padding),
    "encoding mono16": eb.of_camera(eb.called_mono16),
    "16-bit PNG that is called PNG alone": eb.of_camera(eb.as_png),
    "compressedDepth, quantised": eb.of_camera(eb.quantised),
    "rectified, K and D of the raw image": eb.rectified,
    "calibration on a topic elsewhere": eb.info_elsewhere,
    "calibration once, without a stamp": eb.info_once(),
    "/tf at 10 Hz and /tf_static alone": eb.tf_alone,
    "organised cloud with nan": eb.organised_alone,
    "ouster": eb.OUSTER,
    "velodyne": eb.VELODYNE,
    "hesai": eb.HESAI,
    "livox": eb.LIVOX,
}

UNUSUAL = {
    "a lidar with a clock of its own": (eb.ANOTHER_CLOCK, "times of points are ignored: more than"),
    "times of points that are garbage": (eb.GARBAGE, "times of points are ignored: they are far"),
    "a false is_bigendian of clouds": (eb.falsely_big_endian, "is_bigendian contradicts"),
    "a false is_bigendian of images": (
        eb.of_camera(eb.falsely_called_big_endian), "is_bigendian contradicts",
    ),
}  # fmt: skip
"""Edits, and what is said."""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("room") / "bag"
    write_recording(path, seconds=SECONDS)
    return path


def mapped(bag, out):
    summary = replay(bag, out, read_config(None), pictures=False)
    surfaces = json.loads((out / "surfaces.json").read_text())["surfaces"]
    return summary.content.counts, [s["height"] for s in surfaces if s["label"] != "floor"]


@pytest.mark.parametrize("name", RECORDINGS)
def test_the_table_is_found_in_recordings_of_others(source, tmp_path, name):
    bag = eb.edited(source, tmp_path / "bag", RECORDINGS[name])
    counts, heights = mapped(bag, tmp_path / "out")
    np.testing.assert_allclose(heights, [TOP], atol=0.003)
    # The last clouds end after the last odometry.
    assert set(counts.dropped) <= {"no odometry"}
    assert sum(counts.dropped.values()) <= 1


@pytest.mark.parametrize("name", UNUSUAL)
def test_table_is_found_despite_contradictory_messages_that_are_reported(source, tmp_path, name):
    edit, said = UNUSUAL[name]
    bag = eb.edited(source, tmp_path / "bag", edit)
    summary = replay(bag, tmp_path / "out", read_config(None), pictures=False)
    surfaces = json.loads((tmp_path / "out" / "surfaces.json").read_text())["surfaces"]
    heights = [s["height"] for s in surfaces if s["label"] != "floor"]
    np.testing.assert_allclose(heights, [TOP], atol=0.003)
    assert said in summary.text()


def test_depths_in_tenths_of_millimetres_are_named(source, tmp_path):
    def finer(topic, message):
        finest = np.minimum(10 * eb.depths_mm(message).astype(int), 65535).astype("<u2")
        return [(topic, eb.IMAGE, eb.image_of(message, finest.tobytes()))]

    bag = eb.edited(source, tmp_path / "bag", eb.of_camera(finer))
    summary = replay(bag, tmp_path / "out", read_config(None), pictures=False)
    said = "nearly all depths are beyond what is mapped"
    assert said in summary.text()
    assert said in "\n".join(bag_info(bag).notes)


def test_depths_of_the_largest_number_alone_are_named(source, tmp_path):
    def largest(topic, message):
        return [(topic, eb.IMAGE, eb.image_of(message, b"\xff" * len(message.data)))]

    bag = eb.edited(source, tmp_path / "bag", eb.of_camera(largest))
    with pytest.raises(TccmError, match=r"depths beyond scan\.max_range: 16UC1 is mm"):
        replay(bag, tmp_path / "out", read_config(None), pictures=False)


def test_late_descriptions_and_static_transforms_hold_from_the_start(session_files, tmp_path):
    """All tilt cycles are as in the recording in which they come first."""
    latched = {"/robot_description", "/tf_static"}
    bag = eb.late(BUNDLED / "upside_down", tmp_path / "bag", latched, 7 * 10**9)
    late, early = tmp_path / "late", session_files.replayed("upside_down")
    replay(bag, late, read_config(None), pictures=False)
    counts = [json.loads((out / "summary.json").read_text())["counts"] for out in (late, early)]
    assert counts[0] == counts[1]
    for name in ("surfaces.json", "walls.json", "trajectory.tum"):
        assert (late / name).read_bytes() == (early / name).read_bytes()


def test_late_static_transforms_on_tf_are_used_from_then_on_and_reported(tmp_path):
    kinds = {"nav_msgs/msg/Odometry": "/odom", eb.TF: "/tf"}

    def level_alone(topic, msgtype, message):
        is_level = topic == "/front_lidar/scan"
        return (
            [(kinds.get(msgtype, topic), msgtype, message)] if msgtype in kinds or is_level else []
        )

    source = eb.edited(BUNDLED / "upside_down", tmp_path / "source", level_alone)
    bag = eb.late(source, tmp_path / "bag", {"/tf"}, 9 * 10**9)
    assert "(by the first 5 s of /tf)" in "\n".join(bag_info(bag).notes)
    assert "(by the first 5 s of /tf)" not in "\n".join(bag_info(source).notes)
    summary = replay(bag, tmp_path / "out", read_config(None), pictures=False)
    assert "no way from base to sensor" in summary.text()
    assert summary.content.counts.walls > 0


def test_delay_of_the_tilt_joint_is_reported_and_corrected(session_files, tmp_path):
    def delayed(topic, msgtype, message):
        if msgtype == "sensor_msgs/msg/JointState":
            eb.set_stamp(message, eb.stamp_of(message) + 300_000_000)
        return [(topic, msgtype, message)]

    bag = eb.edited(BUNDLED / "upside_down", tmp_path / "bag", delayed)
    said = "rig.joint_time_offset=-0.30 makes tilting up and down agree"
    assert said in "\n".join(bag_info(bag).notes)
    summary = replay(bag, tmp_path / "out", read_config(None), pictures=False)
    assert said in summary.text()
    assert summary.content.config["rig"]["joint_time_offset"] == pytest.approx(-0.3, abs=0.005)
    assert "joint_time_offset" not in session_files.said("upside_down")
    plain = json.loads((session_files.replayed("upside_down") / "summary.json").read_text())
    assert summary.content.counts.surfaces == plain["counts"]["surfaces"]
    mine = replay(bag, tmp_path / "mine", read_config(None, ["rig.joint_time_offset=-0.3"]),
                  pictures=False)  # fmt: skip
    assert "joint_time_offset" not in mine.text()


def test_a_rectified_image_has_not_the_intrinsics_of_the_raw_one(source, tmp_path):
    """The same numbers as those of a raw image put the table elsewhere."""

    def raw(topic, msgtype, message):
        edits = eb.rectified(topic, msgtype, message)
        return [(t.replace("image_rect", "image_raw"), kind, m) for t, kind, m in edits]

    _, heights = mapped(eb.edited(source, tmp_path / "bag", raw), tmp_path / "out")
    assert not np.allclose(heights, TOP, atol=0.01)


@pytest.mark.parametrize(
    ("msgtype", "spoil", "why"),
    [
        (eb.CLOUD, eb.without_x, "point cloud has no field 'x'"),
        (eb.CLOUD, eb.wrong_step, "point cloud has points of 7 bytes"),
        (eb.CLOUD, eb.too_many, "point cloud has 100000000 points"),
        (eb.IMAGE, eb.wrong_size, "depth image of 160 x 240 pixels has"),
        (eb.INFO, eb.zero_focal, "camera info has focal lengths of 0 and 0 pixels"),
    ],
)
def test_messages_that_no_one_can_use_are_counted_and_the_rest_is_mapped(
    source, tmp_path, msgtype, spoil, why
):
    bag = eb.edited(source, tmp_path / "bag", eb.every_other(msgtype, spoil))
    counts, heights = mapped(bag, tmp_path / "out")
    np.testing.assert_allclose(heights, [TOP], atol=0.003)
    ((reason, count),) = counts.dropped.items()
    assert why in reason
    assert count == IMAGES // 2


def test_a_lens_of_an_unknown_model_is_refused_and_named(source, tmp_path):
    def fisheye(topic, msgtype, message):
        if msgtype == eb.INFO:
            message.distortion_model, message.d = "equidistant", np.array([0.1, 0, 0, 0])
        return [] if msgtype == eb.CLOUD else [(topic, msgtype, message)]

    bag = eb.edited(source, tmp_path / "bag", fisheye)
    with pytest.raises(TccmError, match=f"{IMAGES} unknown distortion model"):
        mapped(bag, tmp_path / "out")
    assert "distortion model 'equidistant' is not known" in "\n".join(bag_info(bag).notes)


def test_info_names_faults_of_a_description(source, tmp_path):
    def describe(change):
        def edit(topic, msgtype, message):
            if topic == "/robot_description":
                message.data = change(message.data)
            return [(topic, msgtype, message)]

        return edit

    faults = (
        '<link name="thumb"><collision><geometry><box size="1 -1 1"/></geometry></collision></link>'
        '<joint name="bend" type="revolute"><parent link="base"/><child link="thumb"/>'
        '<axis xyz="0 0 0"/></joint></robot>'
    )
    bag = eb.edited(source, tmp_path / "thumb", describe(lambda t: t.replace("</robot>", faults)))
    notes = "\n".join(bag_info(bag).notes)
    assert "/robot_description: joint 'bend' has an axis of zero length" in notes
    assert "/robot_description: collision of link 'thumb': a negative size" in notes
    bag = eb.edited(source, tmp_path / "cut", describe(lambda text: text[:-20]))
    assert "/robot_description: robot description" in "\n".join(bag_info(bag).notes)
    assert "robot_description" not in "\n".join(bag_info(source).notes)


def test_info_names_topics_that_cannot_be_read_and_why(source, tmp_path):
    bag = eb.edited(source, tmp_path / "clock", eb.ANOTHER_CLOCK)
    assert "/gps: times of points are ignored" in "\n".join(bag_info(bag).notes)

    def jpeg(topic, message):
        packed = eb.quantised(topic, message)[0][2]
        packed.format = "16UC1; jpeg compressed"
        colour = eb.TYPESTORE.make(eb.PACKED, header=message.header, format="rgb8; jpeg")
        return [("/depth/compressed", eb.PACKED, packed), ("/rgb/compressed", eb.PACKED, colour)]

    notes = "\n".join(bag_info(eb.edited(source, tmp_path / "png", eb.of_camera(jpeg))).notes)
    assert "/depth/compressed: compressed image has format '16UC1; jpeg compressed'" in notes
    assert "/rgb" not in notes

    def grey(topic, message):
        data = bytes(message.width * message.height)
        image = eb.image_of(message, data, encoding="mono8", step=message.width)
        return [(topic, eb.IMAGE, image)]

    notes = "\n".join(bag_info(eb.edited(source, tmp_path / "grey", eb.of_camera(grey))).notes)
    assert "/depth/image_rect_raw: image has encoding 'mono8'" in notes

    def signed(topic, message):
        image = eb.image_of(message, bytes(message.data), encoding="16SC1")
        return [("/elsewhere/depth", eb.IMAGE, image)]

    notes = "\n".join(bag_info(eb.edited(source, tmp_path / "signed", eb.of_camera(signed))).notes)
    assert "/elsewhere/depth: image has encoding '16SC1'" in notes


def test_inverted_tilt_joint_is_named_as_reason_for_an_empty_map(tmp_path):
    """The floor, seen where a ceiling would be, is most of what is horizontal."""

    def negated(topic, msgtype, message):
        if msgtype == "sensor_msgs/msg/JointState":
            message.position = -np.array(message.position)
        return [(topic, msgtype, message)]

    bag = eb.edited(BUNDLED / "upside_down", tmp_path / "bag", negated)
    summary = replay(bag, tmp_path / "out", read_config(None), pictures=False)
    assert "mostly above the sensor: ceilings, or a tilt joint of the wrong sign?" in summary.text()


def in_microseconds(topic, msgtype, message):
    """Edit the joints' stamps: the joint turns and rests, but never at the time of a scan."""
    if msgtype == "sensor_msgs/msg/JointState":
        eb.set_stamp(message, eb.stamp_of(message) // 1000)
    return [(topic, msgtype, message)]


def without_names(topic, msgtype, message):
    if msgtype == "sensor_msgs/msg/JointState":
        message.name = []
    return [(topic, msgtype, message)]


def without_rotation(topic, msgtype, message):
    if msgtype == "nav_msgs/msg/Odometry":
        message.pose.pose.orientation.z = message.pose.pose.orientation.w = 0.0
    return [(topic, msgtype, message)]


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (in_microseconds, "tilting laser: no joint samples at a stamp of .* set the clocks"),
        (without_names, "no message on .*joint_states could be used: joint state has 0 names and"),
        (
            without_rotation,
            "601 no odometry; no message on .*odom could be used: .* is no rotation",
        ),
    ],
)
def test_a_tilting_laser_without_a_usable_scan_is_an_error_with_its_cause(tmp_path, edit, why):
    bag = eb.edited(BUNDLED / "upside_down", tmp_path / "bag", edit)
    with pytest.raises(TccmError, match=why):
        replay(bag, tmp_path / "out", read_config(None), pictures=False)
