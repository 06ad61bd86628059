"""Records of sensor measurements and of the robot description."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float32, Float64, Int64, UInt8, UInt16


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One scan of a laser (sensor_msgs/LaserScan).

    Attributes
    ----------
    stamp_ns
        Time of the first beam; beam i was measured at ``stamp + i * time_increment``.
    frame_id
        Frame of the laser: x at bearing 0, y at bearing +pi/2.
    angle_min, angle_increment
        Bearing of the first beam and step between beams, rad; the step may be negative.
    time_increment
        Time between beams, s; negative where the last beam was measured first.
    range_min, range_max
        Limits of valid ranges, m.
    ranges
        float32 (N,), m; REP-117: +inf nothing seen, -inf too close, nan invalid.
    no_returns
        Number of beams whose driver-specific "no return" range near `range_max` was replaced by
        +inf in `ranges`.
    """

    stamp_ns: int
    frame_id: str
    angle_min: float
    angle_increment: float
    time_increment: float
    range_min: float
    range_max: float
    ranges: Float32
    no_returns: int = 0

    @property
    def end_ns(self) -> int:
        """Time of the last beam."""
        return self.stamp_ns + round(max(len(self.ranges) - 1, 0) * self.time_increment * 1e9)


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Joint positions at one time (sensor_msgs/JointState).

    Attributes
    ----------
    stamp_ns
        Stamp of the header.
    names
        Joint names.
    positions
        float64 (len(names),), rad or m, finite.
    """

    stamp_ns: int
    names: tuple[str, ...]
    positions: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """A pose of the base in the odometry frame (nav_msgs/Odometry).

    Attributes
    ----------
    stamp_ns
        Stamp of the header.
    frame_id, child_frame_id
        The odometry frame and the frame whose pose it is.
    T_odom_base
        float64 (4, 4), pose of the child frame in the odometry frame.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    T_odom_base: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """A measurement of a gyroscope and an accelerometer (sensor_msgs/Imu).

    Attributes
    ----------
    stamp_ns, frame_id
        Header.
    angular_velocity
        float64 (3,), rad/s, along the axes of the frame, finite.
    acceleration
        float64 (3,), along the axes of the frame, finite: the specific force, which at rest points
        up (9.8 m/s2). None if the IMU has no accelerometer.
    """

    stamp_ns: int
    frame_id: str
    angular_velocity: Float64
    acceleration: Float64 | None = None


class PoseCovariance(NamedTuple):
    """Covariance of the pose of an external localisation.

    Attributes
    ----------
    stamp_ns, frame_id
        Header of the pose.
    cov
        float64 (3, 3), positive definite, of (x, y, yaw) in the frame, m and rad.
    """

    stamp_ns: int
    frame_id: str
    cov: Float64


@dataclass(frozen=True, slots=True, eq=False)
class TransformSample:
    """One transform of tf (geometry_msgs/TransformStamped).

    Attributes
    ----------
    stamp_ns
        Stamp of the header.
    parent, child
        The two frame ids.
    T_parent_child
        float64 (4, 4), maps coordinates in child to parent.
    is_static
        Whether the transform holds at all times.
    """

    stamp_ns: int
    parent: str
    child: str
    T_parent_child: Float64
    is_static: bool


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """The robot's URDF (std_msgs/String on robot_description).

    Attributes
    ----------
    urdf
        The XML text.
    """

    urdf: str


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """Calibration of a camera (sensor_msgs/CameraInfo).

    Attributes
    ----------
    stamp_ns, frame_id
        Header; the frame is the optical one: x right, y down, z forward (REP-103).
    width, height
        Size of the whole image, without binning and region, pixels.
    model, D
        Name of the distortion model, and its coefficients float64 (N,).
    K
        float64 (3, 3), intrinsics of the whole image as it was taken.
    P
        float64 (3, 4), projection of the whole image after rectification.
    binning
        Pixels of the whole image along x and y in a pixel of the image, at least 1.
    region
        x and y of the first pixel, width and height of the region of interest, pixels of the whole
        image; all 0 for the whole image.
    """

    stamp_ns: int
    frame_id: str
    width: int
    height: int
    model: str
    D: Float64
    K: Float64
    P: Float64
    binning: tuple[int, int] = (1, 1)
    region: tuple[int, int, int, int] = (0, 0, 0, 0)

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the images, after region and binning, pixels."""
        width, height = self.region[2] or self.width, self.region[3] or self.height
        return width // self.binning[0], height // self.binning[1]

    def rectified(self) -> CameraInfo:
        """Return the calibration of the rectified images; the same where there is none (P is 0)."""
        if self.P[0, 0] <= 0.0 or self.P[1, 1] <= 0.0:
            return self
        return replace(self, K=np.ascontiguousarray(self.P[:, :3]), D=np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """A depth image (sensor_msgs/Image or CompressedImage) with its camera calibration.

    Attributes
    ----------
    stamp_ns
        Time of the image.
    frame_id
        Optical frame: x right, y down, z forward (REP-103).
    depth
        z of each pixel, (height, width): uint16 in mm, where 0 means no depth, or float32 in m,
        where values that are not finite and positive mean no depth.
    camera
        Camera calibration; None until it is known.
    is_rectified
        Whether the image is rectified; then P of the calibration applies.
    remark
        Remark on an unusual message; empty for a usual one.
    """

    stamp_ns: int
    frame_id: str
    depth: UInt16 | Float32
    camera: CameraInfo | None = None
    is_rectified: bool = False
    remark: str = ""

    @property
    def encoding(self) -> str:
        """Encoding name of the message for this dtype."""
        return "16UC1" if self.depth.dtype == np.uint16 else "32FC1"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        height, width = self.depth.shape
        return width, height


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """A picture (sensor_msgs/Image or CompressedImage) with its camera calibration.

    Attributes
    ----------
    stamp_ns
        Time of the picture.
    frame_id
        Optical frame: x right, y down, z forward (REP-103).
    encoding
        ``rgb8``, ``bgr8`` or ``mono8``; ``compressed`` where `data` is a JPEG or PNG file.
    size
        Width and height, pixels.
    data
        uint8 (N,): rows from the top without padding, or a JPEG or PNG file.
    camera
        Camera calibration; None until it is known.
    """

    stamp_ns: int
    frame_id: str
    encoding: str
    size: tuple[int, int]
    data: UInt8
    camera: CameraInfo | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """A point cloud of a sensor (sensor_msgs/PointCloud2).

    Attributes
    ----------
    stamp_ns, frame_id
        Header.
    points
        float32 (N, 3), m, in the frame; rows that are not finite are invalid points.
    since_ns
        int64 (N,), time of each point after the stamp, ns; None if all points have the stamp's.
    remark
        Remark on an unusual message; empty for a usual one.
    """

    stamp_ns: int
    frame_id: str
    points: Float32
    since_ns: Int64 | None = None
    remark: str = ""

    @property
    def time_span(self) -> tuple[int, int]:
        """Times of the first and the last point, ns."""
        if self.since_ns is None or not len(self.since_ns):
            return self.stamp_ns, self.stamp_ns
        return (
            self.stamp_ns + int(self.since_ns.min()),
            self.stamp_ns + int(self.since_ns.max()),
        )
