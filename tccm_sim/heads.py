"""Robots with a depth camera on a pan-tilt head: names, axes and offsets of their published URDFs.

Joints of lifts are fixed. Bodies are boxes of about the robot's size; Fetch and TIAGo hold an arm
in the view of their camera.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import ConfigError, suggest
from tccm_sim.cameras import DepthCamera
from tccm_sim.colour_camera import ColourCamera
from tccm_sim.joints import Profile, oscillation
from tccm_sim.lasers import Laser
from tccm_sim.lidars import SpinningLidar
from tccm_sim.rigs import Body, Joint, Rig, Topics
from tccm_sim.robots import SMALL_270, UTM_30LX, wheel_joints

_Y, _Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

LIMITS, PAN = (0.35, 0.75), (-0.6, 0.6)
"""Tilt (down) and pan ranges of a head that looks around, rad. Chosen."""

OPTICAL = (-pi / 2, 0.0, -pi / 2)
"""Roll, pitch, yaw of an optical frame (z forward, y down) in a body frame (REP-103)."""

# A structured-light camera such as the Xtion at half its resolution: its own 580 px and 75 mm
# give the disparity; 58 degrees wide.
XTION = DepthCamera(
    width=320, height=240, focal=285.0, period=0.5, range_min=0.45, range_max=5.0,
    disparity_scale=43.5, disparity_sigma=0.05, disparity_step=0.125,
    flying=0.3, grazing=0.09, lost=0.005,
)  # fmt: skip

# A stereo camera such as the D435i at a reduced resolution: 87 degrees wide, 50 mm baseline.
D435 = DepthCamera(
    width=320, height=180, focal=168.0, period=0.5, range_min=0.28, range_max=4.0,
    disparity_scale=21.0, disparity_sigma=0.03, disparity_step=0.03125,
    flying=0.5, grazing=0.09, lost=0.01,
)  # fmt: skip

# A colour camera of 60 degrees, at a reduced resolution.
COLOUR = ColourCamera(
    width=512, height=384, focal=443.0, period=0.5, sigma=1.5, quality=70
)  # fmt: skip

# A lidar such as the VLP-16, turning at 5 Hz: 16 rings over 30 degrees.
VLP_16 = SpinningLidar(
    Laser(
        beams=900, angle_min=pi, angle_max=-pi + 2 * pi / 900, period=0.2,
        time_increment=0.2 / 900, range_min=0.5, range_max=40.0, sigma=0.008, quantum=0.002,
        lost=0.01,
    ),
    tuple(np.radians(np.arange(-15.0, 16.0, 2.0)).tolist()),
)  # fmt: skip

# SICK TiM571: 220 of its 270 degrees are used on Fetch.
TIM571 = Laser(
    beams=661, angle_min=-radians(110), angle_max=radians(110), period=1 / 15,
    time_increment=1 / 15 * 220 / 360 / 660, range_min=0.05, range_max=25.0,
    sigma=0.010, quantum=0.001, divergence=radians(0.5), mixed=0.3, lost=0.002,
)  # fmt: skip


def _optical(name: str, parent: str, child: str) -> Joint:
    return Joint(name, parent, child, (0.0, 0.0, 0.0), OPTICAL)


# fetch_ros, fetch_description/robots/fetch.urdf. The level laser hangs upside down.
FETCH = Rig(
    name="fetch",
    base="base_link",
    joints=(
        *wheel_joints("base_link", ("l_wheel_joint", "r_wheel_joint"), 0.0553, 0.3748, 0.0),
        Joint("laser_joint", "base_link", "laser_link", (0.235, 0.0, 0.2878), (pi, 0.0, 0.0)),
        Joint("torso_lift_joint", "base_link", "torso_lift_link", (-0.086875, 0.0, 0.67743)),
        Joint("shoulder_pan_joint", "torso_lift_link", "shoulder_pan_link", (0.1195, 0, 0.3486)),
        Joint("head_pan_joint", "torso_lift_link", "head_pan_link", (0.053125, 0, 0.6030), axis=_Z),
        Joint("head_tilt_joint", "head_pan_link", "head_tilt_link", (0.14253, 0, 0.058), axis=_Y),
        Joint("head_camera_joint", "head_tilt_link", "head_camera_link", (0.055, 0.0, 0.0225)),
        Joint("head_camera_depth_joint", "head_camera_link", "head_camera_depth_frame",
              (0.0, 0.045, 0.0)),
        _optical("head_camera_depth_optical_joint", "head_camera_depth_frame",
                 "head_camera_depth_optical_frame"),
    ),
    bodies=(
        Body("base_link", (0.50, 0.50, 0.22), (0.0, 0.0, 0.16)),
        Body("torso_lift_link", (0.20, 0.30, 0.50), (0.0, 0.0, 0.25)),
        Body("shoulder_pan_link", (0.50, 0.09, 0.09), (0.35, -0.22, -0.12)),
    ),
    tilt_joint="head_tilt_joint",
    pan_joint="head_pan_joint",
    level=TIM571,
    level_frame="laser_link",
    camera=XTION,
    camera_frame="head_camera_depth_optical_frame",
    wheels=("l_wheel_joint", "r_wheel_joint"),
    wheel_radius=0.0553,
    wheel_distance=0.3748,
    topics=Topics(scan="/base_scan", depth="/head_camera/depth/image_raw"),
)  # fmt: skip

# tiago_robot, tiago_description/urdf/head/head.urdf.xacro and sensors/xtion_pro_live.urdf.xacro;
# topics of a TIAGo of ROS 2 whose camera is named head_front_camera.
TIAGO = Rig(
    name="tiago",
    base="base_footprint",
    joints=(
        Joint("base_footprint_joint", "base_footprint", "base_link", (0.0, 0.0, 0.0985)),
        *wheel_joints("base_link", ("wheel_left_joint", "wheel_right_joint"), 0.0985, 0.4044,
                      0.0985),
        Joint("base_laser_joint", "base_link", "base_laser_link", (0.202, 0.0, -0.004)),
        Joint("torso_lift_joint", "base_link", "torso_lift_link", (-0.062, 0.0, 0.94)),
        Joint("arm_1_joint", "torso_lift_link", "arm_1_link", (0.1256, -0.0195, -0.0311)),
        Joint("head_1_joint", "torso_lift_link", "head_1_link", (0.1874, 0, 0.0325), axis=_Z),
        Joint("head_2_joint", "head_1_link", "head_2_link", (0.0038, 0.0, 0.0596),
              (pi / 2, 0.0, 0.0), _Z),
        Joint("head_front_camera_joint", "head_2_link", "head_front_camera_link",
              (0.07, 0.0633, 0.0), (-pi / 2, 0.0, 0.0)),
        _optical("head_front_camera_depth_optical_joint", "head_front_camera_link",
                 "head_front_camera_depth_optical_frame"),
    ),
    bodies=(
        Body("base_link", (0.50, 0.50, 0.20), (0.0, 0.0, 0.115)),
        Body("torso_lift_link", (0.18, 0.26, 0.80), (-0.03, 0.0, -0.42)),
        Body("arm_1_link", (0.50, 0.09, 0.09), (0.35, -0.22, -0.30)),
    ),
    tilt_joint="head_2_joint",
    pan_joint="head_1_joint",
    level=replace(SMALL_270, range_max=20.0),
    level_frame="base_laser_link",
    camera=XTION,
    camera_frame="head_front_camera_depth_optical_frame",
    wheels=("wheel_left_joint", "wheel_right_joint"),
    wheel_radius=0.0985,
    wheel_distance=0.4044,
    topics=Topics(
        scan="/scan_raw", odom="/mobile_base_controller/odom",
        depth="/head_front_camera/depth/image_raw",
    ),
)  # fmt: skip

# hsr_description, urdf/head_v2/head.urdf.xacro: the link of the sensor is itself the optical frame.
HSR = Rig(
    name="hsrb",
    base="base_footprint",
    joints=(
        Joint("base_link_joint", "base_footprint", "base_link", (0.0, 0.0, 0.0)),
        *wheel_joints("base_link", ("base_l_drive_wheel_joint", "base_r_drive_wheel_joint"), 0.04,
                      0.266, 0.0),
        Joint("base_range_sensor_joint", "base_link", "base_range_sensor_link", (0.18, 0, 0.15)),
        Joint("torso_lift_joint", "base_link", "torso_lift_link", (0.0, 0.0, 0.752)),
        Joint("head_pan_joint", "torso_lift_link", "head_pan_link", (0.0, 0.0, 0.3), axis=_Z),
        Joint("head_tilt_joint", "head_pan_link", "head_tilt_link", (0.02, 0.0, 0.0),
              axis=(0.0, -1.0, 0.0)),
        Joint("head_rgbd_sensor_joint", "head_tilt_link", "head_rgbd_sensor_link",
              (-0.0798, 0.022, 0.2152), OPTICAL),
    ),
    bodies=(
        Body("base_link", (0.34, 0.38, 0.10), (0.0, 0.0, 0.06)),
        Body("torso_lift_link", (0.20, 0.24, 0.50), (-0.05, 0.0, -0.1)),
    ),
    tilt_joint="head_tilt_joint",
    pan_joint="head_pan_joint",
    level=UTM_30LX,
    level_frame="base_range_sensor_link",
    camera=XTION,
    camera_frame="head_rgbd_sensor_link",
    wheels=("base_l_drive_wheel_joint", "base_r_drive_wheel_joint"),
    wheel_radius=0.04,
    wheel_distance=0.266,
    topics=Topics(
        scan="/base_scan", odom="/odom",
        depth="/head_rgbd_sensor/depth_registered/image_rect_raw",
    ),
)  # fmt: skip

# stretch_ros2, stretch_description/urdf/stretch_main.xacro and stretch_d435i.xacro: the camera is
# mounted sideways, and the mast is slightly askew.
STRETCH = Rig(
    name="stretch",
    base="base_link",
    joints=(
        *wheel_joints("base_link", ("joint_left_wheel", "joint_right_wheel"), 0.0508, 0.3153, 0.0),
        Joint("joint_laser", "base_link", "laser", (0.004, 0.0, 0.1664), (0.0, 0.0, pi)),
        Joint("joint_mast", "base_link", "link_mast", (-0.07, 0.135, 0.0284),
              (pi / 2, 0.0, 0.009253)),
        Joint("joint_head", "link_mast", "link_head", (0.0, 1.33, 0.0), (pi / 2, -1.5615, pi)),
        Joint("joint_head_pan", "link_head", "link_head_pan", (0.135, 0.0731, -0.003),
              (0.0, 0.0, pi / 2), _Z),
        Joint("joint_head_tilt", "link_head_pan", "link_head_tilt", (-0.0013, 0.0275, -0.0533),
              (pi / 2, 0.0, 0.0), _Z),
        Joint("camera_joint", "link_head_tilt", "camera_link", (0.0406, -0.0122, 0.0357)),
        _optical("camera_depth_optical_joint", "camera_link", "camera_depth_optical_frame"),
    ),
    bodies=(
        Body("base_link", (0.30, 0.33, 0.12), (-0.10, 0.0, 0.09)),
        Body("base_link", (0.07, 0.07, 1.10), (-0.07, 0.135, 0.70)),
    ),
    tilt_joint="joint_head_tilt",
    pan_joint="joint_head_pan",
    level=replace(SMALL_270, range_max=12.0),
    level_frame="laser",
    camera=D435,
    camera_frame="camera_depth_optical_frame",
    wheels=("joint_left_wheel", "joint_right_wheel"),
    wheel_radius=0.0508,
    wheel_distance=0.3153,
    topics=Topics(joint_states="/stretch/joint_states", depth="/camera/depth/image_rect_raw"),
)  # fmt: skip

ROBOTS = {rig.name: rig for rig in (FETCH, HSR, STRETCH, TIAGO)}
"""The robots by name."""


def robot(name: str) -> Rig:
    """Return the robot with a name.

    Raises
    ------
    ConfigError
        If there is no robot of that name.
    """
    if name not in ROBOTS:
        raise ConfigError(f"no robot '{name}'{suggest(name, ROBOTS)}")
    return ROBOTS[name]


def tilt_sign(rig: Rig) -> float:
    """Return 1.0 if a positive tilt turns the head's camera down, and -1.0 if up."""
    tilts = {rig.tilt_joint: np.array([-0.1, 0.1])}
    up, down = rig.laser_poses(rig.camera_frame, tilts, 2)[:, 2, 2]
    return 1.0 if down < up else -1.0


def look_around(
    rig: Rig, windows: Float64, period: float, limits: tuple[float, float] | None = None
) -> dict[str, Profile]:
    """Return the moves of a head that looks around: one nod and two pans per period.

    Parameters
    ----------
    rig
        A robot with a head.
    windows
        float64 (W, 2), start and end of the times of looking around, s.
    period
        Period, s.
    limits
        Tilt at both ends, rad, down; None for `LIMITS`.
    """
    low, high = limits or LIMITS
    sign = tilt_sign(rig)
    return {
        rig.tilt_joint: oscillation(windows, period, (sign * low, sign * high)),
        rig.pan_joint: oscillation(windows, period / 2.0, PAN, ramp=0.3),
    }


def with_depth_camera(rig: Rig) -> Rig:
    """Return a rig with a depth camera fixed to its base, looking ahead and down."""
    joints = (
        Joint("depth_camera_joint", rig.base, "depth_camera",
              (0.16, 0.0, 1.12 - rig.base_height), (0.0, 0.6, 0.0)),
        _optical("depth_camera_optical_joint", "depth_camera", "depth_camera_optical"),
    )  # fmt: skip
    return replace(
        rig, joints=rig.joints + joints, camera=XTION, camera_frame="depth_camera_optical"
    )


def with_colour_camera(rig: Rig) -> Rig:
    """Return a rig with a colour camera on a mast, looking ahead and to the left."""
    joints = (
        Joint("camera_joint", rig.base, "camera",
              (0.05, 0.10, 1.40 - rig.base_height), (0.0, 0.0, radians(60.0))),
        _optical("camera_optical_joint", "camera", "camera_optical"),
    )  # fmt: skip
    return replace(
        rig, joints=rig.joints + joints, colour_camera=COLOUR, colour_frame="camera_optical"
    )


def with_lidar(rig: Rig) -> Rig:
    """Return a rig with a spinning lidar on a mast, pitched forward."""
    joint = Joint("lidar_joint", rig.base, "lidar", (0.0, 0.0, 1.6 - rig.base_height), (0, 0.45, 0))
    return replace(rig, joints=(*rig.joints, joint), lidar=VLP_16, lidar_frame="lidar")
