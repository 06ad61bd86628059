"""Model of a robot: joints, bodies, lasers, names, and its robot description (URDF)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_sim.cameras import DepthCamera
from tccm_sim.colour_camera import ColourCamera
from tccm_sim.imu import ImuModel
from tccm_sim.lasers import Laser
from tccm_sim.lidars import SpinningLidar
from tccm_sim.motion import OdometryErrors
from tccm_sim.rigid import chain_poses, rigid

Vector = tuple[float, float, float]

USUAL_ERRORS = OdometryErrors()


@dataclass(frozen=True)
class Joint:
    """A joint as in URDF.

    Attributes
    ----------
    name, parent, child
        Names of the joint and of its links.
    xyz, rpy
        Pose of the child in the parent at position zero, m and rad.
    axis
        Unit axis of motion in the child's frame; zero for a fixed joint.
    slides
        Whether it moves along the axis instead of rotating about it.
    """

    name: str
    parent: str
    child: str
    xyz: Vector
    rpy: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 0.0)
    slides: bool = False

    @property
    def moves(self) -> bool:
        """Whether it rotates or slides."""
        return self.axis != (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Body:
    """A box of a link.

    Attributes
    ----------
    link
        Name of the link.
    size, center
        Edge lengths and centre in the link's frame, m.
    """

    link: str
    size: Vector
    center: Vector


@dataclass(frozen=True)
class Topics:
    """Names of the topics of a robot.

    Attributes
    ----------
    tilt_scan, scan
        Scans of the tilting and of the level laser.
    joint_states, odom, imu
        Joint samples, wheel odometry, and gyroscope rates.
    depth, points
        Depth images, with ``camera_info`` beside them, and points of a lidar.
    colour
        Pictures of a colour camera, with ``camera_info`` beside them.
    """

    tilt_scan: str = "/tilt_scan"
    scan: str = "/scan"
    joint_states: str = "/joint_states"
    odom: str = "/odom"
    imu: str = "/imu"
    depth: str = "/depth/image_rect_raw"
    points: str = "/points"
    colour: str = "/camera/image_raw"

    @property
    def camera_info(self) -> str:
        """Calibration of the depth camera."""
        return self.depth.rsplit("/", 1)[0] + "/camera_info"

    @property
    def colour_info(self) -> str:
        """Calibration of the colour camera."""
        return self.colour.rsplit("/", 1)[0] + "/camera_info"


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A robot.

    Attributes
    ----------
    base, base_height
        Base frame, and the height of its origin above the floor, m.
    joints
        All joints, parents first.
    tilt, tilt_frame
        The tilting laser, if there is one, and its frame.
    tilt_joint, pan_joint
        Joint that tilts it, or a head with a depth camera, and the head's pan joint.
    level, level_frame
        The level laser and its frame.
    camera, camera_frame
        A depth camera, if there is one, and its optical frame.
    colour_camera, colour_frame
        A colour camera, if there is one, and its optical frame.
    lidar, lidar_frame
        A spinning lidar, if there is one, and its frame.
    imu
        An IMU in the base, if there is one.
    wheels
        Joints of the left and the right wheel.
    wheel_radius, wheel_distance
        Radius and distance of the wheels, m.
    encoder
        Resolution of the joints' encoders, rad (m for a sliding joint).
    odom_frame, odom_start
        Odometry frame, and the first pose in it (x, y, yaw), m and rad.
    """

    name: str
    base: str
    base_height: float = 0.0
    joints: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    tilt: Laser | None = None
    tilt_frame: str = ""
    tilt_joint: str
    level: Laser
    level_frame: str
    wheels: tuple[str, str]
    wheel_radius: float
    wheel_distance: float
    encoder: float = 2e-4
    topics: Topics = Topics()
    odom_frame: str = "odom"
    odom_start: Vector = (0.0, 0.0, 0.0)
    errors: OdometryErrors = USUAL_ERRORS
    pan_joint: str = ""
    camera: DepthCamera | None = None
    camera_frame: str = ""
    colour_camera: ColourCamera | None = None
    colour_frame: str = ""
    lidar: SpinningLidar | None = None
    lidar_frame: str = ""
    imu: ImuModel | None = None

    @cached_property
    def moving(self) -> tuple[str, ...]:
        """Names of the moving joints, without the wheels."""
        return tuple(j.name for j in self.joints if j.moves and j.name not in self.wheels)

    def chain(self, frame: str) -> tuple[Joint, ...]:
        """Return the joints from the base to a frame."""
        parents = {joint.child: joint for joint in self.joints}
        chain: list[Joint] = []
        while frame != self.base:
            chain.insert(0, parents[frame])
            frame = parents[frame].parent
        return tuple(chain)

    def laser_poses(self, frame: str, positions: dict[str, Float64], count: int) -> Float64:
        """Return T_base_laser, float64 (count, 4, 4).

        Parameters
        ----------
        frame
            Frame of the laser.
        positions
            float64 (count,), rad or m, by joint name; other joints are at zero.
        count
            Number of poses.
        """
        origins, axes, slides, names = self._chain_arrays(frame)
        if not any(name in positions for name in names):
            return chain_poses(origins, axes, slides, np.zeros((1, len(names)))).repeat(count, 0)
        rest = np.zeros(count)
        moved = np.column_stack([positions.get(name, rest) for name in names])
        return chain_poses(origins, axes, slides, moved)

    @cached_property
    def _chains(self) -> dict[str, tuple[Float64, Float64, Bool, tuple[str, ...]]]:
        return {}

    def _chain_arrays(self, frame: str) -> tuple[Float64, Float64, Bool, tuple[str, ...]]:
        """Return origins, axes, whether they slide, and names of the joints to a frame."""
        if frame not in self._chains:
            chain = self.chain(frame)
            self._chains[frame] = (
                np.array([rigid(joint.xyz, joint.rpy) for joint in chain]),
                np.array([joint.axis for joint in chain]),
                np.array([joint.slides for joint in chain]),
                tuple(joint.name for joint in chain),
            )
        return self._chains[frame]

    def mounted(self, joint_name: str, xyz: Vector, rpy: Vector) -> Rig:
        """Return the rig with a mounting error.

        Parameters
        ----------
        joint_name
            Joint whose origin changes.
        xyz, rpy
            Offset of its origin, m and rad.
        """
        joints = tuple(
            replace(
                joint,
                xyz=tuple(np.add(joint.xyz, xyz).tolist()),
                rpy=tuple(np.add(joint.rpy, rpy).tolist()),
            )
            if joint.name == joint_name
            else joint
            for joint in self.joints
        )
        return replace(self, joints=joints)

    def urdf(self) -> str:
        """Return the robot description, with the bodies as collision boxes."""
        links = [self.base, *(joint.child for joint in self.joints)]
        lines = ['<?xml version="1.0"?>', f'<robot name="{self.name}">']
        for link in links:
            boxes = [body for body in self.bodies if body.link == link]
            lines.append(f'  <link name="{link}"' + (">" if boxes else "/>"))
            for body in boxes:
                lines.append(
                    f'    <collision><origin xyz="{_text(body.center)}" rpy="0 0 0"/>'
                    f'<geometry><box size="{_text(body.size)}"/></geometry></collision>'
                )
            lines += ["  </link>"] if boxes else []
        for joint in self.joints:
            lines += _urdf_joint(joint, is_wheel=joint.name in self.wheels)
        return "\n".join([*lines, "</robot>", ""])


def _text(values: Vector) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _urdf_joint(joint: Joint, is_wheel: bool) -> list[str]:
    kind = "continuous" if is_wheel else "prismatic" if joint.slides else "revolute"
    kind = kind if joint.moves else "fixed"
    lines = [
        f'  <joint name="{joint.name}" type="{kind}">',
        f'    <parent link="{joint.parent}"/><child link="{joint.child}"/>',
        f'    <origin xyz="{_text(joint.xyz)}" rpy="{_text(joint.rpy)}"/>',
    ]
    if joint.moves:
        lines.append(f'    <axis xyz="{_text(joint.axis)}"/>')
    if kind in {"revolute", "prismatic"}:
        lines.append('    <limit lower="-2.0" upper="2.0" effort="10" velocity="5"/>')
    return [*lines, "  </joint>"]
