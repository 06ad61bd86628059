"""A computed recording of a head camera and a lidar that look at a table.

The robot drives slowly along the table, and the head pans. Depths and points are exact.
"""

import numpy as np
from message_families import TYPESTORE

from tccm_ros.bags.writer import BagWriter
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import (
    CameraInfo,
    DepthImage,
    JointSample,
    Odometry,
    PointCloud,
    RobotDescription,
)
from tccm_sim.sensor_messages import (
    camera_info_message,
    compressed_depth_message,
    depth_image_message,
    joint_sample_message,
    odometry_message,
    point_cloud_message,
    robot_description_message,
)

START_NS, MS = 1_700_000_000_000_000_000, 1_000_000
W, H, F = 160, 120, 130.0
TABLE, TOP = ((1.0, 2.0), (-0.8, 0.8)), 0.7
EYE_HEIGHT, PITCH = 1.4, 0.55

URDF = f"""<robot name="head"><link name="base"/><link name="neck"/><link name="eye"/>
  <link name="lidar"/>
  <joint name="pan" type="revolute"><parent link="base"/><child link="neck"/>
    <origin xyz="0 0 {EYE_HEIGHT}" rpy="0 {PITCH} 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="optical" type="fixed"><parent link="neck"/><child link="eye"/>
    <origin rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint>
  <joint name="mast" type="fixed"><parent link="base"/><child link="lidar"/>
    <origin xyz="0 0 1.2" rpy="0 0.4 0"/></joint></robot>"""


def camera(stamp_ns):
    """Return the calibration."""
    K = np.array([[F, 0, W / 2 - 0.5], [0, F, H / 2 - 0.5], [0, 0, 1.0]])
    P = np.hstack([K, np.zeros((3, 1))])
    return CameraInfo(stamp_ns, "eye", W, H, "plumb_bob", np.zeros(5), K, P)


def base_at(ms):
    """Return T_odom_base of a base that moves to the left at 10 cm/s."""
    return pose_from_rpy([0.0, 0.1e-3 * ms, 0, 0, 0, 0])


def pan_at(ms):
    """Return the angle of the head, rad."""
    return 0.3 * np.sin(ms * 1e-3)


def lengths(T, rays):
    """Return the lengths (N,) of rays (N, 3) from T to the table or the floor, nan beyond 6 m."""
    origin, way = T[:3, 3], rays @ T[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        on_top = (TOP - origin[2]) / way[:, 2]
        x, y = (origin[k] + on_top * way[:, k] for k in (0, 1))
        (x0, x1), (y0, y1) = TABLE
        hit = (on_top > 0) & (x > x0) & (x < x1) & (y > y0) & (y < y1)
        found = np.where(hit, on_top, -origin[2] / way[:, 2])
    return np.where((found > 0) & (found * np.linalg.norm(rays, axis=1) < 6.0), found, np.nan)


def image_at(ms):
    """Return the depth image, mm."""
    u, v = np.meshgrid(np.arange(W), np.arange(H))
    rays = np.stack([(u - W / 2 + 0.5) / F, (v - H / 2 + 0.5) / F, np.ones_like(u)], axis=-1)
    T = base_at(ms) @ pose_from_rpy([0, 0, EYE_HEIGHT, 0, PITCH, 0])
    T = T @ pose_from_rpy([0, 0, 0, 0, 0, pan_at(ms)])
    T = T @ pose_from_rpy([0, 0, 0, -np.pi / 2, 0, -np.pi / 2])
    z = lengths(T, rays.reshape(-1, 3).astype(float)).reshape(H, W)
    depth = np.nan_to_num(np.rint(1e3 * z)).astype(np.uint16)
    return DepthImage(START_NS + ms * MS, "eye", depth)


def cloud_at(ms):
    """Return the points of 16 rings, each column at its own time."""
    azimuth = np.linspace(-0.9, 0.9, 90)
    e, a = np.meshgrid(np.radians(np.arange(-15, 17, 2.0)), azimuth, indexing="ij")
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1).reshape(-1, 3)
    since = np.broadcast_to(np.arange(90) * MS, e.shape).ravel()
    T = base_at(ms) @ pose_from_rpy([0, 0, 1.2, 0, 0.4, 0])
    points = np.empty_like(rays)
    for k in range(90):  # each column is measured from the base pose at its time
        at = T.copy()
        at[1, 3] += 0.1e-3 * k
        column = since == k * MS
        points[column] = rays[column] * lengths(at, rays[column])[:, None]
    return PointCloud(START_NS + ms * MS, "lidar", points.astype(np.float32), since)


def assert_on_table_or_floor(points):
    """Assert that points below the eye are on the table top or the floor: both are exact."""
    heights = points[:, 2]
    is_table = np.abs(heights - TOP) < 0.01
    assert is_table.mean() > 0.1
    (x0, x1), (y0, y1) = TABLE
    x, y, _ = points[is_table].T
    assert (x0 - 0.02 < x).all() and (x < x1 + 0.02).all()  # noqa: PT018
    assert (y0 - 0.02 < y).all() and (y < y1 + 0.02).all()  # noqa: PT018
    assert (is_table | (np.abs(heights) < 0.02)).mean() > 0.9


def write_recording(
    path,
    *,
    seconds=4.0,
    images=("/depth/image_rect_raw",),
    clouds=("/points",),
    info=camera,
    change=lambda image: image,
):
    """Write a bag of the camera and the lidar; `info` and `change` may corrupt its messages."""
    with BagWriter(path, typestore=TYPESTORE) as writer:
        text = robot_description_message(TYPESTORE, RobotDescription(URDF))
        writer.write("/robot_description", "std_msgs/msg/String", START_NS, text)
        for ms in range(0, round(seconds * 1e3), 20):
            now = START_NS + ms * MS
            odometry = odometry_message(TYPESTORE, Odometry(now, "odom", "base", base_at(ms)))
            writer.write("/odom", "nav_msgs/msg/Odometry", now, odometry)
            joints = JointSample(now, ("pan",), np.array([pan_at(ms)]))
            message = joint_sample_message(TYPESTORE, joints)
            writer.write("/joint_states", "sensor_msgs/msg/JointState", now, message)
            if ms % 200 == 100:
                for topic in images:
                    _write_image(writer, topic, now, change(image_at(ms)), info)
            if ms % 200 == 0:
                for topic in clouds:
                    message = point_cloud_message(TYPESTORE, cloud_at(ms))
                    writer.write(topic, "sensor_msgs/msg/PointCloud2", now, message)


def _write_image(writer, topic, now, image, info):
    is_packed = topic.endswith("compressedDepth")
    kind = "CompressedImage" if is_packed else "Image"
    write = compressed_depth_message if is_packed else depth_image_message
    writer.write(topic, f"sensor_msgs/msg/{kind}", now, write(TYPESTORE, image))
    if info is not None:
        beside = topic.removesuffix("/compressedDepth").rsplit("/", 1)[0] + "/camera_info"
        message = camera_info_message(TYPESTORE, info(now))
        writer.write(beside, "sensor_msgs/msg/CameraInfo", now, message)
