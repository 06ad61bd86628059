"""Small robots and their records, for tests."""

import numpy as np

from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan, TransformSample

MS = 1_000_000
START = 1_700_000_000_000_000_000


def joint(name, kind, parent, child, xyz="0 0 0", rpy="0 0 0", axis="0 1 0", more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit lower="-10" upper="10" effort="1" velocity="1"/>{more}</joint>'
    )


def robot(joints, bodies=None, extra_links=()):
    """Return a URDF of joint texts; `bodies` maps links to their inner XML."""
    links = list(extra_links)
    for text in joints:
        for end in ("parent", "child"):
            name = text.split(f'<{end} link="')[1].split('"')[0]
            if name not in links:
                links.append(name)
    bodies = bodies or {}
    return (
        '<robot name="r">'
        + "".join(f'<link name="{name}">{bodies.get(name, "")}</link>' for name in links)
        + "".join(joints)
        + "</robot>"
    )


TILTING = robot(
    [
        joint("mount", "fixed", "base", "head", xyz="0.1 0 1.0"),
        joint("tilt", "revolute", "head", "cradle"),
        joint("laser_mount", "fixed", "cradle", "laser", xyz="0.05 0 0.02"),
        joint("front", "fixed", "base", "front_laser", xyz="0.2 0 0.3"),
    ]
)
"""A laser 5 cm ahead of and 2 cm above a tilt axis 1 m above the base; +angle tilts it down."""


def description(text=TILTING):
    return RobotDescription(text)


def joints_at(stamp_ns, **positions):
    return JointSample(stamp_ns, tuple(positions), np.array(list(positions.values()), float))


def odometry_at(stamp_ns, xyz_rpy=(0, 0, 0, 0, 0, 0), child="base", frame="odom"):
    return Odometry(stamp_ns, frame, child, pose_from_rpy(xyz_rpy))


def transform_at(stamp_ns, parent, child, xyz_rpy=(0, 0, 0, 0, 0, 0), is_static=False):
    return TransformSample(stamp_ns, parent, child, pose_from_rpy(xyz_rpy), is_static)


def scan_at(stamp_ns, frame="laser", ranges=(1.0, 1.0, 1.0), time_increment=0.0, **fields):
    values = {"angle_min": -0.1, "angle_increment": 0.1, "range_min": 0.05, "range_max": 30.0}
    values.update(fields)
    return Scan(
        stamp_ns=stamp_ns,
        frame_id=frame,
        time_increment=time_increment,
        ranges=np.array(ranges, np.float32),
        **values,
    )
