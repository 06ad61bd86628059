"""Robot descriptions: read rightly, against pinocchio; refused cleanly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_robots import pinocchio_poses, trees
from robots import TILTING, joint, robot

from tccm_ros.errors import FrameError, UrdfError
from tccm_ros.robot.chain import JointReading
from tccm_ros.robot.frames import build_chain, find_path
from tccm_ros.robot.tracks import ScalarTrack
from tccm_ros.robot.urdf import read_urdf

MAX_URDF_BYTES = 8_000_000  # forty times a large description


@given(trees())
@settings(max_examples=60, deadline=None)
def test_chains_agree_with_pinocchio(tree):
    text, positions = tree
    model = read_urdf(text)
    T_root_link = pinocchio_poses(text, positions)

    def reading(joint):
        track = ScalarTrack()
        track.append(0, positions[joint.name])
        return JointReading(joint.name, track, joint.axis, joint.motion == "turn")

    a, b = model.links[len(model.links) // 2], model.links[-1]
    chain = build_chain(find_path(a, b, dict(model.joints)), reading)
    expected = np.linalg.inv(T_root_link(a)) @ T_root_link(b)
    # ten joints of up to 5 m, in double precision
    np.testing.assert_allclose(chain.at(np.zeros(1, np.int64))[0], expected, atol=1e-9)


def test_a_model_has_the_joints_and_root_of_its_urdf():
    model = read_urdf(TILTING)
    assert model.root == "base"
    assert set(model.joints) == {"head", "cradle", "laser", "front_laser"}
    assert model.joints["cradle"].motion == "turn"
    np.testing.assert_allclose(model.joints["head"].T_parent_joint[:3, 3], [0.1, 0.0, 1.0])


def test_axes_are_normalised_and_default_to_x():
    text = robot([joint("a", "revolute", "base", "b", axis="0 0 -4")])
    np.testing.assert_allclose(read_urdf(text).joints["b"].axis, [0, 0, -1])
    bare = text.replace('<axis xyz="0 0 -4"/>', "")
    np.testing.assert_allclose(read_urdf(bare).joints["b"].axis, [1, 0, 0])


def test_collision_shapes_are_read_and_meshes_are_left_out():
    body = (
        '<collision><origin xyz="0 0 0.5"/><geometry><box size="0.4 0.2 1.0"/></geometry>'
        '</collision><collision><geometry><cylinder radius="0.1" length="0.6"/></geometry>'
        '</collision><collision><geometry><sphere radius="0.3"/></geometry></collision>'
        '<collision><geometry><mesh filename="package://a/b.stl"/></geometry></collision>'
    )
    model = read_urdf(robot([joint("a", "fixed", "base", "b")], {"base": body}))
    assert [shape.kind for shape in model.shapes] == ["box", "cylinder", "sphere"]
    np.testing.assert_allclose(model.shapes[0].size, [0.2, 0.1, 0.5])
    np.testing.assert_allclose(model.shapes[0].T_link_shape[:3, 3], [0, 0, 0.5])
    np.testing.assert_allclose(model.shapes[1].size, [0.1, 0.1, 0.3])
    np.testing.assert_allclose(model.shapes[2].size, [0.3, 0.3, 0.3])


BROKEN = {
    "empty": ("", "empty"),
    "not XML": ("<robot", "not XML"),
    "another root": ("<sdf/>", "<robot> is expected, found <sdf>"),
    "no links": ("<robot/>", "no links"),
    "a nameless link": ("<robot><link/></robot>", "without a name"),
    "a link twice": ('<robot><link name="a"/><link name="a"/></robot>', "'a' is there twice"),
    "an unknown parent": (
        TILTING.replace('<parent link="head"/>', '<parent link="haed"/>'),
        "joint 'tilt' names no link 'haed'; did you mean 'head'",
    ),
    "two parents": (
        robot([joint("a", "fixed", "x", "y"), joint("b", "fixed", "z", "y")]),
        "'y' has two parents",
    ),
    "two trees": (robot([joint("a", "fixed", "x", "y")], None, ["island"]), "roots: island, x"),
    "a ring": (
        robot([joint("a", "fixed", "x", "y"), joint("b", "fixed", "y", "x")]),
        "ring",
    ),
    "a ring beside a tree": (
        robot([joint("a", "fixed", "x", "y"), joint("b", "fixed", "y", "x")], None, ["base"]),
        "form a ring",
    ),
    "a joint twice": (
        robot([joint("a", "fixed", "x", "y"), joint("a", "fixed", "y", "z")]),
        "joint 'a' is there twice",
    ),
    "entities": (
        '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
        '<robot><link name="&b;"/></robot>',
        "document type is not allowed",
    ),
    "an outside entity": (
        '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]><robot><link name="&a;"/></robot>',
        "document type is not allowed",
    ),
}


@pytest.mark.parametrize(("text", "message"), BROKEN.values(), ids=BROKEN)
def test_broken_descriptions_are_one_clean_error(text, message):
    with pytest.raises(UrdfError, match="robot description") as caught:
        read_urdf(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


FAULTS = {
    "an unknown type": (TILTING.replace("revolute", "ball"), "has the unknown type 'ball'"),
    "no number": (TILTING.replace("0.1 0 1.0", "0.1 0 high"), "3 numbers expected"),
    "not finite": (TILTING.replace("0.1 0 1.0", "0.1 0 nan"), "3 numbers expected"),
    "two numbers": (TILTING.replace("0.1 0 1.0", "0.1 0"), "3 numbers expected"),
    "no axis": (TILTING.replace("0 1 0", "0 0 0"), "axis of zero length"),
    "mimics nothing": (
        TILTING.replace(
            'name="tilt" type="revolute">', 'name="tilt" type="revolute"><mimic joint="tillt"/>'
        ),
        "mimics no joint 'tillt'; did you mean 'tilt'",
    ),
}


@pytest.mark.parametrize(("text", "message"), FAULTS.values(), ids=FAULTS)
def test_a_fault_of_a_joint_counts_where_a_chain_needs_it(text, message):
    model = read_urdf(text)
    assert len(model.faults) == 1
    assert message in model.faults[0]
    with pytest.raises(FrameError) as caught:
        build_chain(find_path("base", "laser", dict(model.joints)), lambda joint: None)
    assert str(caught.value) == model.faults[0]
    beside = build_chain(find_path("base", "front_laser", dict(model.joints)), lambda joint: None)
    assert beside.parts == ()


def test_a_shape_with_a_fault_is_left_out():
    body = '<collision><geometry><box size="1 -1 1"/></geometry></collision>'
    model = read_urdf(robot([joint("a", "fixed", "x", "y")], {"x": body}))
    assert model.shapes == ()
    assert model.faults == ("collision of link 'x': a negative size",)


ACCEPTED_BY_ROS = {
    "whitespace before the declaration": f'\n  <?xml version="1.0"?>\n{TILTING}',
    "a byte order mark": f'\ufeff<?xml version="1.0"?>{TILTING}',
    "another encoding": f'<?xml version="1.0" encoding="us-ascii"?>{TILTING}',
    "hyphens in a comment": TILTING.replace("</robot>", "<!-- --- base <link --- --></robot>"),
    "a prefix of nothing": TILTING.replace("</robot>", "<gazebo><a:b c:d='e'/></gazebo></robot>"),
    "a bare ampersand": TILTING.replace("</robot>", "<gazebo a='b & c'>d && e</gazebo></robot>"),
    "less than in an attribute": TILTING.replace("</robot>", "<gazebo a='b<c' d = \"<\"/></robot>"),
    "a document type of nothing": f"<!DOCTYPE robot>{TILTING}",
    "an entity of nothing": TILTING.replace("</robot>", "<gazebo>&nbsp;</gazebo></robot>"),
    "data": TILTING.replace("</robot>", "<gazebo><![CDATA[<!-- & ]]></gazebo></robot>"),
}


@pytest.mark.parametrize("text", ACCEPTED_BY_ROS.values(), ids=ACCEPTED_BY_ROS)
def test_descriptions_that_ros_reads_are_read(text):
    model = read_urdf(text)
    assert set(model.joints) == {"head", "cradle", "laser", "front_laser"}
    assert model.faults == ()


def test_an_entity_in_a_name_is_decoded():
    assert read_urdf('<robot><link name="a&amp;b&#33;"/></robot>').root == "a&b!"


def test_limits_are_those_that_leave_a_way_to_go():
    def limits(text):
        described = joint("a", "revolute", "x", "y")
        start = described.index("<limit")
        limit = f"<limit {text}/></joint>" if text else "</joint>"
        return read_urdf(robot([described[:start] + limit])).joints["y"].limits

    assert limits('lower="-0.5" upper="1.5" effort="1" velocity="2"') == (-0.5, 1.5)
    assert limits('upper="1"') == (0.0, 1.0)
    for text in ("", 'effort="1"', 'lower="1" upper="-1"', 'lower="low"', 'upper="inf"'):
        assert limits(text) is None


def test_a_huge_description_is_not_parsed():
    with pytest.raises(UrdfError, match="bytes"):
        read_urdf("<robot>" + " " * MAX_URDF_BYTES + "</robot>")


def test_deep_nesting_is_an_error_and_no_crash():
    with pytest.raises(UrdfError):
        read_urdf("<robot>" + "<a>" * 100_000)
    model = read_urdf("<robot><link name='base'/>" + "<a>" * 50_000 + "</a>" * 50_000 + "</robot>")
    assert model.root == "base"


@given(st.text(max_size=200))
@settings(max_examples=200)
def test_any_text_is_read_or_refused(text):
    with pytest.raises(UrdfError):
        read_urdf(text)


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_damaged_descriptions_are_read_or_refused(data):
    text = TILTING
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = min(len(text), start + data.draw(st.integers(0, 20)))
        text = text[:start] + data.draw(st.text(max_size=6)) + text[end:]
    try:
        model = read_urdf(text)
    except UrdfError as error:
        message = str(error)
    else:
        message = ""
        assert model.root in model.links
    assert "\n" not in message
