import math
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from message_families import TYPESTORE, family, to_bag_message
from scipy.spatial.transform import Rotation

from tccm_ros.geometry import pose, pose_from_rpy
from tccm_ros.messages import (
    READERS,
    MessageError,
    Record,
    joint_sample_from_message,
    joint_sample_message,
    odometry_from_message,
    odometry_message,
    robot_description_from_message,
    robot_description_message,
    scan_from_message,
    scan_message,
    surface_cloud_from_message,
    surface_cloud_message,
    transforms_from_message,
    transforms_message,
    view_from_message,
    view_message,
)
from tccm_ros.records import (
    JointSample,
    Odometry,
    RobotDescription,
    Scan,
    SurfaceCloud,
    TransformSample,
    ViewIntervals,
)

STAMP = 1_700_000_000_123_456_789
T = pose_from_rpy([1.0, -2.0, 0.5, 0.1, -0.2, 3.0])


@pytest.fixture(params=["typestore", "rosidl"])
def types(request):
    return family(request.param)


def bits(array):
    """Compare floats bit by bit, so that nan payloads and -0.0 count."""
    return np.ascontiguousarray(array).view(np.uint8).tolist()


def make_scan(ranges):
    return Scan(STAMP, "laser", -1.5, 0.25, 0.0001, 0.05, 30.0, np.asarray(ranges, np.float32))


def test_scan_returns_as_it_went_with_every_special_range(types):
    scan = make_scan([1.5, np.inf, -np.inf, np.nan, 0.0, -0.0, 3e38])
    message = to_bag_message(
        types, "sensor_msgs/msg/LaserScan", scan_message(types, scan, scan_time=0.025)
    )
    back = scan_from_message(message)
    assert bits(back.ranges) == bits(scan.ranges)
    assert back.ranges.dtype == np.float32
    assert (back.stamp_ns, back.frame_id) == (STAMP, "laser")
    assert back.angle_min == -1.5
    assert back.angle_increment == 0.25
    assert back.time_increment == np.float32(0.0001)
    assert back.range_max == 30.0
    assert message.angle_max == 0.0


def test_live_message_and_bag_message_give_the_same_scan(types):
    scan = make_scan(np.linspace(0.1, 9.0, 50))
    live = scan_from_message(scan_message(types, scan))
    assert bits(live.ranges) == bits(scan.ranges)


def test_empty_scan(types):
    assert len(scan_from_message(scan_message(types, make_scan([]))).ranges) == 0


@pytest.mark.parametrize(
    "changes",
    [
        {"angle_min": math.nan},
        {"angle_increment": math.inf},
        {"time_increment": -1e-4},
        {"time_increment": 100.0},
        {"range_max": math.nan},
    ],
)
def test_scan_that_no_processor_can_use_is_refused(changes):
    message = scan_message(TYPESTORE, make_scan([1.0, 2.0]))
    for key, value in changes.items():
        setattr(message, key, value)
    with pytest.raises(MessageError):
        scan_from_message(message)


def test_joint_sample_round_trip_and_unknown_positions(types):
    sample = JointSample(STAMP, ("wheel", "tilt", "neck"), np.array([1.0, np.nan, -0.25]))
    message = joint_sample_message(types, sample)
    message = to_bag_message(types, "sensor_msgs/msg/JointState", message)
    back = joint_sample_from_message(message)
    assert back.names == ("wheel", "neck")
    assert back.positions.tolist() == [1.0, -0.25]
    assert back.stamp_ns == STAMP


def test_joint_state_without_positions_is_an_empty_sample(types):
    message = joint_sample_message(types, JointSample(STAMP, ("tilt",), np.zeros(0)))
    assert joint_sample_from_message(message).names == ()


def test_joint_state_with_too_few_positions_is_refused():
    message = joint_sample_message(TYPESTORE, JointSample(STAMP, ("a", "b"), np.zeros(1)))
    with pytest.raises(MessageError, match="2 names and 1 positions"):
        joint_sample_from_message(message)


def test_odometry_round_trip(types):
    message = odometry_message(types, Odometry(STAMP, "odom", "base_link", T))
    back = odometry_from_message(to_bag_message(types, "nav_msgs/msg/Odometry", message))
    assert (back.stamp_ns, back.frame_id, back.child_frame_id) == (STAMP, "odom", "base_link")
    np.testing.assert_allclose(back.T_odom_base, T, atol=1e-14)


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (0, 0, math.inf, 1)])
def test_odometry_without_a_rotation_is_refused(quaternion):
    message = odometry_message(TYPESTORE, Odometry(STAMP, "odom", "base", T))
    orientation = message.pose.pose.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, quaternion)
    with pytest.raises(MessageError):
        odometry_from_message(message)


def test_quaternions_are_normalised():
    message = odometry_message(TYPESTORE, Odometry(STAMP, "odom", "base", np.eye(4)))
    message.pose.pose.orientation.w = 0.999
    np.testing.assert_allclose(odometry_from_message(message).T_odom_base, np.eye(4))


@settings(max_examples=100, deadline=None)
@given(
    hnp.arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 1e-3)
)
@example(np.array([1.0, 0.0, 0.0, 0.0]))
@example(np.array([0.0, 1.0, 0.0, 1e-9]))
@example(np.array([0.0, 0.0, -1.0, 0.0]))
def test_rotations_survive_as_quaternions(q):
    rotation = Rotation.from_quat(q).as_matrix()
    message = odometry_message(TYPESTORE, Odometry(0, "odom", "base", pose(rotation, np.zeros(3))))
    orientation = message.pose.pose.orientation
    values = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    assert np.linalg.norm(values) == pytest.approx(1.0, abs=1e-12)
    assert orientation.w >= 0.0
    np.testing.assert_allclose(Rotation.from_quat(values).as_matrix(), rotation, atol=1e-12)
    back = odometry_from_message(message).T_odom_base
    np.testing.assert_allclose(back[:3, :3], rotation, atol=1e-12)


def test_transforms_round_trip():
    samples = [
        TransformSample(STAMP, "map", "odom", T, False),
        TransformSample(STAMP + 1, "base", "laser", np.eye(4), False),
    ]
    message = transforms_message(TYPESTORE, samples)
    message = to_bag_message(TYPESTORE, "tf2_msgs/msg/TFMessage", message)
    back = transforms_from_message(message, is_static=True)
    assert [(s.stamp_ns, s.parent, s.child, s.is_static) for s in back] == [
        (STAMP, "map", "odom", True),
        (STAMP + 1, "base", "laser", True),
    ]
    np.testing.assert_allclose(back[0].T_parent_child, T, atol=1e-14)


def test_slashes_before_frame_names_are_dropped():
    message = transforms_message(
        TYPESTORE, [TransformSample(STAMP, "/base_link", "/laser", np.eye(4), False)]
    )
    (sample,) = transforms_from_message(message)
    assert (sample.parent, sample.child) == ("base_link", "laser")


def test_robot_description_round_trip(types):
    urdf = RobotDescription('<robot name="Müller"/>')
    message = robot_description_message(types, urdf)
    message = to_bag_message(types, "std_msgs/msg/String", message)
    assert robot_description_from_message(message).urdf == urdf.urdf


finite32 = st.floats(width=32, allow_nan=False, allow_infinity=False)


@settings(max_examples=40, deadline=None)
@given(
    points=hnp.arrays(np.float32, st.tuples(st.integers(0, 20), st.just(3)), elements=finite32),
    seed=st.integers(0, 2**32 - 1),
)
def test_surface_cloud_round_trip_is_exact(points, seed):
    surface = np.random.default_rng(seed).integers(0, 2**32, len(points)).astype(np.uint32)
    cloud = SurfaceCloud(STAMP, "base", points, surface)
    message = surface_cloud_message(TYPESTORE, cloud)
    back = surface_cloud_from_message(
        to_bag_message(TYPESTORE, "sensor_msgs/msg/PointCloud2", message)
    )
    assert bits(back.points) == bits(points)
    assert back.surface.tolist() == surface.tolist()
    assert back.points.dtype == np.float32
    assert back.surface.dtype == np.uint32
    assert (back.stamp_ns, back.frame_id) == (STAMP, "base")


@pytest.mark.parametrize("n", [0, 1, 7])
def test_hand_over_is_the_same_for_both_families(types, n):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(n, 3)).astype(np.float32)
    cloud = SurfaceCloud(STAMP, "base", points, np.arange(n, dtype=np.uint32) + 2**31)
    message = to_bag_message(
        types, "sensor_msgs/msg/PointCloud2", surface_cloud_message(types, cloud)
    )
    back = surface_cloud_from_message(message)
    assert bits(back.points) == bits(points)
    assert back.points.shape == (n, 3)
    assert back.surface.tolist() == cloud.surface.tolist()
    assert (message.width, message.height, message.point_step) == (n, 1, 16)


def test_view_round_trip_keeps_open_intervals(types):
    intervals = np.array([[0.05, 0.15, -np.inf, 1.0], [0.05, 0.25, 0.1, np.inf]], np.float32)
    message = view_message(types, ViewIntervals(STAMP, "base", intervals))
    back = view_from_message(to_bag_message(types, "sensor_msgs/msg/PointCloud2", message))
    assert bits(back.intervals) == bits(intervals)


def test_hand_over_with_points_that_are_not_finite_is_refused():
    points = np.array([[0, 0, np.nan]], np.float32)
    message = surface_cloud_message(
        TYPESTORE, SurfaceCloud(STAMP, "base", points, np.zeros(1, np.uint32))
    )
    with pytest.raises(MessageError, match="not finite"):
        surface_cloud_from_message(message)


def test_stamp_beyond_a_message_is_refused():
    scan = Scan(2**31 * 10**9, "laser", 0.0, 0.1, 0.0, 0.0, 1.0, np.zeros(1, np.float32))
    with pytest.raises(MessageError, match="stamp"):
        scan_message(TYPESTORE, scan)


def test_negative_stamps_round_trip():
    scan = Scan(-1, "laser", 0.0, 0.1, 0.0, 0.0, 1.0, np.zeros(1, np.float32))
    assert scan_from_message(scan_message(TYPESTORE, scan)).stamp_ns == -1


def test_every_reader_refuses_or_reads_default_messages():
    for msgtype, read in READERS.values():
        try:
            records = read(TYPESTORE.make(msgtype))
        except MessageError:
            continue
        assert len(records) <= 1


@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=200), role=st.sampled_from(sorted(READERS)))
def test_reader_never_fails_otherwise_than_by_message_error(data, role):
    """Whatever bytes deserialise to, the reader gives records or a MessageError."""
    msgtype, read = READERS[role]
    records = []
    with suppress(MessageError):
        records = read(TYPESTORE.deserialize(msgtype, b"\0\1\0\0" + data))
    assert all(isinstance(record, Record) for record in records)


def test_readers_take_any_object_with_the_fields():
    message = SimpleNamespace(data="<robot/>")
    assert robot_description_from_message(message).urdf == "<robot/>"
