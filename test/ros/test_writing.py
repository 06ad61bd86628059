"""Records are read back from their messages unchanged, in both families of message classes."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from message_families import TYPESTORE, to_bag_message
from sample_records import STAMP, T, make_scan
from scipy.spatial.transform import Rotation

from tccm_ros.errors import MessageError
from tccm_ros.geometry import pose
from tccm_ros.records import (
    JointSample,
    ObjectBoxes,
    Odometry,
    RobotDescription,
    Scan,
    SensorKind,
    SurfaceCloud,
    TransformSample,
    ViewIntervals,
)
from tccm_ros.ros.reading import (
    joint_sample_from_message,
    object_boxes_from_message,
    odometry_from_message,
    robot_description_from_message,
    surface_cloud_from_message,
    transforms_from_message,
    view_from_message,
)
from tccm_ros.ros.writing import (
    object_boxes_message,
    scan_message,
    surface_cloud_message,
    transforms_message,
    view_message,
)
from tccm_ros.sensors.laser_scan import scan_from_message
from tccm_sim.sensor_messages import (
    joint_sample_message,
    odometry_message,
    robot_description_message,
)


def bits(array):
    """Compare floats bit by bit, so that nan payloads and -0.0 count."""
    return np.ascontiguousarray(array).view(np.uint8).tolist()


def test_a_scan_with_every_special_range_is_read_back_bit_for_bit(types):
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
    scan = make_scan(np.linspace(0.1, 9.0, 25))
    live = scan_from_message(scan_message(types, scan))
    assert bits(live.ranges) == bits(scan.ranges)


def test_an_empty_scan_is_read_back(types):
    assert len(scan_from_message(scan_message(types, make_scan([]))).ranges) == 0


def test_a_joint_sample_is_read_back_without_unknown_positions(types):
    sample = JointSample(STAMP, ("wheel", "tilt", "neck"), np.array([1.0, np.nan, -0.25]))
    message = joint_sample_message(types, sample)
    message = to_bag_message(types, "sensor_msgs/msg/JointState", message)
    back = joint_sample_from_message(message)
    assert back.names == ("wheel", "neck")
    assert back.positions.tolist() == [1.0, -0.25]
    assert back.stamp_ns == STAMP


def test_odometry_is_read_back(types):
    message = odometry_message(types, Odometry(STAMP, "odom", "base_link", T))
    back = odometry_from_message(to_bag_message(types, "nav_msgs/msg/Odometry", message))
    assert (back.stamp_ns, back.frame_id, back.child_frame_id) == (STAMP, "odom", "base_link")
    np.testing.assert_allclose(back.T_odom_base, T, atol=1e-14)


@settings(max_examples=100, deadline=None)
@given(
    hnp.arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 1e-3)
)
@example(np.array([1.0, 0.0, 0.0, 0.0]))
@example(np.array([0.0, 1.0, 0.0, 1e-9]))
@example(np.array([0.0, 0.0, -1.0, 0.0]))
def test_rotations_are_read_back_from_quaternions(q):
    rotation = Rotation.from_quat(q).as_matrix()
    message = odometry_message(TYPESTORE, Odometry(0, "odom", "base", pose(rotation, np.zeros(3))))
    orientation = message.pose.pose.orientation
    values = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    assert np.linalg.norm(values) == pytest.approx(1.0, abs=1e-12)
    assert orientation.w >= 0.0
    np.testing.assert_allclose(Rotation.from_quat(values).as_matrix(), rotation, atol=1e-12)
    back = odometry_from_message(message).T_odom_base
    np.testing.assert_allclose(back[:3, :3], rotation, atol=1e-12)


def test_transforms_are_read_back():
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


def test_a_robot_description_is_read_back(types):
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
def test_a_surface_message_is_read_back_exactly(points, seed):
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
def test_the_surface_message_has_the_same_bytes_in_both_families(types, n):
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


def test_the_surface_message_has_the_viewpoint_and_its_sensor(types):
    eye = np.array([0.1, -0.2, 1.3], np.float32)
    cloud = SurfaceCloud(
        STAMP, "base", np.ones((2, 3), np.float32), np.zeros(2, np.uint32), eye, SensorKind(2)
    )
    back = surface_cloud_from_message(
        to_bag_message(types, "sensor_msgs/msg/PointCloud2", surface_cloud_message(types, cloud))
    )
    assert (bits(back.viewpoint), back.sensor) == (bits(eye), SensorKind.POINT_CLOUD)


def test_a_view_is_read_back_with_its_open_intervals(types):
    intervals = np.array([[0.05, 0.15, -np.inf, 1.0], [0.05, 0.25, 0.1, np.inf]], np.float32)
    message = view_message(types, ViewIntervals(STAMP, "base", intervals))
    back = view_from_message(to_bag_message(types, "sensor_msgs/msg/PointCloud2", message))
    assert bits(back.intervals) == bits(intervals)


def test_a_view_is_read_back_with_its_hits(types):
    intervals = np.array([[0.05, 0.15, 0.0, 1.0]], np.float32)
    hits = np.array([[0.31, 0.12, 0.40, 0.43], [0.35, 0.12, 0.41, 0.41]], np.float32)
    message = view_message(types, ViewIntervals(STAMP, "base", intervals, hits))
    back = view_from_message(to_bag_message(types, "sensor_msgs/msg/PointCloud2", message))
    assert (bits(back.intervals), bits(back.hits)) == (bits(intervals), bits(hits))


def test_hits_that_are_not_finite_are_refused(types):
    hits = np.array([[0.31, 0.12, 0.40, np.inf]], np.float32)
    message = view_message(types, ViewIntervals(STAMP, "base", hits[:0], hits))
    with pytest.raises(MessageError, match="hits that are not finite"):
        view_from_message(to_bag_message(types, "sensor_msgs/msg/PointCloud2", message))


def read_objects(message):
    cloud = to_bag_message(TYPESTORE, "sensor_msgs/msg/PointCloud2", message)
    return object_boxes_from_message(cloud)


@pytest.mark.parametrize("corners", [(3, 5), (4,), ()])
def test_objects_are_read_back(corners):
    rng = np.random.default_rng(0)
    rings = tuple(rng.random((count, 2)) for count in corners)
    points = np.arange(len(corners), dtype=np.uint32)
    boxes = ObjectBoxes(STAMP, "base", rings, rng.random((len(corners), 2)), points)
    back = read_objects(object_boxes_message(TYPESTORE, boxes))
    assert [bits(ring) for ring in back.footprints] == [bits(ring) for ring in rings]
    assert (bits(back.z), bits(back.points)) == (bits(boxes.z), bits(points))


def test_footprints_without_area_are_refused():
    boxes = ObjectBoxes(STAMP, "base", (np.eye(2),), np.zeros((1, 2)), np.zeros(1, np.uint32))
    with pytest.raises(MessageError, match="three or more corners"):
        read_objects(object_boxes_message(TYPESTORE, boxes))


def test_a_stamp_that_does_not_fit_a_message_is_refused():
    scan = Scan(2**31 * 10**9, "laser", 0.0, 0.1, 0.0, 0.0, 1.0, np.zeros(1, np.float32))
    with pytest.raises(MessageError, match="stamp"):
        scan_message(TYPESTORE, scan)


def test_negative_stamps_are_read_back():
    scan = Scan(-1, "laser", 0.0, 0.1, 0.0, 0.0, 1.0, np.zeros(1, np.float32))
    assert scan_from_message(scan_message(TYPESTORE, scan)).stamp_ns == -1
