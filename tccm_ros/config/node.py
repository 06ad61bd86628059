"""Parameters of running nodes alone: QoS, tf, saving and markers. No result depends on them."""

from __future__ import annotations

from typing import Literal

from tccm_ros.config.parameter import Group, param


class QosConfig(Group):
    """Quality of service of the sensor subscriptions."""

    reliability: Literal["best_effort", "reliable"] = param(
        "best_effort", "required reliability of scan publishers", read_only=True
    )
    stamp: Literal["header", "receive"] = param(
        "header", "receive: stamps of arrival, for drivers without a clock", read_only=True
    )
    silence: float = param(
        5.0,
        "an input that is silent this long is reported",
        unit="s",
        gt=0.0,
        le=3600.0,
        read_only=True,
    )


class TfConfig(Group):
    """The transform map -> odom, and the frames of surfaces."""

    publish: bool = param(
        True, "publish map -> odom on /tf where tf2_msgs is installed", read_only=True
    )
    rate: float = param(20.0, "rate at which map -> odom is published", unit="Hz", gt=0.0, le=200.0)
    transform_tolerance: float = param(
        0.1, "map -> odom is stamped this much after the newest scan", unit="s", ge=0.0, le=10.0
    )
    surfaces: bool = param(
        False,
        "publish a frame surface_<id> for each surface but the floor, with map -> odom: origin in "
        "its middle, z along its normal, x along its longer edge",
    )


class SaveConfig(Group):
    """Saving of maps by a live node."""

    directory: str = param("tccm_map", "folder that ~/save_map writes and ~/load_map reads")
    on_shutdown: bool = param(False, "save when the node is stopped")
    autosave_minutes: float = param(
        0.0, "save this often; 0 never", unit="min", ge=0.0, le=1440.0, read_only=True
    )


class ScanHereConfig(Group):
    """The action ~/scan_here: how the tilt joint, `frames.tilt_joint`, is moved for a view."""

    controller: str = param(
        "head_controller/follow_joint_trajectory",
        "action of the controller of the joints, control_msgs/FollowJointTrajectory",
        read_only=True,
    )
    pan_joint: str = param("", "joint that pans; empty: none, or it is not moved", read_only=True)
    tilt_range: tuple[float, float] = param(
        (0.0, 0.9), "lowest and highest angle of the tilt joint", unit="rad"
    )
    velocity: float = param(0.3, "max speed of the joints", unit="rad/s", gt=0.0, le=10.0)


class MarkersConfig(Group):
    """Content of the markers."""

    cuboid_color: Literal["height", "age"] = param("height", "what the color of a cuboid shows")
