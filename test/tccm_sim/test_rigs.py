"""The rigs against points computed by hand, and their URDF against another library."""

import numpy as np
import pinocchio
import pytest

from tccm_sim.rigid import invert, quaternion_xyzw, rigid, rotation_rpy
from tccm_sim.rigs import Rig
from tccm_sim.robots import (
    HUMANOID,
    HUMANOID_WITH_ARM,
    SEGWAY,
    SEGWAY_WITH_GRIPPER,
    UPSIDE_DOWN,
)

RIGS = (HUMANOID, HUMANOID_WITH_ARM, SEGWAY, SEGWAY_WITH_GRIPPER, UPSIDE_DOWN)
NAMES = ("humanoid", "humanoid with arm", "segway", "segway with gripper", "upside down")
QUARTER = np.pi / 2


def laser(rig: Rig, frame: str, **joints: float) -> np.ndarray:
    """Return the pose of a laser at joint positions."""
    return rig.laser_poses(frame, {k: np.array([v]) for k, v in joints.items()}, 1)[0]


def test_rotations_have_the_signs_of_rep_103():
    # Yaw turns x to y; pitch turns x downwards; roll turns y to z.
    assert rotation_rpy(0, 0, QUARTER) @ (1, 0, 0) == pytest.approx([0, 1, 0])
    assert rotation_rpy(0, QUARTER, 0) @ (1, 0, 0) == pytest.approx([0, 0, -1])
    assert rotation_rpy(QUARTER, 0, 0) @ (0, 1, 0) == pytest.approx([0, 0, 1])


@pytest.mark.parametrize("rpy", [(0, 0, 0), (np.pi, 0, 0), (0.3, -1.2, 2.9), (0, np.pi, 0.1)])
def test_quaternions_rotate_like_their_matrices(rpy):
    T = rigid((1.0, 2.0, 3.0), rpy)
    x, y, z, w = quaternion_xyzw(T)
    v, u = np.array([x, y, z]), np.array([0.3, -0.5, 0.8])
    turned = u + 2 * np.cross(v, np.cross(v, u) + w * u)
    assert turned == pytest.approx(T[:3, :3] @ u)
    assert w >= 0
    assert invert(T) @ T == pytest.approx(np.eye(4))


class TestHumanoid:
    frame = "tilt_laser"

    def test_at_rest_the_laser_is_at_its_stated_position(self):
        # 0.30 + 0.55 + 0.45 + 0.06 + 0.04 + 0.12 = 1.52 m is the tilt axis.
        T = laser(HUMANOID, self.frame)
        assert T[:3, 3] == pytest.approx([0.03, 0.0, 1.54])
        assert T[:3, :3] == pytest.approx(np.eye(3))

    def test_a_laser_tilted_by_90_degrees_looks_straight_down(self):
        T = laser(HUMANOID, self.frame, laser_tilt_joint=QUARTER)
        assert T[:3, 3] == pytest.approx([0.02, 0.0, 1.49])
        assert T[:3, 0] == pytest.approx([0, 0, -1])
        assert (T @ (1.0, 0, 0, 1))[:3] == pytest.approx([0.02, 0.0, 0.49])

    def test_a_waist_turned_left_moves_the_laser_to_the_left(self):
        T = laser(HUMANOID, self.frame, waist_joint=QUARTER)
        assert T[:3, 3] == pytest.approx([-0.02, 0.05, 1.54])
        assert T[:3, 0] == pytest.approx([0, 1, 0])

    def test_a_laser_tilted_up_as_the_neck_goes_down_looks_level(self):
        # The neck carries axis and laser forward and down; the laser itself looks level again.
        T = laser(HUMANOID, self.frame, neck_pitch_joint=0.5, laser_tilt_joint=-0.5)
        x = 0.16 * np.sin(0.5) + 0.03
        z = 1.36 + 0.16 * np.cos(0.5) + 0.02
        assert T[:3, 3] == pytest.approx([x, 0.0, z])
        assert T[:3, :3] == pytest.approx(np.eye(3))


class TestSegway:
    def test_at_rest_the_laser_is_at_its_stated_position(self):
        assert laser(SEGWAY, "utm")[:3, 3] == pytest.approx([0.132, 0.0, 1.40])
        assert laser(SEGWAY, "lms")[:3, 3] == pytest.approx([0.28, 0.0, 0.34])

    def test_a_laser_panned_left_and_tilted_down_swings_with_its_mount(self):
        T = laser(SEGWAY, "utm", ptu_pan_joint=QUARTER, ptu_tilt_joint=QUARTER)
        # Panned it looks along +y; tilted, the mount (0.012, 0.064) swings to (0.064, -0.012).
        assert T[:3, 3] == pytest.approx([0.12, 0.064, 1.336 - 0.012])
        assert T[:3, 0] == pytest.approx([0, 0, -1])
        assert T[:3, 1] == pytest.approx([-1, 0, 0])


class TestUpsideDown:
    frame = "nod_lidar"

    def test_positive_bearings_of_an_upside_down_laser_are_on_the_right(self):
        T = laser(UPSIDE_DOWN, self.frame)
        assert T[:3, 3] == pytest.approx([0.19, -0.01, 1.18])
        assert T[:3, 0] == pytest.approx([1, 0, 0])
        assert T[:3, 1] == pytest.approx([0, -1, 0])
        assert T[:3, 2] == pytest.approx([0, 0, -1])

    def test_a_positive_nod_looks_up(self):
        T = laser(UPSIDE_DOWN, self.frame, nod_joint=0.3)
        assert T[:3, 0] == pytest.approx([np.cos(0.3), 0, np.sin(0.3)])

    def test_a_laser_that_looks_straight_down_is_moved_by_its_lever_arm(self):
        T = laser(UPSIDE_DOWN, self.frame, nod_joint=-QUARTER)
        assert T[:3, 3] == pytest.approx([0.09, -0.01, 1.22])
        assert T[:3, 0] == pytest.approx([0, 0, -1])


@pytest.mark.parametrize("rig", RIGS, ids=NAMES)
def test_the_urdf_has_the_same_kinematics_as_the_rig(rig):
    """Pinocchio computes the chains from the URDF independently."""
    model = pinocchio.buildModelFromXML(rig.urdf())
    data = model.createData()
    random = np.random.default_rng(1)
    for frame in (rig.tilt_frame, rig.level_frame, *(body.link for body in rig.bodies)):
        if frame == rig.base:
            continue
        angles = {name: float(random.uniform(-1.0, 1.0)) for name in rig.moving}
        q = pinocchio.neutral(model)
        for name, angle in angles.items():
            q[model.joints[model.getJointId(name)].idx_q] = angle
        pinocchio.framesForwardKinematics(model, data, q)
        theirs = data.oMf[model.getFrameId(frame)].homogeneous
        assert laser(rig, frame, **angles) == pytest.approx(theirs, abs=1e-9)


def test_a_joint_that_slides_moves_along_its_axis():
    T = laser(SEGWAY_WITH_GRIPPER, "gripper", gripper_lift_joint=0.3)
    assert T[:3, 3] == pytest.approx([0.40, 0.0, 0.85])
    assert T[:3, :3] == pytest.approx(np.eye(3))


def test_an_arm_bent_by_90_degrees_at_its_shoulder_hangs_down():
    T = laser(HUMANOID_WITH_ARM, "arm_7", arm_1_joint=QUARTER)
    assert T[:3, 3] == pytest.approx([0.0, -0.24, 1.20 - 0.56])


@pytest.mark.parametrize("rig", RIGS, ids=NAMES)
def test_wheels_touch_the_floor(rig):
    for wheel in rig.wheels:
        joint = next(j for j in rig.joints if j.name == wheel)
        height = sum(j.xyz[2] for j in rig.chain(joint.child)) + rig.base_height
        assert height == pytest.approx(rig.wheel_radius)


def test_an_error_of_a_mount_is_added_to_its_origin():
    rolled = SEGWAY.mounted("ptu_tilt_joint", (0, 0, 0.01), (0.1, 0, 0))
    T = laser(rolled, "utm")
    assert T[:3, 3] == pytest.approx(
        [0.132, -0.064 * np.sin(0.1), 1.336 + 0.01 + 0.064 * np.cos(0.1)]
    )
    assert T[:3, 1] == pytest.approx([0, np.cos(0.1), np.sin(0.1)])
    assert laser(SEGWAY, "utm")[:3, 1] == pytest.approx([0, 1, 0])
