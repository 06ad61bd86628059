"""Copies of a recording with edited messages, as in bags of other robots and drivers."""

import io

import numpy as np
from depth_room import EYE_HEIGHT, PITCH, START_NS, F, H, W, base_at, pan_at
from message_families import TYPESTORE
from PIL import Image

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.writer import BagWriter
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import DepthImage, TransformSample
from tccm_ros.records.building import stamp_ns_from_message
from tccm_ros.ros.pointcloud import cloud_message
from tccm_ros.ros.writing import transforms_message
from tccm_ros.sensors.cloud_messages import point_cloud_from_message
from tccm_sim.sensor_messages import compressed_depth_message

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
PACKED, CLOUD = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2"
TF = "tf2_msgs/msg/TFMessage"
XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]


def edited(source, path, edit):
    """Write a bag of the results of `edit` for each (topic, type, message); return its path."""
    with BagReader(source) as reader, BagWriter(path, typestore=TYPESTORE) as writer:
        for kept in reader.messages():
            message = TYPESTORE.deserialize(kept.msgtype, kept.data)
            for topic, msgtype, new in edit(kept.topic, kept.msgtype, message):
                writer.write(topic, msgtype, kept.log_ns, new)
    return path


def late(source, path, topics, late_ns):
    """Write a copy of a bag in which the messages of some topics were recorded later."""
    with BagReader(source) as reader, BagWriter(path, typestore=TYPESTORE) as writer:
        kept = [
            m._replace(log_ns=m.log_ns + late_ns * (m.topic in topics)) for m in reader.messages()
        ]
        for m in sorted(kept, key=lambda m: m.log_ns):
            writer.write(m.topic, m.msgtype, m.log_ns, TYPESTORE.deserialize(m.msgtype, m.data))
    return path


def stamp_of(message):
    return stamp_ns_from_message(message.header.stamp)


def set_stamp(message, stamp_ns):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)


def of_camera(change):
    """Return an edit of the depth images, which removes the lidar."""

    def edit(topic, msgtype, message):
        if msgtype == CLOUD:
            return []
        return change(topic, message) if msgtype == IMAGE else [(topic, msgtype, message)]

    return edit


def of_lidar(change):
    """Return an edit of the clouds, which removes the camera."""

    def edit(topic, msgtype, message):
        if msgtype in (IMAGE, INFO):
            return []
        return change(topic, message) if msgtype == CLOUD else [(topic, msgtype, message)]

    return edit


def depths_mm(message):
    return np.frombuffer(bytes(message.data), "<u2").reshape(message.height, message.width)


def depths_m(message):
    """Return the depths in m, nan without a return."""
    depth = depths_mm(message) * 1e-3
    return np.where(depth > 0.0, depth, np.nan).astype(np.float32)


def image_of(message, data, **changes):
    names = ("header", "height", "width", "encoding", "is_bigendian", "step")
    fields = {name: getattr(message, name) for name in names} | changes
    return TYPESTORE.make(IMAGE, data=np.frombuffer(data, np.uint8), **fields)


# -- cameras


def in_metres(topic, message):
    data = depths_m(message).astype("<f4").tobytes()
    return [(topic, IMAGE, image_of(message, data, encoding="32FC1", step=4 * W))]


def big_endian_with_padding(topic, message):
    data = b"".join(line.astype(">u2").tobytes() + b"\xff" * 12 for line in depths_mm(message))
    return [(topic, IMAGE, image_of(message, data, is_bigendian=1, step=2 * W + 12))]


def falsely_called_big_endian(topic, message):
    return [(topic, IMAGE, image_of(message, bytes(message.data), is_bigendian=1))]


def called_mono16(topic, message):
    return [(topic, IMAGE, image_of(message, bytes(message.data), encoding="mono16"))]


def as_png(topic, message):
    stream = io.BytesIO()
    Image.fromarray(depths_mm(message)).save(stream, "PNG")
    data = np.frombuffer(stream.getvalue(), np.uint8)
    packed = TYPESTORE.make(PACKED, header=message.header, format="png", data=data)
    return [(f"{topic}/compressed", PACKED, packed)]


def quantised(topic, message):
    image = DepthImage(stamp_of(message), "eye", depths_m(message))
    return [(f"{topic}/compressedDepth", PACKED, compressed_depth_message(TYPESTORE, image))]


def rectified(topic, msgtype, message):
    """Edit to images of image_proc: K and D are those of the raw image, P that of this one."""
    if msgtype == INFO:
        message.k = np.array([1.2 * F, 0, W / 2 + 3, 0, 1.2 * F, H / 2 - 5, 0, 0, 1.0])
        message.d = np.array([-0.3, 0.1, 0.0, 0.0, 0.0])
        return [("/head/camera_info", INFO, message)]
    return of_camera(lambda _, image: [("/head/image_rect", IMAGE, image)])(topic, msgtype, message)


def info_elsewhere(topic, msgtype, message):
    new = "/head/depth/calibration" if msgtype == INFO else topic
    return [] if msgtype == CLOUD else [(new, msgtype, message)]


def info_once():
    """Return an edit that keeps one calibration without a stamp, as of a latched topic."""
    seen = []

    def edit(topic, msgtype, message):
        if msgtype == INFO:
            seen.append(message)
            set_stamp(message, 0)
        return [] if msgtype == CLOUD or (len(seen) > 1 and msgtype == INFO) else [
            (topic, msgtype, message)
        ]  # fmt: skip

    return edit


def tf_alone(topic, msgtype, message):
    """Edit that replaces description, joints and odometry by /tf at 10 Hz and /tf_static."""
    if topic == "/robot_description":
        optical = pose_from_rpy([0, 0, 0, -np.pi / 2, 0, -np.pi / 2])
        fixed = TransformSample(START_NS, "neck", "eye", optical, is_static=True)
        return [("/tf_static", TF, transforms_message(TYPESTORE, [fixed]))]
    if topic == "/odom":
        now = stamp_of(message)
        ms = (now - START_NS) // 10**6
        neck = pose_from_rpy([0, 0, EYE_HEIGHT, 0, PITCH, 0])
        neck = neck @ pose_from_rpy([0, 0, 0, 0, 0, pan_at(ms)])
        moved = [
            TransformSample(now, "odom", "base", base_at(ms), is_static=False),
            TransformSample(now, "base", "neck", neck, is_static=False),
        ]
        return [("/tf", TF, transforms_message(TYPESTORE, moved))] if ms % 100 == 0 else []
    return [] if topic == "/joint_states" or msgtype == CLOUD else [(topic, msgtype, message)]


def organised(topic, message):
    """Edit to the point cloud of a depth image as of drivers: 32 bytes a point, nan if invalid."""
    z = depths_m(message)
    u, v = np.meshgrid(np.arange(W), np.arange(H))
    layout = np.dtype(
        {"names": ["x", "y", "z", "rgb"], "formats": ["<f4"] * 4, "offsets": [0, 4, 8, 16],
         "itemsize": 32}
    )  # fmt: skip
    rows = np.zeros((H, W), layout)
    rows["x"], rows["y"], rows["z"] = (u - W / 2 + 0.5) / F * z, (v - H / 2 + 0.5) / F * z, z
    cloud = cloud_message(TYPESTORE, stamp_of(message), "eye", rows.ravel())
    cloud.height, cloud.width, cloud.row_step, cloud.is_dense = H, W, 32 * W, False
    return [("/camera/depth/points", CLOUD, cloud)]


def organised_alone(topic, msgtype, message):
    return [] if msgtype == INFO else of_camera(organised)(topic, msgtype, message)


# -- lidars


def lidar(name, layout, times, shift_ns=0):
    """Return an edit to the clouds of a driver.

    `times` returns the times of the points, given the stamp of the first point and the offsets from
    it in ns; `shift_ns` is added to the stamp.
    """

    def change(_, message):
        cloud = point_cloud_from_message(message)
        rows = np.zeros(len(cloud.points), layout)
        for k, axis in enumerate("xyz"):
            rows[axis] = cloud.points[:, k]
        rows[rows.dtype.names[-1]] = times(cloud.stamp_ns, cloud.since_ns)
        new = cloud_message(TYPESTORE, cloud.stamp_ns + shift_ns, "lidar", rows)
        return [(name, CLOUD, new)]

    return of_lidar(change)


OUSTER = lidar(
    "/ouster/points", [*XYZ, ("intensity", "<f4"), ("ring", "<u2"), ("t", "<u4")], lambda s, d: d
)
HESAI = lidar("/hesai", [*XYZ, ("timestamp", "<f8")], lambda s, d: s * 1e-9 + d * 1e-9)
LIVOX = lidar(
    "/livox/lidar", [*XYZ, ("tag", "u1"), ("line", "u1"), ("timestamp", "<f8")], lambda s, d: s + d
)
VELODYNE = lidar(  # the stamp is that of the last point
    "/velodyne_points", [*XYZ, ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")],
    lambda s, d: (d - 89_000_000) * 1e-9, 89_000_000,
)  # fmt: skip
ANOTHER_CLOCK = lidar("/gps", [*XYZ, ("timestamp", "<f8")], lambda s, d: 1.4e9 + d * 1e-9)


# -- invalid messages


def without_x(message):
    message.fields[0].name = "u"


def wrong_step(message):
    message.point_step = 7


def too_many(message):
    message.width, message.height = 10**8, 1


def wrong_size(message):
    message.height *= 2


def zero_focal(message):
    message.k, message.p = np.zeros(9), np.zeros(12)


def every_other(msgtype, spoil):
    """Return an edit that corrupts every other message of a type."""
    seen = []

    def edit(topic, kind, message):
        if kind == msgtype:
            seen.append(topic)
            if len(seen) % 2:
                spoil(message)
        return [(topic, kind, message)]

    return edit


GARBAGE = lidar(
    "/ouster/points", [*XYZ, ("t", "<u4")],
    lambda s, d: np.random.default_rng(s % 1000).integers(0, 2**32, len(d)),
)  # fmt: skip


def falsely_big_endian(topic, msgtype, message):
    """Edit to an Ouster's clouds with a false is_bigendian."""
    edits = OUSTER(topic, msgtype, message)
    for _, kind, cloud in edits:
        if kind == CLOUD:
            cloud.is_bigendian = True
    return edits
