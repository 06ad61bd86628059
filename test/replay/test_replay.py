"""Replays of the bundled bags give maps with their true surfaces."""

import json
from collections import Counter
from itertools import islice
from pathlib import Path

import jsonschema
import make_schemas as schema
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from shapely import Point, Polygon

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.cli import app
from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.errors import BagError, MapError, TopicError
from tccm_ros.evaluate.surfaces import score_surfaces
from tccm_ros.evaluate.trajectory_errors import absolute_errors, poses_at
from tccm_ros.geometry import planar, spatial
from tccm_ros.replay.replay import replay
from tccm_ros.results.result_bag import EVENTS_TOPIC
from tccm_ros.results.trajectory import read_tum
from tccm_ros.scene.changes import ChangeKind

BAGS = Path(__file__).resolve().parents[2] / "bags"
TYPES = TypestoreMessages()
CLOCKED = {"timing.json", "report.html"}
"""What may differ between runs: times are measured on the clock."""


@pytest.fixture(scope="module")
def flat(session_files):
    return session_files.replayed("flat")


def test_the_map_of_the_flat_has_its_furniture(flat):
    score = score_surfaces(flat / "surfaces.json", BAGS / "flat" / "truth.json")
    assert len(score.matches) == 20
    assert score.found >= 18, score.text()
    assert score.false == ()


def fits_its_schemas(folder):
    """Return whether every JSON file of a folder is valid by docs/reference/schema."""
    for name in {path.name for path in folder.iterdir()} & set(schema.FILES):
        jsonschema.validate(json.loads((folder / name).read_text()), schema.file_schema(name))
    return True


def test_the_results_of_the_flat_fit_their_schemas(flat):
    assert fits_its_schemas(flat)


def test_the_corners_of_the_floor_plan_are_closed(flat):
    walls = json.loads((flat / "walls.json").read_text())["walls"]
    features = json.loads((flat / "surfaces.geojson").read_text())["features"]
    lines = {
        f["properties"]["id"]: {tuple(end) for end in f["geometry"]["coordinates"]}
        for f in features
        if f["properties"]["kind"] == "wall"
    }
    corners = {(min(w["id"], k), max(w["id"], k)) for w in walls for k in w["corners"]}
    assert len(corners) >= 8
    assert all(lines[a] & lines[b] for a, b in corners)


def test_the_planning_scene_holds_all_but_the_floor(flat):
    surfaces = json.loads((flat / "surfaces.json").read_text())["surfaces"]
    text = (flat / "surfaces.scene").read_text()
    names = [line[2:] for line in text.splitlines() if line.startswith("* ")]
    tops = [f"tccm_surface_{s['id']}" for s in surfaces if s["label"] != "floor"]
    objects = json.loads((flat / "objects.json").read_text())["objects"]
    boxes = [f"tccm_object_{entry['id']}" for entry in objects]
    assert boxes
    others = [name for name in names if not name.startswith("tccm_rack_")]
    assert sorted(others) == sorted([*tops, *boxes])
    # Panels of racks: the measured sides, backs and lower sides of their compartments.
    racks = json.loads((flat / "racks.json").read_text())
    boards = {str(c["board"]) for c in racks["compartments"]}
    panels = [name.split("_")[2] for name in names if name.startswith("tccm_rack_")]
    assert panels
    assert set(panels) <= boards


def test_the_trajectory_is_better_than_raw_odometry(flat):
    truth = read_tum(BAGS / "flat" / "truth.tum")
    with BagReader(BAGS / "flat") as bag:
        odometry = [record for role, _, record in bag.records({"odom": "/odom"})]
    stamps = np.array([record.stamp_ns for record in odometry])
    raw = spatial(planar(np.array([record.T_odom_base for record in odometry])))
    found = read_tum(flat / "trajectory.tum")
    ours, known = rms(found.stamps_ns, found.T_map_base, truth)
    theirs, _ = rms(stamps, raw, truth)
    assert known > 1000
    assert ours < 0.02
    assert ours < 0.1 * theirs


def rms(stamps, poses, truth):
    at, is_known = poses_at(truth.stamps_ns, truth.T_map_base, stamps)
    errors = absolute_errors(poses[is_known], at[is_known])
    return float(np.sqrt(np.mean(np.square(errors.translation)))), len(errors)


def test_a_recording_in_two_files_has_the_bytes_of_one_file(tmp_path):
    """So have two runs of one process, with pictures."""
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    replay(BAGS / "walkthrough", whole, Config())
    with BagReader(BAGS / "walkthrough") as reader:
        messages = list(reader.messages())
    halves = {"second.mcap": messages[2000:], "first.mcap": messages[:2000]}
    for name, half in halves.items():
        with BagWriter(tmp_path / name) as writer:
            for message in half:
                writer.write(message.topic, message.msgtype, message.log_ns, message.data)
    files = [str(tmp_path / name) for name in halves]
    app(["replay", *files, "--out", str(parts), "--quiet"], standalone_mode=False)
    assert fits_its_schemas(whole)
    names, others = (sorted(path.name for path in run.iterdir()) for run in (whole, parts))
    assert names == others
    assert {"racks.json", "map.mcap", "report.html", "map.png"} < set(names)
    for name in names:
        one, two = ((run / name).read_bytes() for run in (whole, parts))
        assert one, name
        if name not in CLOCKED:
            assert one == two, name


def test_events_of_the_walkthrough_are_in_result_mcap_where_asked_for(session_files, tmp_path):
    """As its truth says: the stool is carried away, one of the boxes is moved; all else stays."""
    without, with_events = session_files.replayed("walkthrough"), tmp_path / "with"
    replay(BAGS / "walkthrough", with_events, Config(), pictures=False, events=True)
    events = [m for _, m in messages_of(with_events / "result.mcap", EVENTS_TOPIC)]
    assert messages_of(without / "result.mcap", EVENTS_TOPIC) == []
    (gone,) = (event for event in events if event.kind == ChangeKind.GONE)
    (stool,) = json.loads((BAGS / "walkthrough" / "truth.json").read_text())["gone"]
    at = gone.pose_before.position
    assert Polygon([p[:2] for p in stool["boundary"]]).contains(Point(at.x, at.y))
    kinds = Counter(ChangeKind(event.kind) for event in events)
    assert kinds == {
        ChangeKind.APPEARED: 2, ChangeKind.GONE: 1,
        ChangeKind.OBJECT_APPEARED: 3, ChangeKind.OBJECT_LEFT: 1,
    }  # fmt: skip
    for name in ("surfaces.json", "objects.json", "trajectory.tum", "map.mcap"):
        assert (with_events / name).read_bytes() == (without / name).read_bytes(), name


def messages_of(bag, topic):
    """Return [(log time, message)] of a topic, as rosbags reads them."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        assert connections, topic
        return [
            (stamp, reader.deserialize(raw, c.msgtype))
            for c, stamp, raw in reader.messages(connections)
        ]


def test_person_walking_through_leaves_no_cuboids(session_files, tmp_path):
    """The person is seen from 3 to 7 s of 20.7 s: in a window of all cycles, not in the last 10."""
    config = read_config(None, ["map.window_cycles=13"])
    replay(BAGS / "walkthrough", tmp_path / "all", config, pictures=False)
    assert Config().map.window_cycles == 10
    assert cuboids_on_the_way(tmp_path / "all" / "cuboids.npz") > 50
    assert cuboids_on_the_way(session_files.replayed("walkthrough") / "cuboids.npz") == 0


def cuboids_on_the_way(path):
    """Return the cuboids over the strip of floor at x = 1.75 m that the person walked along."""
    with np.load(path, allow_pickle=False) as map_:
        x, y = ((map_[key] + 0.5) * map_["cell_size"] for key in ("ix", "iy"))
        over_the_floor = (map_["top"] > 0.3) & (map_["bottom"] < 1.7)
        return int((over_the_floor & (x > 1.6) & (x < 1.9) & (y > -2.0) & (y < 0.5)).sum())


def test_a_bag_with_other_topics_and_an_upside_down_laser_is_mapped(tmp_path):
    remap = [
        "tilt_scan:=/nod_lidar/scan",
        "scan:=/front_lidar/scan",
        "odom:=/wheel_odom",
        "joint_states:=/dynamixel/joint_states",
    ]
    replay(BAGS / "upside_down", tmp_path / "map", Config(), remap=remap, pictures=False)
    assert fits_its_schemas(tmp_path / "map")
    score = score_surfaces(tmp_path / "map" / "surfaces.json", BAGS / "upside_down" / "truth.json")
    assert score.found == len(score.matches) > 0, score.text()


def test_a_topic_of_another_type_is_an_error(tmp_path):
    with pytest.raises(TopicError, match="TFMessage"):
        replay(BAGS / "walkthrough", tmp_path / "no", Config(), remap=["tilt_scan:=/tf_static"])
    assert not (tmp_path / "no").exists()


def rewrite(bag, out, change):
    """Copy a bag, with `change` applied to the messages of its tilting laser."""
    with BagReader(bag) as reader, BagWriter(out) as writer:
        types = {info.name: info.msgtype for info in reader.topics()}
        for message in reader.messages(types):
            content = message.data
            if message.topic == "/tilt_scan":
                content = TYPES.deserialize(types[message.topic], message.data)
                change(content)
            writer.write(message.topic, types[message.topic], message.log_ns, content)


def test_randomly_lost_beams_lose_no_surface(tmp_path):
    rng = np.random.default_rng(0)

    def lose(scan):
        lost = rng.random(len(scan.ranges)) < 0.03
        scan.ranges = np.where(lost, np.float32(0.0), scan.ranges)

    rewrite(BAGS / "flat", tmp_path / "bag", lose)
    replay(tmp_path / "bag", tmp_path / "map", Config(), pictures=False)
    score = score_surfaces(tmp_path / "map" / "surfaces.json", BAGS / "flat" / "truth.json")
    assert score.found == len(score.matches), score.text()
    assert max(abs(m.height_error) for m in score.matches) < 0.005, score.text()


def test_a_laser_without_a_usable_message_is_an_error_that_says_why(tmp_path):
    def spoil(scan):
        scan.angle_increment = 0.0

    rewrite(BAGS / "walkthrough", tmp_path / "bag", spoil)
    with pytest.raises(BagError, match=r"/tilt_scan.*angle_increment"):
        replay(tmp_path / "bag", tmp_path / "no", Config(), pictures=False)
    assert not (tmp_path / "no").exists()


def test_a_file_that_is_no_map_is_refused(tmp_path):
    (tmp_path / "map.mcap").write_bytes(b"no map")
    with pytest.raises(MapError, match=r"map\.mcap"):
        replay(BAGS / "walkthrough", tmp_path / "out", Config(), saved_map=tmp_path / "map.mcap")
    assert not (tmp_path / "out").exists()


def test_a_bag_of_other_rooms_is_a_trajectory_beside_the_map(flat, tmp_path):
    said = replay(
        BAGS / "walkthrough",
        tmp_path / "out",
        Config(),
        saved_map=flat / "map.mcap",
        pictures=False,
    )
    assert said.content.counts.unjoined_trajectories == 1
    assert "no place of the map matches them: 1" in said.text()
    before, after = (
        json.loads((folder / "surfaces.json").read_text())["surfaces"]
        for folder in (flat, tmp_path / "out")
    )
    place = {s["id"]: np.array(s["centroid"]) for s in after}
    for s in before:
        assert np.abs(place.pop(s["id"]) - s["centroid"]).max() < 0.005, s["id"]
    right = max(s["centroid"][0] for s in before)
    assert place
    assert min(centroid[0] for centroid in place.values()) > right + 20.0


def test_a_bag_of_other_rooms_is_refused_where_the_map_must_not_change(flat, tmp_path):
    """By its first seconds; the whole of it fits nowhere either (above)."""
    with BagReader(BAGS / "walkthrough") as reader, BagWriter(tmp_path / "bag") as writer:
        for message in islice(reader.messages(), 1600):
            writer.write(message.topic, message.msgtype, message.log_ns, message.data)
    why = r"could not be localised in the saved map, which is unchanged \(it waits for scans"
    with pytest.raises(MapError, match=why):
        replay(
            tmp_path / "bag",
            tmp_path / "out",
            Config(graph={"mode": "localisation"}),
            saved_map=flat / "map.mcap",
            pictures=False,
        )
    assert not (tmp_path / "out").exists()
