"""Robots with a tilting laser: joints, lasers, names and odometry errors."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians

from tccm_sim.lasers import Laser
from tccm_sim.rigs import Body, Joint, Rig, Topics

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

# SICK LMS 291 at 0.5 deg over 180 deg: a revolution of the mirror takes 13.3 ms, of which half is
# measured; the beam divergence is 0.7 deg.
LMS_291 = Laser(
    beams=361, angle_min=-pi / 2, angle_max=pi / 2, period=0.080,
    time_increment=0.01333 / 2 / 360, range_min=0.05, range_max=30.0,
    sigma=0.008, quantum=0.01, divergence=radians(0.35), mixed=0.3, lost=0.002,
)  # fmt: skip

# Hokuyo UBG-04LX-F01: 240 deg in 569 beams, a revolution takes 28 ms.
UBG_04LX_F01 = Laser(
    beams=569, angle_min=-radians(120), angle_max=radians(120), period=0.028,
    time_increment=0.028 * 240 / 360 / 568, range_min=0.06, range_max=5.6,
    sigma=0.0025, quantum=0.001, divergence=radians(0.2), mixed=0.5, lost=0.002, invalid=0.001,
)  # fmt: skip

# Hokuyo UTM-30LX: 270 deg in 1081 beams, a revolution takes 25 ms.
UTM_30LX = Laser(
    beams=1081, angle_min=-radians(135), angle_max=radians(135), period=0.025,
    time_increment=0.025 * 270 / 360 / 1080, range_min=0.1, range_max=30.0,
    sigma=0.006, quantum=0.001, divergence=radians(0.12), mixed=0.5, lost=0.002, invalid=0.001,
)  # fmt: skip

# A small 270 degree laser at 0.5 deg and 25 Hz.
SMALL_270 = Laser(
    beams=541, angle_min=-radians(135), angle_max=radians(135), period=0.040,
    time_increment=0.040 * 270 / 360 / 540, range_min=0.05, range_max=10.0,
    sigma=0.006, quantum=0.001, divergence=radians(0.15), mixed=0.5, lost=0.003, invalid=0.002,
)  # fmt: skip


def wheel_joints(
    base: str, names: tuple[str, str], radius: float, distance: float, height: float
) -> tuple[Joint, ...]:
    """Return the joints of two wheels with their axle above the base's origin.

    Parameters
    ----------
    base
        Names of the left and the right joint.
    names
        Radius of the wheels, and distance between them, m.
    radius, distance
        Height of the base frame above the floor, m.
    height
        Height of the base frame above the floor, m.
    """
    z = radius - height
    return tuple(
        Joint(name, base, name.replace("_joint", ""), (0.0, side * distance / 2, z), axis=_Y)
        for name, side in zip(names, (1.0, -1.0))
    )


HUMANOID = Rig(
    name="humanoid",
    base="base_footprint",
    joints=(
        Joint("base_joint", "base_footprint", "base_link", (0.0, 0.0, 0.30)),
        *wheel_joints("base_link", ("wheel_left_joint", "wheel_right_joint"), 0.10, 0.44, 0.30),
        Joint("base_laser_joint", "base_link", "base_laser", (0.24, 0.0, -0.02)),
        Joint("waist_joint", "base_link", "torso", (-0.02, 0.0, 0.55), axis=_Z),
        Joint("neck_yaw_joint", "torso", "neck_yaw", (0.02, 0.0, 0.45), axis=_Z),
        Joint("neck_pitch_joint", "neck_yaw", "neck_pitch", (0.0, 0.0, 0.06), axis=_Y),
        Joint("neck_roll_joint", "neck_pitch", "head", (0.0, 0.0, 0.04), axis=_X),
        Joint("laser_tilt_joint", "head", "tilt_plate", (0.0, 0.0, 0.12), axis=_Y),
        Joint("tilt_laser_joint", "tilt_plate", "tilt_laser", (0.03, 0.0, 0.02)),
    ),
    bodies=(
        Body("base_link", (0.40, 0.40, 0.40), (0.0, 0.0, 0.0)),
        Body("torso", (0.20, 0.36, 0.50), (-0.04, 0.0, 0.10)),
        Body("head", (0.14, 0.18, 0.10), (-0.06, 0.0, 0.02)),
    ),
    tilt=UBG_04LX_F01,
    tilt_frame="tilt_laser",
    tilt_joint="laser_tilt_joint",
    level=LMS_291,
    level_frame="base_laser",
    wheels=("wheel_left_joint", "wheel_right_joint"),
    wheel_radius=0.10,
    wheel_distance=0.44,
)
"""The robot of the TCCM paper: tilt axis at 1.52 m, over a waist and a neck of three joints."""

SEGWAY = Rig(
    name="segway",
    base="base_link",
    joints=(
        *wheel_joints("base_link", ("left_wheel_joint", "right_wheel_joint"), 0.24, 0.54, 0.0),
        Joint("lms_joint", "base_link", "lms", (0.28, 0.0, 0.34)),
        Joint("ptu_mount_joint", "base_link", "ptu_base", (0.12, 0.0, 1.24)),
        Joint("ptu_pan_joint", "ptu_base", "ptu_pan", (0.0, 0.0, 0.05), axis=_Z),
        Joint("ptu_tilt_joint", "ptu_pan", "ptu_tilt", (0.0, 0.0, 0.046), axis=_Y),
        Joint("utm_joint", "ptu_tilt", "utm", (0.012, 0.0, 0.064)),
    ),
    bodies=(
        Body("base_link", (0.50, 0.48, 0.40), (0.0, 0.0, 0.26)),
        Body("base_link", (0.12, 0.30, 0.76), (0.04, 0.0, 0.84)),
        Body("base_link", (0.06, 0.10, 0.60), (0.36, 0.0, 0.80)),
    ),
    tilt=UTM_30LX,
    tilt_frame="utm",
    tilt_joint="ptu_tilt_joint",
    level=LMS_291,
    level_frame="lms",
    wheels=("left_wheel_joint", "right_wheel_joint"),
    wheel_radius=0.24,
    wheel_distance=0.54,
    encoder=2.2e-4,
)
"""The robot of the surface mapping paper: LMS 291, and a UTM-30LX on a pan-tilt unit.

The vertical actuator of its gripper, in front, is in the view of the tilting laser.
"""

HUMANOID_WITH_ARM = replace(
    HUMANOID,
    joints=(
        *HUMANOID.joints,
        Joint("arm_1_joint", "torso", "arm_1", (0.02, -0.24, 0.35), axis=_Y),
        Joint("arm_2_joint", "arm_1", "arm_2", (0.0, 0.0, 0.0), axis=_Z),
        Joint("arm_3_joint", "arm_2", "arm_3", (0.0, 0.0, 0.0), axis=_X),
        Joint("arm_4_joint", "arm_3", "arm_4", (0.30, 0.0, 0.0), axis=_Y),
        Joint("arm_5_joint", "arm_4", "arm_5", (0.0, 0.0, 0.0), axis=_X),
        Joint("arm_6_joint", "arm_5", "arm_6", (0.26, 0.0, 0.0), axis=_Y),
        Joint("arm_7_joint", "arm_6", "arm_7", (0.0, 0.0, 0.0), axis=_X),
    ),
    bodies=(
        *HUMANOID.bodies,
        Body("arm_3", (0.30, 0.09, 0.09), (0.15, 0.0, 0.0)),
        Body("arm_5", (0.26, 0.07, 0.07), (0.13, 0.0, 0.0)),
        Body("arm_7", (0.14, 0.09, 0.04), (0.07, 0.0, 0.0)),
    ),
)
"""The robot of the TCCM paper with an arm of seven joints, stretched forward at zero."""

SEGWAY_WITH_GRIPPER = replace(
    SEGWAY,
    joints=(
        *SEGWAY.joints,
        Joint(
            "gripper_lift_joint", "base_link", "gripper", (0.40, 0.0, 0.55), axis=_Z, slides=True
        ),
    ),
    bodies=(*SEGWAY.bodies, Body("gripper", (0.22, 0.16, 0.06), (0.12, 0.0, 0.0))),
)
"""The robot of the surface mapping paper with its gripper, moved by the vertical actuator."""

UPSIDE_DOWN = Rig(
    name="gantry",
    base="chassis",
    base_height=0.12,
    joints=(
        *wheel_joints("chassis", ("wheel_l", "wheel_r"), 0.12, 0.40, 0.12),
        Joint("front_lidar_mount", "chassis", "front_lidar", (0.21, 0.03, 0.14)),
        Joint("gantry_mount", "chassis", "gantry", (0.10, -0.02, 1.30)),
        Joint("nod_joint", "gantry", "nod_plate", (0.06, 0.0, -0.05), axis=(0.0, -1.0, 0.0)),
        Joint("nod_lidar_mount", "nod_plate", "nod_lidar", (0.03, 0.01, -0.07), (pi, 0.0, 0.0)),
    ),
    bodies=(
        Body("chassis", (0.44, 0.36, 0.20), (0.0, 0.0, 0.02)),
        Body("gantry", (0.06, 0.06, 1.18), (-0.08, 0.0, -0.59)),
    ),
    tilt=SMALL_270,
    tilt_frame="nod_lidar",
    tilt_joint="nod_joint",
    level=replace(SMALL_270, range_max=20.0),
    level_frame="front_lidar",
    wheels=("wheel_l", "wheel_r"),
    wheel_radius=0.12,
    wheel_distance=0.40,
    encoder=5e-4,
    topics=Topics("/nod_lidar/scan", "/front_lidar/scan", "/dynamixel/joint_states", "/wheel_odom"),
    odom_frame="wheel_odom",
    odom_start=(2.0, -1.0, 0.7),
)
"""Another robot, with its tilting laser upside down and an inverted tilt joint."""
