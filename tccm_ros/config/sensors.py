"""Parameters of the robot: names of frames, poses of the lasers, filters of beams."""

from __future__ import annotations

from typing import Literal

from tccm_ros.config.parameter import Group, param

Systematic = tuple[float, float, float, float]
Pose6 = tuple[float, float, float, float, float, float]


class FramesConfig(Group):
    """Names that are found from the data unless they are set (docs/design/frames_and_time.md)."""

    base: str = param("", "base frame; empty: child frame of the odometry", read_only=True)
    odom: str = param("odom", "odometry frame when there is no odometry", read_only=True)
    map: str = param("map", "map frame", read_only=True)
    tilt_joint: str = param(
        "", "tilting joint; empty: the moving joint nearest to the laser", read_only=True
    )
    prefix: str = param(
        "", "put before map and odom frame names, for several robots", read_only=True
    )

    @property
    def map_name(self) -> str:
        """Name of the map frame, with the prefix."""
        return self.prefix + self.map

    @property
    def odom_name(self) -> str:
        """Name of the odometry frame where nothing else names it, with the prefix."""
        return self.prefix + self.odom


class RigConfig(Group):
    """Poses of the lasers where there is no robot description, and corrections of a real rig."""

    kinematics: Literal["auto", "urdf", "tf", "rig"] = param(
        "auto", "source of laser poses: robot description, tf or this group", read_only=True
    )
    tilt_laser: Pose6 | None = param(
        None,
        "tilting laser in base at joint zero: x y z roll pitch yaw (m, rad); the joint turns about "
        "tilt_axis through tilt_center",
        unit="m, rad",
        read_only=True,
    )
    tilt_center: tuple[float, float, float] | None = param(
        None,
        "a point of the tilt axis in base; empty: the origin of the laser",
        unit="m",
        read_only=True,
    )
    tilt_axis: tuple[float, float, float] = param(
        (0.0, 1.0, 0.0), "tilt axis in base; +y tilts down with growing angle", read_only=True
    )
    level_laser: Pose6 | None = param(
        None, "level laser in base: x y z roll pitch yaw", unit="m, rad", read_only=True
    )
    tilt_offset: float = param(
        0.0, "added to the measured tilt angle", unit="rad", ge=-3.2, le=3.2, read_only=True
    )
    pan_offset: float = param(
        0.0,
        "added to the measured angle of the pan joint of a head, which is before the tilt joint",
        unit="rad",
        ge=-3.2,
        le=3.2,
        read_only=True,
    )
    tilt_scale: float = param(
        1.0, "multiplies the measured tilt angle before the offset", ge=0.5, le=2.0, read_only=True
    )
    joint_time_offset: float = param(
        0.0, "added to the stamps of the joint samples", unit="s", ge=-1.0, le=1.0, read_only=True
    )
    mount_correction: Pose6 = param(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "correction of the mount of the tilting laser, and of a camera that frames.tilt_joint "
        "tilts, x y z roll pitch yaw, applied in base before the chain: T_base_laser = "
        "T_correction * T_chain",
        unit="m, rad",
        read_only=True,
    )
    level_correction: Pose6 = param(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "correction of the level laser's pose, as mount_correction",
        unit="m, rad",
        read_only=True,
    )


class ScanFilterConfig(Group):
    """Filters of ranges and points of scans."""

    shadow_angle: float = param(
        0.14,
        "a beam whose line to its neighbour's hit is within this angle of the beam is a mixed "
        "pixel and is dropped, unless it is in line with its neighbours, or (of a tilting laser) "
        "the last of a line before a step away; 0 disables the filter",
        unit="rad",
        ge=0.0,
        le=1.0,
    )
    shadow_jump: float = param(
        0.03,
        "smaller steps in range between neighbours are noise, not mixed pixels",
        unit="m",
        ge=0.0,
        le=1.0,
    )
    min_range: float = param(0.0, "ranges below this are dropped", unit="m", ge=0.0)
    max_range: float = param(30.0, "ranges above this are dropped", unit="m", gt=0.0)
    reverse: bool = param(
        False,
        "the beams of the level laser were measured from the last to the first",
        read_only=True,
    )
    time_offset: float = param(
        0.0,
        "added to the stamps of the level laser; negative where its driver stamps too late",
        unit="s",
        ge=-1.0,
        le=1.0,
        read_only=True,
    )
    self_filter: bool = param(
        True, "drop points inside the robot's own collision boxes, spheres and cylinders"
    )
    self_padding: float = param(0.02, "margin around the robot's links", unit="m", ge=0.0, le=0.5)


class SensorsConfig(Group):
    """Sensors whose points are mapped, and detectors: topics, noise, and the level scan."""

    depth_images: tuple[str, ...] = param(
        ("depth/image_rect_raw",),
        "topics of depth images, each with camera_info beside it; images that are compressed end "
        "in compressedDepth",
        read_only=True,
    )
    point_clouds: tuple[str, ...] = param(
        ("points",), "topics of the point clouds of lidars and cameras", read_only=True
    )
    camera_images: tuple[str, ...] = param(
        ("camera/image_raw",),
        "topics of pictures that are searched for door signs, each with camera_info beside it; "
        "topics of compressed pictures end in compressed",
        read_only=True,
    )
    tilt_scans: tuple[str, ...] = param(
        ("tilt_scan",),
        "topics of tilting lasers; the first that is there gives the tilt cycles",
        read_only=True,
    )
    detections: tuple[str, ...] = param(
        ("detections",),
        "topics of vision_msgs/Detection3DArray, one for each detector: they give the objects on "
        "surfaces their labels",
        read_only=True,
    )
    depth_sigma: tuple[float, float, float] = param(
        (0.0012, 0.0019, 0.4),
        "noise of a depth z: a + b (z - c)^2 with a (m), b (1/m) and c (m); the default is that of "
        "a structured-light camera",
        unit="m",
    )
    depth_systematic: Systematic = param(
        (0.002, 0.003, 0.001, 0.005),
        "standard deviations of the common error of the depths of an image: an offset (m), a "
        "scale (1) and a bend (1/m), for an error offset + scale z + bend z^2, and the camera's "
        "direction (rad)",
    )
    laser_systematic: Systematic = param(
        (0.005, 0.0, 0.0, 0.002),
        "systematic errors of a tilting laser's ranges in a tilt cycle, as `depth_systematic`",
    )
    cloud_systematic: Systematic = param(
        (0.005, 0.0, 0.0, 0.002), "the same of the ranges of a point cloud"
    )
    max_sigma: float = param(
        0.012, "depths with more noise than this are not mapped", unit="m", gt=0.0, le=1.0
    )
    level_from: Literal["none", "points", "depth"] = param(
        "none",
        "points, depth: without a level laser, a level scan is made from the point clouds or the "
        "depth images",
        read_only=True,
    )
    level_band: tuple[float, float] = param(
        (0.1, 1.8), "heights over the base that the level scan is made from", unit="m"
    )
