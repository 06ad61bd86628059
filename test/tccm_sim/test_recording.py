"""Bags of simulated worlds, read by another library."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from shapely import MultiPoint, Point, Polygon

from tccm_ros.errors import ConfigError, OutputError
from tccm_ros.records import Scan
from tccm_sim.options import Options, options_from_settings
from tccm_sim.recording import run, simulate
from tccm_sim.worlds import WORLDS, build_world

SHORT = Options(duration=1.0, tilt_beams=61)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return simulate("situation_a", tmp_path_factory.mktemp("bags") / "a", seed=5, options=SHORT)


def messages(path):
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([path], default_typestore=store) as reader:
        for connection, stamp, raw in reader.messages():
            yield connection.topic, stamp, reader.deserialize(raw, connection.msgtype)


def digest(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir())}


def test_the_same_seed_gives_the_same_bytes(bag, tmp_path):
    (tmp_path / "again").mkdir()
    again = simulate("situation_a", tmp_path / "again" / "a", seed=5, options=SHORT)
    assert digest(bag) == digest(again)
    other = simulate("situation_a", tmp_path / "a", seed=6, options=SHORT)
    assert digest(bag)["a.mcap"] != digest(other)["a.mcap"]
    assert digest(bag)["truth.json"] == digest(other)["truth.json"]


def test_the_bag_holds_the_records_that_the_simulation_yields(bag):
    """What `run` yields is what is in the bag."""
    scans = [
        (m.topic, m.log_ns, m.records[0])
        for m in run("situation_a", seed=5, options=SHORT)
        if isinstance(m.records[0], Scan)
    ]
    stored = [m for m in messages(bag) if m[0] in ("/scan", "/tilt_scan")]
    assert len(scans) == len(stored)
    for (topic, log_ns, scan), (name, stamp, message) in zip(scans, stored):
        assert (topic, log_ns) == (name, stamp)
        header = message.header.stamp
        assert header.sec * 10**9 + header.nanosec == scan.stamp_ns
        assert message.header.frame_id == scan.frame_id
        assert message.ranges.tobytes() == scan.ranges.tobytes()
        assert message.angle_max == pytest.approx(scan.angle_min + 240 * np.pi / 180, abs=1e-6) or (
            name == "/scan"
        )
        assert message.scan_time > 0


def test_the_orientation_of_the_odometry_is_that_of_the_robot(tmp_path):
    """The odometry's orientation, by hand: the gantry's odometry starts at a yaw of 0.7 rad."""
    path = simulate("upside_down", tmp_path / "u", options=Options(tilt_beams=31))
    odom = next(m for topic, _, m in messages(path) if topic == "/wheel_odom")
    q = odom.pose.pose.orientation
    assert (q.x, q.y) == (0.0, 0.0)
    assert (q.z, q.w) == pytest.approx((np.sin(0.35), np.cos(0.35)))
    fixed = next(m for topic, _, m in messages(path) if topic == "/tf_static")
    mount = next(t for t in fixed.transforms if t.child_frame_id == "nod_lidar")
    assert abs(mount.transform.rotation.x) == pytest.approx(1.0)


def test_scans_are_offered_as_sensor_data_and_descriptions_are_latched(bag):
    info = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    topics = {
        t["topic_metadata"]["name"]: t["topic_metadata"]["offered_qos_profiles"][0]
        for t in info["topics_with_message_count"]
    }
    assert topics["/tilt_scan"]["reliability"] == "best_effort"
    assert topics["/robot_description"]["durability"] == "transient_local"
    assert topics["/odom"]["reliability"] == "reliable"


def test_the_ground_truth_is_in_the_folder_of_the_bag(bag):
    truth = json.loads((bag / "truth.json").read_text())
    assert truth["format"] == "tccm_ros/surfaces"
    assert [row["label"] for row in truth["surfaces"]] == ["table"]
    assert len((bag / "truth.tum").read_text().splitlines()) == 50
    assert len(json.loads((bag / "truth_walls.json").read_text())["walls"]) == 4


def test_an_existing_bag_is_not_overwritten_by_default(bag):
    with pytest.raises(OutputError, match="exists already"):
        simulate("situation_a", bag)


def test_progress_ends_at_one(tmp_path):
    fractions = []
    simulate("situation_a", tmp_path / "a", options=SHORT, progress=fractions.append)
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0, abs=0.05)


def test_unknown_worlds_and_options_are_errors():
    with pytest.raises(ConfigError, match="did you mean 'flat'"):
        build_world("flatt")
    with pytest.raises(ConfigError, match="did you mean 'sigma'"):
        options_from_settings({"sigmaa": "1"})
    with pytest.raises(ConfigError, match="simulator option laps"):
        options_from_settings({"laps": "0"})


def test_options_are_parsed_to_their_types():
    options = options_from_settings(
        {"sigma": "0.004", "laps": "3", "people": "false", "translation": "0.1,0,-0.2"}
    )
    assert options.sigma == 0.004
    assert options.laps == 3
    assert options.people is False
    assert options.translation == (0.1, 0.0, -0.2)


@pytest.mark.parametrize("name", sorted(WORLDS.keys() - {"rgbd_kitchen"}))
def test_the_first_tilting_scan_of_each_world_has_returns(name):
    """The first tilting scan of each world sees something."""
    options = Options(tilt_beams=41)
    world = build_world(name, options)
    topic = world.rig.topics.tilt_scan
    scan = next(m.records[0] for m in run(name, options=options) if m.topic == topic)
    assert np.isfinite(scan.ranges).mean() > 0.5
    assert world.duration > 10.0


def outline(solid):
    """Return the outline of a solid with a vertical axis, seen from above."""
    x, y, _ = solid.half
    T = solid.T_world_solid
    if solid.shape == "cylinder":
        return Point(T[:2, 3]).buffer(x)
    corners = np.array([(-x, -y), (x, -y), (x, y), (-x, y)])
    return Polygon(corners @ T[:2, :2].T + T[:2, 3])


def test_driving_robots_keep_a_distance_from_furniture():
    """No driving base comes nearer than 0.25 m to anything between 5 cm and 1.4 m of height."""
    for name in ("flat", "ring", "room", "moved", "load", "upside_down"):
        world = build_world(name)
        points = MultiPoint(world.drive.states[::20, :2])
        for solid in world.scene.solids:
            low = solid.T_world_solid[2, 3] - solid.half_extent[2]
            if solid.role in ("floor", "ceiling", "person") or low > 1.4 or not solid.is_still:
                continue
            assert points.distance(outline(solid)) > 0.25, (name, solid.name)


def test_more_laps_make_a_longer_recording():
    once, twice = (build_world("ring", Options(laps=n)).duration for n in (1, 2))
    assert twice > 1.6 * once
