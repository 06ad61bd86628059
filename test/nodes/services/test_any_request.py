"""Any request over DDS, while both nodes map: an answer with a sentence, and nothing outside."""

import itertools

import numpy as np
import pytest
from asker import Asker
from geometry_msgs.msg import (
    Point,
    PointStamped,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    Vector3,
)
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from live_robot import recording, slam, tccm
from std_msgs.msg import Header

from tccm_ros.nodes.interfaces import has_interfaces

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

RECORDS = 4
"""Sent before each request, so that both nodes go on mapping."""

numbers = st.floats() | st.floats(-2.0, 2.0) | st.sampled_from([0.0, -1.0, 1e308, float("nan")])
counts = st.integers(0, 2**31 - 1) | st.integers(0, 3)
frames = st.sampled_from(["", "map", "odom", "base", "/base", "eye", "nowhere", "..", "a" * 4000])
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
names = st.one_of(
    texts,
    st.builds("/".join, st.lists(st.sampled_from(["..", ".", "", "home", "tmp"]), max_size=5)),
    st.sampled_from(
        ["../x", "/absolute/x", "x\x00y", "a" * 100_000, "x.previous", "~", "home\n", "."]
    ),
)
points = st.builds(Point, x=numbers, y=numbers, z=numbers)
headers = st.builds(Header, frame_id=frames)
filters = st.fixed_dictionaries(
    {},
    optional={
        "ids": st.lists(st.integers(-(2**31), 2**31 - 1), max_size=5),
        "labels": st.lists(st.sampled_from(["table", "floor", ""]) | texts, max_size=3),
        "min_confidence": numbers,
        "min_height": numbers,
        "max_height": numbers,
        "min_area": numbers,
        "near": st.builds(PointStamped, header=headers, point=points),
        "max_distance": numbers,
        "text": texts,
    },
)
placements = st.fixed_dictionaries(
    {},
    optional={
        **dict.fromkeys(("size_x", "size_y", "height", "clearance", "reach"), numbers),
        **dict.fromkeys(("min_reach_height", "max_reach_height", "robot_radius"), numbers),
        **dict.fromkeys(("max_count", "max_base_poses"), counts),
        **dict.fromkeys(("base", "approach"), st.integers(0, 255) | st.integers(0, 2)),
        **dict.fromkeys(("hand_width", "hand_height"), numbers),
    },
)
objects = st.fixed_dictionaries(
    {},
    optional={
        "labels": st.lists(texts, max_size=3),
        "surface_ids": st.lists(st.integers(-(2**31), 2**31 - 1), max_size=5),
        **dict.fromkeys(("min_size", "max_size", "max_distance", "clearance"), numbers),
        **dict.fromkeys(("hand_width", "hand_height"), numbers),
        "near": st.builds(PointStamped, header=headers, point=points),
        "max_count": counts,
    },
)
poses = st.builds(
    Pose,
    position=points,
    orientation=st.builds(Quaternion, x=numbers, y=numbers, z=numbers, w=numbers),
)
boxes = st.fixed_dictionaries(
    {
        "pose": st.builds(PoseStamped, header=headers, pose=poses),
        "size": st.builds(Vector3, x=numbers, y=numbers, z=numbers),
    }
)
corrections = {
    "surface_id": st.integers(-(2**31), 2**31 - 1) | st.integers(0, 3),
    "label": st.sampled_from(["table", "floor", ""]) | texts,
}
variances = st.sampled_from([0.0, 0.25]) | numbers
guesses = st.builds(
    PoseWithCovarianceStamped,
    header=headers,
    pose=st.builds(
        PoseWithCovariance,
        pose=poses,
        covariance=st.builds(lambda v: np.diag(np.full(6, v)).ravel(), variances),
    ),
)
REQUESTS = st.one_of(
    st.tuples(st.just("surfaces"), filters),
    st.tuples(st.just("placements"), placements),
    st.tuples(st.just("objects"), objects),
    st.tuples(st.just("box"), boxes),
    st.tuples(st.just("pose"), st.fixed_dictionaries({"pose": guesses})),
    st.tuples(st.just("list"), st.just({})),
    st.tuples(st.just("label"), st.fixed_dictionaries({}, optional=corrections)),
    *(
        st.tuples(st.just(kind), st.fixed_dictionaries({"name": names}))
        for kind in ("save", "load")
    ),
)


def answer(asker: Asker, kind: str, fields):
    if kind == "surfaces":
        return asker.surfaces(**fields)
    if kind == "placements":
        return asker.find_placements(**fields)
    if kind == "objects":
        return asker.find_objects(**fields)
    if kind == "box":
        return asker.ask("CheckBox", "/tccm/check_box", **fields)
    words = {
        "save": ("SaveMap", "save_named_map"),
        "load": ("LoadMap", "load_named_map"),
        "list": ("ListMaps", "list_maps"),
        "pose": ("SetPose", "set_pose"),
        "label": ("SetLabel", "set_label"),
    }[kind]
    return asker.ask(words[0], f"/surface_slam/{words[1]}", **fields)


def outside(folder, maps):
    """Return what lies in a folder beside the maps, and in what lies beside it."""
    return {p for p in folder.rglob("*") if maps not in (p, *p.parents)}


def test_any_request_gets_an_answer_and_writes_nowhere_else(ros, tmp_path):
    maps, other = tmp_path / "inner" / "maps", tmp_path / "other"
    other.mkdir()
    maps.mkdir(parents=True)
    (maps / "link").symlink_to(other)
    tilt_node, node = tccm(ros), slam(ros, save__directory=str(maps))
    robot, asker = ros.robot(), Asker(ros)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    records = recording(10_000)
    robot.play(itertools.islice(records, 250), tilt_node, node)
    ros.spin_until(lambda: asker.surfaces().success)
    before = outside(tmp_path, maps)

    @settings(max_examples=80, deadline=None, suppress_health_check=list(HealthCheck))
    @given(REQUESTS)
    @example(("save", {"name": "link"}))
    @example(("pose", {"pose": PoseWithCovarianceStamped()}))
    @example(("save", {"name": "../../other/x"}))
    @example(("save", {"name": str(other / "x")}))
    @example(("load", {"name": "../maps/home"}))
    @example(("placements", {"size_x": 1e-3, "size_y": 1e-3, "height": 1e-3, "max_count": 2**31}))
    def ask(request):
        kind, fields = request
        robot.play(itertools.islice(records, RECORDS), tilt_node, node, until_done=False)
        reply = answer(asker, kind, fields)
        assert reply.success or (reply.message and "\n" not in reply.message)
        assert outside(tmp_path, maps) == before
        assert not list(other.iterdir())

    ask()
    listed = asker.ask("ListMaps", "/surface_slam/list_maps")
    assert listed.success
    assert {m.name for m in listed.maps} <= {p.name for p in maps.iterdir()}
    assert asker.surfaces().success or "no map yet" in asker.surfaces().message
