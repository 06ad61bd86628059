"""Where a sensor is: found names, hand-computed points, corrections, clean errors."""

import numpy as np
import pytest
from robots import (
    MS,
    START,
    TILTING,
    description,
    joint,
    joints_at,
    odometry_at,
    robot,
    transform_at,
)

from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.errors import FrameError, UrdfError
from tccm_ros.geometry import pose_from_rpy, transform
from tccm_ros.records import JointSample, Odometry, RobotDescription, TransformSample
from tccm_ros.robot import MountKind
from tccm_ros.robot.frames import FrameTree
from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.mount import Mount


class Known(Mount):
    """A mount, and what is known of the robot: records go there as they are."""

    def __init__(self, config, kind):
        self.frames = FrameTree()
        self.joints = JointTracks(round(config.rig.joint_time_offset * 1e9))
        super().__init__(config, kind, self.frames, self.joints)

    def add(self, record):
        {
            RobotDescription: lambda: self.frames.describe(record.urdf),
            TransformSample: lambda: self.frames.add_transform(record),
            JointSample: lambda: self.joints.add(record),
            Odometry: lambda: self.frames.follow_odometry(record.child_frame_id),
        }[type(record)]()

    def T_base_laser(self, frame, stamps):
        return self.find(frame, final=True).at(stamps)

    def forget(self):
        self.joints.clear()
        self.frames.clear_samples()
        self.clear_samples()


def kinematics(*records, kind=MountKind.TILTING, settings=()):
    result = Known(read_config(None, list(settings)), kind)
    for record in records:
        result.add(record)
    return result


def where(kin, point, stamp=START, frame="laser"):
    """Return a point of the laser's frame in the base."""
    T = kin.T_base_laser(frame, np.array([stamp]))[0]
    return transform(T, np.array([point], float))[0]


HALF = np.pi / 2


# The laser sits (0.05, 0, 0.02) from a tilt axis at (0.1, 0, 1.0); a hit 2 m ahead on its x axis.
@pytest.mark.parametrize(
    ("angle", "hit"),
    [
        (0.0, (2.15, 0.0, 1.02)),
        (HALF, (0.12, 0.0, -1.05)),  # straight down: x -> -z, and the 2 cm point forward
        (-HALF, (0.08, 0.0, 3.05)),
        (
            np.pi / 6,
            (0.1 + 2.05 * 0.8660254 + 0.02 * 0.5, 0.0, 1.0 - 2.05 * 0.5 + 0.02 * 0.8660254),
        ),
    ],
)
def test_hits_of_a_laser_on_a_lever_arm_are_where_they_are_by_hand(angle, hit):
    kin = kinematics(description(), joints_at(START, tilt=angle))
    np.testing.assert_allclose(where(kin, (2, 0, 0)), hit, atol=1e-7)


def test_left_of_an_upside_down_laser_is_the_right_of_the_base():
    text = TILTING.replace(
        '<origin xyz="0.05 0 0.02" rpy="0 0 0"/>',
        '<origin xyz="0.05 0 0.02" rpy="3.14159265 0 0"/>',
    )
    kin = kinematics(description(text), joints_at(START, tilt=0.0))
    np.testing.assert_allclose(where(kin, (2, 1, 0)), (2.15, -1.0, 1.02), atol=1e-7)
    np.testing.assert_allclose(where(kin, (0, 0, 1)), (0.15, 0.0, 0.02), atol=1e-7)


def test_a_negative_axis_tilts_up():
    text = TILTING.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>')
    kin = kinematics(description(text), joints_at(START, tilt=HALF))
    np.testing.assert_allclose(where(kin, (2, 0, 0)), (0.08, 0.0, 3.05), atol=1e-7)


WAIST = robot(
    [
        joint("lift", "prismatic", "base", "waist", xyz="0 0 0.5", axis="0 0 1"),
        joint("turn", "continuous", "waist", "chest", xyz="0 0 0.3", axis="0 0 1"),
        joint("tilt", "revolute", "chest", "head", xyz="0.1 0 0.2"),
        joint("mount", "fixed", "head", "laser"),
    ]
)


def test_every_moving_joint_of_the_chain_is_followed():
    kin = kinematics(
        description(WAIST), joints_at(START, lift=0.25, turn=HALF, tilt=HALF), joints_at(START)
    )
    # lift 0.25 up; turn left: the head's 0.1 m forward points along +y; tilt: the beam goes down
    np.testing.assert_allclose(where(kin, (0, 0, 0)), (0.0, 0.1, 1.25), atol=1e-9)
    np.testing.assert_allclose(where(kin, (1, 0, 0)), (0.0, 0.1, 0.25), atol=1e-9)
    assert kin.tilt_joint == "tilt"


def test_joints_may_come_from_several_publishers():
    kin = kinematics(
        description(WAIST),
        joints_at(START, lift=0.0),
        joints_at(START, gripper=0.3, turn=0.0),
        joints_at(START - 10 * MS, tilt=0.0),
        joints_at(START + 10 * MS, lift=1.0, tilt=0.2),
        joints_at(START + 20 * MS, turn=0.2),
        joints_at(START + 5 * MS, turn=np.nan),
    )
    T = kin.T_base_laser("laser", np.array([START + 5 * MS]))[0]
    chest = pose_from_rpy((0, 0, 0.5 + 0.5 + 0.3, 0, 0, 0.05))
    expected = chest @ pose_from_rpy((0.1, 0, 0.2, 0, 0.15, 0))
    np.testing.assert_allclose(T, expected, atol=1e-9)


def test_mimic_joints_follow_their_source():
    text = robot(
        [
            joint("drive", "revolute", "base", "lever"),
            joint(
                "tilt",
                "revolute",
                "base",
                "laser",
                more='<mimic joint="drive" multiplier="-2" offset="0.1"/>',
            ),
        ]
    )
    kin = kinematics(description(text), joints_at(START, drive=0.3))
    T = kin.T_base_laser("laser", np.array([START]))[0]
    np.testing.assert_allclose(T, pose_from_rpy((0, 0, 0, 0, -0.5, 0)), atol=1e-12)
    assert kin.tilt_samples() == [(START, pytest.approx(-0.5))]


def test_a_joint_that_mimics_itself_is_an_error():
    ring = [
        joint("a", "revolute", "base", "x", more='<mimic joint="b"/>'),
        joint("b", "revolute", "x", "laser", more='<mimic joint="a"/>'),
    ]
    kin = kinematics(description(robot(ring)))
    with pytest.raises(FrameError, match="mimics itself"):
        kin.find("laser", final=True)


# -- names are found --------------------------------------------------


def test_the_base_is_the_odometrys_child_where_the_model_has_it():
    text = robot(
        [
            joint("feet", "fixed", "footprint", "base", xyz="0 0 0.25"),
            joint("tilt", "revolute", "base", "laser", xyz="0 0 1"),
        ]
    )
    samples = joints_at(START, tilt=0.0)
    for child, height in (("footprint", 1.25), ("base", 1.0), ("unknown", 1.25)):
        kin = kinematics(description(text), odometry_at(START, child=child), samples)
        np.testing.assert_allclose(where(kin, (0, 0, 0)), (0, 0, height))
    assert kin.base == "footprint"


def test_the_base_may_be_below_the_laser():
    text = robot(
        [
            joint("up", "prismatic", "laser", "plate", axis="0 0 1"),
            joint("tilt", "revolute", "plate", "base", xyz="0 0 -1"),
        ]
    )
    kin = kinematics(
        description(text), odometry_at(START, child="base"), joints_at(START, up=0.5, tilt=HALF)
    )
    # T_laser_base = up 0.5, down 1, tilt; so the laser is 0.5 above the base along the tilted axis
    T_laser_base = pose_from_rpy((0, 0, -0.5, 0, HALF, 0))
    np.testing.assert_allclose(
        kin.T_base_laser("laser", np.array([START]))[0], np.linalg.inv(T_laser_base), atol=1e-12
    )


def test_a_configured_joint_replaces_the_one_that_would_be_found():
    kin = kinematics(
        description(WAIST),
        joints_at(START, lift=0.0, turn=0.2, tilt=0.1),
        settings=["frames.tilt_joint=turn"],
    )
    kin.find("laser", final=True)
    assert kin.tilt_samples() == [(START, 0.2)]


@pytest.mark.parametrize(
    ("records", "settings", "message"),
    [
        ([description()], ["frames.tilt_joint=tild"], "no joint 'tild'.*did you mean 'tilt'"),
        ([description()], ["frames.base=torso"], "no way from base 'torso' to sensor 'laser'"),
        ([description(TILTING.replace("laser", "lidar"))], [], "no frame 'laser'"),
        ([], [], "no frames at all"),
        ([], ["rig.kinematics=urdf"], "no robot description"),
        ([], ["rig.kinematics=rig"], "rig.tilt_laser is not set"),
        (
            [],
            ["rig.kinematics=rig", "rig.tilt_laser=[0, 0, 1, 0, 0, 0]"],
            "tilt joint is not known.*frames.tilt_joint",
        ),
        (
            [transform_at(START, "a", "b"), transform_at(START, "b", "laser")],
            [],
            "base frame is ambiguous.*a, b",
        ),
        (
            [transform_at(START, "a", "laser"), transform_at(0, "c", "base", is_static=True)],
            ["frames.base=base"],
            "separate trees",
        ),
        (
            [joints_at(START, tilt=0.0)],
            [
                "rig.kinematics=rig",
                "rig.tilt_laser=[0, 0, 1, 0, 0, 0]",
                "rig.tilt_axis=[0, 0, 0]",
            ],
            "rig.tilt_axis is zero",
        ),
        ([description(robot([joint("a", "fixed", "base", "laser")]))], [], "no moving joint"),
        ([description(robot([joint("a", "floating", "base", "laser")]))], [], "floating"),
    ],
)
def test_the_error_of_a_missing_frame_or_joint_names_it(records, settings, message):
    kin = kinematics(*records, settings=settings)
    assert kin.find("laser", final=False) is None
    with pytest.raises(FrameError, match=message) as caught:
        kin.find("laser", final=True)
    assert "\n" not in str(caught.value)
    assert kin.problem is caught.value


def test_a_broken_description_leaves_the_one_before():
    kin = kinematics(description(), joints_at(START, tilt=0.0))
    with pytest.raises(UrdfError):
        kin.add(description("<robot"))
    np.testing.assert_allclose(where(kin, (0, 0, 0)), (0.15, 0, 1.02))


def test_a_new_description_moves_the_laser():
    kin = kinematics(description(), joints_at(START, tilt=0.0))
    where(kin, (0, 0, 0))
    kin.add(description(TILTING.replace("0.1 0 1.0", "0.1 0 1.5")))
    np.testing.assert_allclose(where(kin, (0, 0, 0)), (0.15, 0, 1.52))


# -- sources --------------------------------------------------


def tf_of_tilting(stamp_ns, angle):
    return [
        transform_at(0, "base", "head", (0.1, 0, 1.0, 0, 0, 0), is_static=True),
        transform_at(stamp_ns, "head", "cradle", (0, 0, 0, 0, angle, 0)),
        transform_at(0, "cradle", "laser", (0.05, 0, 0.02, 0, 0, 0), is_static=True),
    ]


def test_tf_gives_the_same_poses_as_the_description():
    stamps = START + np.arange(0, 101, 5) * MS
    by_urdf, by_tf = kinematics(description()), kinematics()
    for k in range(11):
        by_urdf.add(joints_at(START + 10 * k * MS, tilt=0.05 * k))
        for record in tf_of_tilting(START + 10 * k * MS, 0.05 * k):
            by_tf.add(record)
    np.testing.assert_allclose(
        by_tf.T_base_laser("laser", stamps), by_urdf.T_base_laser("laser", stamps), atol=1e-12
    )
    angles = [a for _, a in by_tf.tilt_samples()]
    np.testing.assert_allclose(angles, 0.05 * np.arange(11), atol=1e-9)
    assert by_tf.tilt_joint == "cradle"


@pytest.mark.parametrize("scale_offset", [(1.0, 0.2), (1.1, -0.1)])
def test_corrections_of_the_tilt_are_the_same_by_tf(scale_offset):
    scale, offset = scale_offset
    settings = [f"rig.tilt_scale={scale}", f"rig.tilt_offset={offset}"]
    by_urdf, by_tf = kinematics(description(), settings=settings), kinematics(settings=settings)
    for k in range(5):
        by_urdf.add(joints_at(START + k * MS, tilt=0.1 * k))
        for record in tf_of_tilting(START + k * MS, 0.1 * k):
            by_tf.add(record)
    by_tf.find("laser", final=True)
    by_urdf.find("laser", final=True)
    angles = scale * 0.1 * np.arange(5) + offset
    for kin in (by_urdf, by_tf):
        np.testing.assert_allclose([a for _, a in kin.tilt_samples()], angles, atol=1e-9)
    stamps = START + np.arange(5) * MS
    T = by_urdf.T_base_laser("laser", stamps)
    np.testing.assert_allclose(by_tf.T_base_laser("laser", stamps), T, atol=1e-9)
    expected = pose_from_rpy((0.1, 0, 1, 0, angles[3], 0)) @ pose_from_rpy((0.05, 0, 0.02, 0, 0, 0))
    np.testing.assert_allclose(T[3], expected, atol=1e-9)


def test_a_laser_that_only_static_tf_knows_hangs_on_a_link():
    text = robot([joint("tilt", "revolute", "base", "cradle", xyz="0 0 1")])
    for source in ("auto", "urdf"):
        kin = kinematics(
            description(text),
            transform_at(0, "cradle", "laser", (0.3, 0, 0, 0, 0, 0), is_static=True),
            joints_at(START, tilt=HALF),
            settings=[f"rig.kinematics={source}"],
        )
        np.testing.assert_allclose(where(kin, (0, 0, 0)), (0, 0, 0.7), atol=1e-9)


def test_tf_serves_where_the_joints_are_silent():
    before = tf_of_tilting(START - MS, 0.29)
    kin = kinematics(description(), *before, *tf_of_tilting(START, 0.3))
    assert kin.find("laser", final=False) is None
    np.testing.assert_allclose(
        kin.T_base_laser("laser", np.array([START]))[0],
        pose_from_rpy((0.1, 0, 1, 0, 0.3, 0)) @ pose_from_rpy((0.05, 0, 0.02, 0, 0, 0)),
        atol=1e-12,
    )


def test_the_description_wins_over_tf():
    records = tf_of_tilting(START, 0.3)
    kin = kinematics(description(), joints_at(START, tilt=0.0), *records)
    np.testing.assert_allclose(where(kin, (0, 0, 0)), (0.15, 0, 1.02), atol=1e-12)


RIG = [
    "rig.kinematics=rig",
    "rig.tilt_laser=[0.15, 0, 1.02, 0, 0, 0]",
    "rig.tilt_center=[0.1, 0, 1.0]",
    "rig.level_laser=[0.2, 0, 0.3, 0, 0, 0.5]",
]


def test_a_configured_rig_gives_the_poses_of_the_same_robot_description():
    for angle in (0.0, 0.4, -1.0):
        sample = joints_at(START, tilt=angle)
        by_rig, by_urdf = kinematics(sample, settings=RIG), kinematics(description(), sample)
        np.testing.assert_allclose(
            by_rig.T_base_laser("laser", np.array([START])),
            by_urdf.T_base_laser("laser", np.array([START])),
            atol=1e-12,
        )
    assert by_rig.tilt_samples() == [(START, -1.0)]


def test_an_ambiguous_rig_joint_names_the_candidates():
    kin = kinematics(joints_at(START, pan=0.0, tilt=0.0), settings=RIG)
    with pytest.raises(FrameError, match="pan, tilt"):
        kin.find("laser", final=True)
    kin = kinematics(joints_at(START, pan=0.0, tilt=0.0), settings=[*RIG, "frames.tilt_joint=tilt"])
    np.testing.assert_allclose(where(kin, (0, 0, 0)), (0.15, 0, 1.02), atol=1e-12)


def test_auto_falls_back_to_the_rig():
    kin = kinematics(joints_at(START, tilt=0.0), settings=RIG[1:])
    assert kin.find("laser", final=False) is None
    np.testing.assert_allclose(where(kin, (0, 0, 0)), (0.15, 0, 1.02), atol=1e-12)


def test_a_level_laser_needs_no_joint():
    kin = kinematics(description(), kind=MountKind.LEVEL)
    np.testing.assert_allclose(where(kin, (1, 0, 0), frame="front_laser"), (1.2, 0, 0.3))
    assert kin.tilt_samples() == []
    kin = kinematics(kind=MountKind.LEVEL, settings=RIG)
    np.testing.assert_allclose(where(kin, (0, 0, 0)), (0.2, 0, 0.3))


# -- corrections --------------------------------------------------


def test_corrections_of_mount_tilt_and_joint_time_are_applied():
    settings = [
        "rig.mount_correction=[0.01, 0.02, 0.03, 0, 0, 0.1]",
        "rig.level_correction=[0, 0, 0, 0.1, 0, 0]",
        "rig.joint_time_offset=0.005",
        "rig.tilt_offset=0.1",
    ]
    kin = kinematics(description(), joints_at(START, tilt=0.2), settings=settings)
    chain = pose_from_rpy((0.1, 0, 1, 0, 0.3, 0)) @ pose_from_rpy((0.05, 0, 0.02, 0, 0, 0))
    expected = pose_from_rpy((0.01, 0.02, 0.03, 0, 0, 0.1)) @ chain
    stamp = START + 5 * MS
    np.testing.assert_allclose(
        kin.T_base_laser("laser", np.array([stamp]))[0], expected, atol=1e-12
    )
    assert kin.tilt_samples() == [(stamp, pytest.approx(0.3))]
    level = kinematics(description(), kind=MountKind.LEVEL, settings=settings)
    np.testing.assert_allclose(
        level.T_base_laser("front_laser", np.array([stamp]))[0],
        pose_from_rpy((0, 0, 0, 0.1, 0, 0)) @ pose_from_rpy((0.2, 0, 0.3, 0, 0, 0)),
        atol=1e-12,
    )


# -- the tilt angle --------------------------------------------------


def test_tilt_samples_come_once_and_in_order():
    kin = kinematics(description(), joints_at(START, tilt=0.0))
    kin.find("laser", final=True)
    for k in (1, 3, 2, 4, 4):
        kin.add(joints_at(START + k * MS, tilt=0.1 * k))
    assert [s - START for s, _ in kin.tilt_samples()] == [0, MS, 3 * MS, 4 * MS]
    assert kin.tilt_samples() == []
    kin.add(joints_at(START + 2 * MS + 1, tilt=0.0))
    assert kin.tilt_samples() == []


def test_tilt_samples_from_before_the_joint_was_known_are_not_lost():
    kin = kinematics(joints_at(START, tilt=0.1), joints_at(START + MS, tilt=0.2))
    assert kin.tilt_samples() == []
    kin.add(description())
    kin.find("laser", final=True)
    assert [a for _, a in kin.tilt_samples()] == [0.1, 0.2]


@pytest.mark.parametrize("direction", [1, -1])
def test_the_tilt_angle_goes_on_over_a_wrap(direction):
    kin = kinematics(description())
    true = direction * np.arange(0, 20, 0.5)
    for k, angle in enumerate(true):
        kin.add(joints_at(START + k * MS, tilt=(angle + np.pi) % (2 * np.pi) - np.pi))
    kin.find("laser", final=True)
    np.testing.assert_allclose([a for _, a in kin.tilt_samples()], true, atol=1e-9)


# -- the robot itself --------------------------------------------------


def test_self_shapes_move_with_the_arm():
    box = (
        '<collision><origin xyz="0 0 0.1"/><geometry><box size="0.2 0.4 0.6"/></geometry>'
        "</collision>"
    )
    arm = (
        '<collision><origin xyz="0.5 0 0"/><geometry>'
        '<cylinder radius="0.05" length="1"/></geometry></collision>'
    )
    text = robot(
        [
            joint("tilt", "revolute", "base", "laser", xyz="0 0 1"),
            joint("shoulder", "revolute", "base", "arm", xyz="0 0 0.8", axis="0 0 1"),
            joint("silent", "revolute", "arm", "hand", xyz="1 0 0", axis="0 0 1"),
        ],
        {"base": box, "arm": arm, "hand": arm},
    )
    kin = kinematics(
        description(text),
        joints_at(START, tilt=0.0, shoulder=0.0),
        joints_at(START + 10 * MS, tilt=0.0, shoulder=np.pi),
    )
    assert kin.self_shapes(START) is None
    kin.find("laser", final=True)
    shapes = kin.self_shapes(START + 5 * MS)
    assert shapes.kinds.tolist() == [0, 2]
    np.testing.assert_allclose(shapes.half, [[0.1, 0.2, 0.3], [0.05, 0.05, 0.5]])
    np.testing.assert_allclose(
        shapes.T_base_shape[:, :3, 3], [[0, 0, 0.1], [0, 0.5, 0.8]], atol=1e-12
    )
    assert len(kin.self_shapes(START + 11 * MS).kinds) == 1


def test_a_robot_without_shapes_has_none():
    kin = kinematics(description(), joints_at(START, tilt=0.0))
    kin.find("laser", final=True)
    assert kin.self_shapes(START) is None


def test_forgetting_samples_keeps_static_transforms():
    kin = kinematics(description(), joints_at(START, tilt=0.3))
    where(kin, (0, 0, 0))
    kin.forget()
    assert not len(kin.joints.of("tilt"))
    kin.add(joints_at(5, tilt=0.0))
    np.testing.assert_allclose(where(kin, (0, 0, 0), stamp=5), (0.15, 0, 1.02))
    assert kin.tilt_samples() == [(5, 0.0)]


def test_the_memory_for_unknown_joints_is_bounded():
    kin = Known(Config(), MountKind.TILTING)
    for k in range(3000):
        kin.add(joints_at(START, **{f"j{k}": 0.0}))
    assert len(kin.joints) <= 1024
