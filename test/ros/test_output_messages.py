import numpy as np
import pytest
from message_families import to_bag_message

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.ros.output_messages import (
    grid_message,
    map_cloud_message,
    obstacle_cloud_message,
    path_message,
    pose_covariance_message,
    surface_map_message,
)
from tccm_ros.ros.pointcloud import MAP_ROW, POINT_ROW, SURFACE_MAP_ROW, cloud_rows
from tccm_ros.slam.occupancy import OccupancyGrid

OBSTACLE_STEP_M = 0.05  # m, between points: the cell of a costmap

STAMP = 1_700_000_000_000_000_005


def test_the_map_cloud_has_the_exact_values_of_the_cuboids(types):
    tops = np.array([[0.01, 0.03, 0.7]])
    message = map_cloud_message(types, STAMP, "odom", tops, [0.03], [6.999999], [4])
    rows = cloud_rows(to_bag_message(types, "sensor_msgs/msg/PointCloud2", message), MAP_ROW)
    expected = np.array([(0.01, 0.03, 0.7, 0.03, 7, 4)], MAP_ROW)
    assert rows.tobytes() == expected.tobytes()


def test_obstacle_points_fill_each_cuboid_from_its_top_down(types):
    rng = np.random.default_rng(3)
    tops, depth = rng.uniform(-1.0, 2.0, (50, 3)), rng.uniform(0.0, 0.4, 50)
    depth[0] = OBSTACLE_STEP_M  # a whole number of steps: the lower end is a point as well
    expected = []
    for (x, y, z), d in zip(tops, depth):
        k = 0
        while k * OBSTACLE_STEP_M <= d + 1e-9:
            expected.append((x, y, z - k * OBSTACLE_STEP_M))
            k += 1
    message = obstacle_cloud_message(types, STAMP, "odom", tops, depth)
    rows = cloud_rows(to_bag_message(types, "sensor_msgs/msg/PointCloud2", message), POINT_ROW)
    assert rows.tobytes() == np.array(expected, np.float32).tobytes()


def test_obstacles_of_a_large_house_fit_in_500_kb_and_leave_no_wall_open(types):
    x, y = (a.ravel() * 0.02 + 0.01 for a in np.meshgrid(np.arange(600), np.arange(500)))
    tops = np.column_stack([x, y, np.full(len(x), 0.8)])
    tall = (np.abs(x - 3.0) < 0.02) | (np.abs(y - 5.0) < 0.02)
    tops[tall, 2] = 2.2
    message = obstacle_cloud_message(types, STAMP, "odom", tops, np.where(tall, 2.2, 0.02))
    rows = cloud_rows(to_bag_message(types, "sensor_msgs/msg/PointCloud2", message), POINT_ROW)
    assert 100_000 <= len(rows) * 12 <= 500_000
    # A layer that takes heights from 1 to 2 m: the wall has no hole of two cells of 0.1 m.
    marked = np.unique(rows["x"][(rows["z"] > 1.0) & (rows["z"] < 2.0)] // 0.1)
    assert np.diff(marked).max() <= 2


def test_without_cuboids_there_are_no_obstacle_points(types):
    message = obstacle_cloud_message(types, STAMP, "odom", np.zeros((0, 3)), [])
    assert message.width == 0


def test_the_surface_cloud_has_id_and_colour(types):
    message = surface_map_message(types, STAMP, "map", [[1, 2, 3]], [9], [[255, 128, 1]])
    message = to_bag_message(types, "sensor_msgs/msg/PointCloud2", message)
    assert [(f.name, f.datatype) for f in message.fields][3:] == [("id", 6), ("rgb", 7)]
    (row,) = cloud_rows(message, SURFACE_MAP_ROW)
    assert (row["id"], row["rgb"]) == (9, 0xFF8001)


def test_a_planar_covariance_fills_the_rows_of_x_y_and_yaw(types):
    cov = np.array([[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]])
    T = pose_from_rpy([1, 2, 0, 0, 0, np.pi / 2])
    message = pose_covariance_message(types, STAMP, "map", T, cov)
    message = to_bag_message(types, "geometry_msgs/msg/PoseWithCovarianceStamped", message)
    full = message.pose.covariance.reshape(6, 6)
    assert full[0, 0] == 1.0
    assert full[1, 5] == full[5, 1] == 0.3
    assert full[5, 5] == 3.0
    assert full[2:5].sum() == 0.0
    assert message.pose.pose.orientation.w == pytest.approx(np.sqrt(0.5))


def test_a_path_has_the_stamps_and_poses(types):
    poses = np.stack([pose_from_rpy([k, 0, 0, 0, 0, 0]) for k in range(3)])
    message = path_message(types, STAMP, "map", [10, 20, 30], poses)
    message = to_bag_message(types, "nav_msgs/msg/Path", message)
    assert [p.pose.position.x for p in message.poses] == [0, 1, 2]
    assert [p.header.stamp.nanosec for p in message.poses] == [10, 20, 30]
    empty = to_bag_message(types, "nav_msgs/msg/Path", path_message(types, 0, "map", [], poses[:0]))
    assert empty.poses == []


def test_an_occupancy_grid_has_its_cells_size_and_origin(types):
    cells = np.array([[0, 100, -1], [1, 2, 3]], np.int8)
    message = grid_message(types, STAMP, "map", OccupancyGrid(cells, 0.05, np.array([1.0, -2.0])))
    message = to_bag_message(types, "nav_msgs/msg/OccupancyGrid", message)
    assert (message.info.width, message.info.height) == (3, 2)
    assert message.data.tolist() == [0, 100, -1, 1, 2, 3]
    corner = message.info.origin.position
    assert (corner.x, corner.y) == (1.0, -2.0)
