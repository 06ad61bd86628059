import numpy as np
import pytest
from message_families import TYPESTORE, family, to_bag_message

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.racks.compartment import Compartment, FaceState, SpaceGrid
from tccm_ros.records import PlaneRecord, Sign, Surface, TabletopObject, Wall
from tccm_ros.ros.marker_parts import (
    MarkerSet,
    MessageContext,
    identity_color,
    make_marker,
    moved_markers,
)
from tccm_ros.ros.markers import (
    compartment_markers,
    core_markers,
    cuboid_markers,
    object_markers,
    plane_markers,
    sign_markers,
    surface_markers,
    wall_markers,
)
from tccm_ros.ros.types import pose_message

CUBE = 1  # Marker.CUBE of visualization_msgs

STAMP = 1_700_000_000_000_000_005
SQUARE = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
HOLE = np.array([[0.5, 0.25, 0], [0.5, 0.75, 0], [1.5, 0.75, 0], [1.5, 0.25, 0]], float)


@pytest.fixture(params=["typestore", "rosidl"])
def context(request):
    return MessageContext(family(request.param), STAMP, "map")


def make_sign():
    at, facing = np.array([1.0, 2.0, 1.5]), np.array([0.0, 1.0, 0.0])
    return Sign(3, "205 Office", "205", 0.9, at, facing, np.eye(3) * 1e-4, 0, ())


def make_plane(identity=3, boundary=SQUARE, holes=(HOLE,)):
    return PlaneRecord(
        id=identity,
        kind="horizontal",
        normal=np.array([0.0, 0.0, 1.0]),
        offset=0.0,
        covariance=np.eye(3),
        support=100,
        area=1.5,
        quality=0.3,
        boundary=boundary,
        holes=holes,
        rms=0.002,
        centroid=boundary.mean(axis=0) if len(boundary) else np.zeros(3),
    )


def triangle_area(triangles):
    return 0.5 * np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
    )


def bag_markers(context, markers):
    array = MarkerSet(context.types).message(markers, STAMP)
    return to_bag_message(context.types, "visualization_msgs/msg/MarkerArray", array).markers


def test_plane_markers_are_the_same_for_both_families(context):
    found = bag_markers(context, plane_markers(context, [make_plane()]))
    assert [(m.ns, m.id) for m in found] == [
        ("fill", 3),
        ("outline", 3),
        ("normal", 3),
        ("text", 3),
    ]
    fill, outline, normal, text = found
    assert len(fill.points) % 3 == 0
    assert len(outline.points) == 2 * (4 + 4)
    assert (normal.points[1].z, normal.points[0].z) == (pytest.approx(0.2), 0.0)
    assert text.text == "3: 0.00 m, 1.50 m2"
    for marker in found:
        assert marker.header.frame_id == "map"
        assert marker.pose.orientation.w == 1.0
        assert marker.color.a > 0
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (1_700_000_000, 5)


def test_a_plane_without_boundary_has_no_fill(context):
    markers = plane_markers(context, [make_plane(boundary=np.zeros((0, 3)), holes=())])
    assert [m.ns for m in markers] == ["normal", "text"]


def test_markers_of_surfaces_objects_walls_and_cores_have_their_shapes(context):
    surface = Surface(
        id=2, label="table", confidence=0.9, height=0.7, normal=np.array([0, 0, 1.0]), offset=0.7,
        area=2.0, centroid=np.array([1, 0.5, 0.7]), holes=(),
        boundary=SQUARE + np.array([0, 0, 0.7]),
        points=1000, height_std=0.002, first_seen_ns=1, last_seen_ns=2, views=(),
    )  # fmt: skip
    markers = bag_markers(context, surface_markers(context, [surface]))
    assert markers[-1].text == "2 table: 0.70 m, 2.00 m2"
    box = TabletopObject(1, 2, np.array([1, 2, 3.0]), np.array([0.1, 0.0, 0.3]), np.pi / 2)
    (cube,) = bag_markers(context, object_markers(context, [box]))
    assert (cube.scale.x, cube.scale.y, cube.scale.z) == (0.1, 0.001, 0.3)
    assert cube.pose.orientation.z == pytest.approx(np.sqrt(0.5))
    ends = np.array([[2.0, -1.0], [2.0, 3.0]])
    wall = Wall(0, 0.0, 2.0, ends, 5, np.eye(2))
    fill = bag_markers(context, wall_markers(context, [wall]))[0]
    corners = np.array([[p.x, p.y, p.z] for p in fill.points]).reshape(-1, 3, 3)
    assert triangle_area(corners).sum() == pytest.approx(4 * 0.5)
    sign = make_sign()
    plate, text = bag_markers(context, sign_markers(context, [sign]))
    assert text.text == sign.text
    assert [plate.pose.position.x, plate.pose.position.y] == sign.position[:2].tolist()
    assert plate.pose.orientation.z == pytest.approx(np.sqrt(0.5))  # it faces y
    (lines,) = bag_markers(context, core_markers(context, np.zeros((3, 3)), np.ones((3, 3))))
    assert len(lines.points) == 6
    assert core_markers(context, np.zeros((0, 3)), np.zeros((0, 3))) == []


def test_a_compartment_is_a_list_of_its_edges_with_an_arrow(context):
    state, cells = FaceState.OPEN, np.zeros((1, 1, 1), bool)
    T = np.eye(4)
    T[:3, 3] = 1.0, 2.0, 0.5
    space = Compartment(
        2, 3, None, T, 0.8, 0.3, 0.35, state, state, state, state, 1.0,
        SpaceGrid(np.zeros(3), 0.03, cells, cells),
    )  # fmt: skip
    (marker,) = bag_markers(context, compartment_markers(context, [space]))
    points = np.array([(p.x, p.y, p.z) for p in marker.points])
    assert (marker.ns, marker.id, len(points)) == ("compartment", 0, 30)
    np.testing.assert_allclose(points[:24].min(axis=0), [1.0, 1.6, 0.5])
    np.testing.assert_allclose(points[:24].max(axis=0), [1.3, 2.4, 0.85])


def test_cuboids_are_drawn_down_from_their_tops_in_classes_of_depth(context):
    tops = np.array([[0, 0, 1.0], [0.02, 0, 1.0], [0.04, 0, 0.5]])
    depth = np.array([0.03, 0.12, 0.031])
    markers = bag_markers(
        context, cuboid_markers(context, tops, depth, 0.02, 0.03, [0.0, 0.5, 1.0])
    )
    assert [m.id for m in markers] == [0, 2]
    assert [m.scale.z for m in markers] == [0.03, 0.12]
    for marker in markers:
        assert marker.scale.x == 0.02
        assert len(marker.points) == len(marker.colors)
    assert markers[0].points[0].z + 0.5 * markers[0].scale.z == pytest.approx(1.0)
    assert markers[1].points[0].z + 0.5 * markers[1].scale.z == pytest.approx(1.0)
    blue, red = markers[0].colors
    assert blue.b > blue.r
    assert red.r > red.b
    assert cuboid_markers(context, np.zeros((0, 3)), np.zeros(0), 0.02, 0.03, np.zeros(0)) == []


def test_a_marker_that_is_missing_in_the_next_message_is_deleted_once(context):
    markers = MarkerSet(context.types)
    both = plane_markers(context, [make_plane(1), make_plane(2)])
    one = plane_markers(context, [make_plane(2)])
    assert all(m.action == 0 for m in markers.message(both, STAMP).markers)
    second = markers.message(one, STAMP + 1).markers
    gone = [(m.ns, m.id) for m in second if m.action == 2]
    assert gone == [("fill", 1), ("normal", 1), ("outline", 1), ("text", 1)]
    assert [(m.ns, m.id) for m in second if m.action == 0] == [(m.ns, m.id) for m in one]
    assert all(m.action == 0 for m in markers.message(one, STAMP + 2).markers)
    assert all(m.header.frame_id == "map" for m in second)


def test_neighbouring_ids_have_different_colours():
    colors = np.array([identity_color(k) for k in range(20)])
    assert np.abs(np.diff(colors, axis=0)).sum(axis=1).min() > 0.3


def test_messages_of_markers_are_repeatable():
    context = MessageContext(TYPESTORE, STAMP, "map")

    def data():
        message = MarkerSet(TYPESTORE).message(plane_markers(context, [make_plane()]), STAMP)
        return bytes(TYPESTORE.serialize("visualization_msgs/msg/MarkerArray", message))

    assert data() == data()


def test_markers_are_moved_where_odometry_begins_far_away(context):
    T = pose_from_rpy([450_000.0, 5_400_000.0, 2.0, 0.0, 0.0, np.pi / 2])
    plane, *_ = plane_markers(context, [make_plane()])
    at = pose_from_rpy([1.0, 0.5, 0.9, 0.0, 0.0, 0.0])
    box = make_marker(
        context,
        "object",
        1,
        CUBE,
        (1.0, 1.0, 1.0),
        (1.0, 1.0, 1.0),
        pose=pose_message(context.types, at),
    )
    moved = bag_markers(context, moved_markers(context.types, [plane, box], T))
    found = [[getattr(m.pose.position, axis) for axis in "xyz"] for m in moved]
    assert found == pytest.approx(
        np.array([[450_000.0, 5_400_000.0, 2.0], [449_999.5, 5_400_001.0, 2.9]])
    )
    assert [m.pose.orientation.z for m in moved] == pytest.approx([np.sqrt(0.5)] * 2)
    (same,) = moved_markers(context.types, plane_markers(context, [make_plane()])[:1], np.eye(4))
    assert same.pose.orientation.w == 1.0
