"""What a simulated robot publishes: ranges by hand, stamps, order, errors of the rig."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.joints import Profile, oscillation
from tccm_sim.motion import Waypoint, drive, stand
from tccm_sim.options import Options
from tccm_sim.robots import HUMANOID, SEGWAY, UPSIDE_DOWN
from tccm_sim.scene import Scene
from tccm_sim.world import World

EXACT = Options(sigma=0.0, level_sigma=0.0, quantum=0.0, faults=False)


def bare_world(rig=SEGWAY, joints=None, path=None):
    """Return a world with a floor, and a wall 3 m ahead."""
    scene = Scene()
    scene.floor_and_ceiling((-20, 20), (-20, 20))
    scene.wall("wall", (3.0, -8.0), (3.0, 8.0), height=2.0)
    return World("bare", scene, rig, path or stand(0.5), joints or {})


def records(world, options=EXACT, kind=Scan, topic=None, seed=0):
    return [
        m.records[0]
        for m in Simulation(world, seed, options).run()
        if isinstance(m.records[0], kind) and topic in (None, m.topic)
    ]


def at_bearing(scan, bearing):
    return scan.ranges[round((bearing - scan.angle_min) / scan.angle_increment)]


def nearest_beam(scan, bearing):
    """Return the bearing of the beam that is nearest to a bearing."""
    return scan.angle_min + scan.angle_increment * round(
        (bearing - scan.angle_min) / scan.angle_increment
    )


def test_the_level_laser_measures_the_distance_of_a_wall():
    scan = records(bare_world(), topic="/scan")[0]
    assert at_bearing(scan, 0.0) == pytest.approx(3.0 - 0.28, abs=0.006)  # 1 cm steps
    assert at_bearing(scan, np.pi / 4) == pytest.approx((3.0 - 0.28) * np.sqrt(2), abs=0.006)


def test_a_tilted_laser_measures_the_distance_of_the_floor():
    # Axis at (0.12, 1.336); tilted by 50 deg the laser is at z = 1.336 + 0.064 cos - 0.012 sin.
    tilt = np.radians(50.0)
    world = bare_world(joints={"ptu_tilt_joint": Profile.rest(tilt)})
    scan = records(world, topic="/tilt_scan")[0]
    height = 1.336 + 0.064 * np.cos(tilt) - 0.012 * np.sin(tilt)
    assert at_bearing(scan, 0.0) == pytest.approx(height / np.sin(tilt), abs=1e-5)
    assert at_bearing(scan, np.pi / 3) == pytest.approx(2 * height / np.sin(tilt), abs=1e-5)


def test_upside_down_laser_sees_the_left_at_negative_bearings():
    """A post on the left of the robot is at a negative bearing."""
    world = bare_world(UPSIDE_DOWN)
    world.scene.cylinder("post", 0.05, 2.0, (2.0, 1.0, 1.0))
    scan = records(world, topic="/nod_lidar/scan")[0]
    bearing = nearest_beam(scan, np.arctan2(1.0 + 0.01, 2.0 - 0.19))
    assert at_bearing(scan, -bearing) == pytest.approx(np.hypot(1.81, 1.01) - 0.05, abs=1e-3)
    assert at_bearing(scan, bearing) == pytest.approx((3.0 - 0.19) / np.cos(bearing), abs=1e-5)


def test_each_beam_is_cast_from_the_joint_position_at_its_own_time():
    world = bare_world(joints={"laser_tilt_joint": oscillation([(0.0, 0.5)], 0.5, (0.9, 1.3), 0.0)})
    world = replace(world, rig=HUMANOID)
    scan = records(world, topic="/tilt_scan")[2]
    beams = np.arange(len(scan.ranges))
    times = (scan.stamp_ns - EPOCH_NS) * 1e-9 + beams * scan.time_increment
    tilt = 0.9 + 0.4 * times / 0.5
    bearing = scan.angle_min + beams * scan.angle_increment
    height = 1.52 + 0.02 * np.cos(tilt) - 0.03 * np.sin(tilt)
    ahead = np.abs(bearing) < 0.8
    expected = height / (np.sin(tilt) * np.cos(bearing))
    assert scan.ranges[ahead] == pytest.approx(expected[ahead], abs=1e-5)


def test_each_beam_is_cast_from_the_base_pose_at_its_own_time():
    path = drive([Waypoint(0, 0, 0.0), Waypoint(1.5, 0)], base_tilt=0.0)
    simulation = Simulation(bare_world(path=path), 0, EXACT)
    scans = [m.records[0] for m in simulation.run() if m.topic == "/scan"]
    scan = scans[len(scans) // 2]
    middle = 180
    time = (scan.stamp_ns - EPOCH_NS) * 1e-9 + middle * scan.time_increment
    x = np.interp(time, path.times, path.states[:, 0])
    assert scan.ranges[middle] == pytest.approx(3.0 - 0.28 - x, abs=0.006)


def test_messages_are_in_time_order_on_the_topics_of_the_robot():
    messages = list(Simulation(bare_world(UPSIDE_DOWN), 0, EXACT).run())
    stamps = [m.log_ns for m in messages]
    assert stamps == sorted(stamps)
    assert [m.topic for m in messages[:2]] == ["/robot_description", "/tf_static"]
    assert {m.topic for m in messages[2:]} == {
        "/dynamixel/joint_states", "/wheel_odom", "/front_lidar/scan", "/nod_lidar/scan",
    }  # fmt: skip
    assert isinstance(messages[0].records[0], RobotDescription)
    for message in messages:
        if isinstance(message.records[0], Scan):  # a scan is out after its last beam
            assert message.log_ns > message.records[0].end_ns


def test_odometry_starts_at_the_first_pose_of_the_robot():
    first = records(bare_world(UPSIDE_DOWN), kind=Odometry)[0]
    assert (first.frame_id, first.child_frame_id) == ("wheel_odom", "chassis")
    assert first.T_odom_base[:2, 3] == pytest.approx([2.0, -1.0])


def test_joint_states_contain_the_wheels():
    sample = records(bare_world(), kind=JointSample)[0]
    assert sample.names == (
        "ptu_pan_joint", "ptu_tilt_joint", "left_wheel_joint", "right_wheel_joint",
    )  # fmt: skip


class TestErrorsOfTheRig:
    """Each option is the correction that `tccm calibrate` must find."""

    tilt = 0.8
    joints = {"ptu_tilt_joint": Profile.rest(tilt)}  # noqa: RUF012

    def reported(self, **errors):
        options = EXACT.model_copy(update=errors)
        return records(bare_world(joints=self.joints), options, JointSample)[5]

    def test_tilt_offset_and_tilt_scale_correct_the_reported_tilt(self):
        sample = self.reported(tilt_offset=0.1, tilt_scale=1.03)
        corrected = 1.03 * sample.positions[1] + 0.1
        assert corrected == pytest.approx(self.tilt, abs=1.03 * SEGWAY.encoder / 2)

    def test_joint_time_offset_corrects_the_stamps_of_joints(self):
        sample = self.reported(joint_time_offset=0.012)
        assert sample.stamp_ns + 12_000_000 == EPOCH_NS + 50_000_000

    def test_roll_and_height_correct_the_mount_of_the_tilt_axis(self):
        options = EXACT.model_copy(update={"laser_roll": 0.05, "laser_height": 0.02})
        scan = records(bare_world(joints=self.joints), options, topic="/tilt_scan")[0]
        # The roll turns the whole unit about x at the tilt axis (z = 1.336 + 0.02).
        c, s = np.cos(self.tilt), np.sin(self.tilt)
        mount = np.array([0.012 * c + 0.064 * s, 0.0, -0.012 * s + 0.064 * c])
        roll = np.array(
            [[1, 0, 0], [0, np.cos(0.05), -np.sin(0.05)], [0, np.sin(0.05), np.cos(0.05)]]
        )
        height = 1.356 + (roll @ mount)[2]
        for bearing in (nearest_beam(scan, b) for b in (-0.5, 0.0, 0.5)):
            ray = roll @ (np.cos(bearing) * c, np.sin(bearing), -np.cos(bearing) * s)
            assert at_bearing(scan, bearing) == pytest.approx(-height / ray[2], abs=1e-5)

    def test_level_error_corrects_the_mount_of_the_level_laser(self):
        options = EXACT.model_copy(update={"level_error": (0.1, 0, 0, 0, 0, 0)})
        scan = records(bare_world(), options, topic="/scan")[0]
        assert at_bearing(scan, 0.0) == pytest.approx(3.0 - 0.38, abs=0.006)


def test_transforms_on_tf_are_those_of_the_joints():
    joints = {"ptu_tilt_joint": Profile.rest(0.4)}
    options = EXACT.model_copy(update={"publish_tf": True})
    messages = Simulation(bare_world(joints=joints), 0, options).run()
    turned = {t.child: t for m in islice(messages, 12) if m.topic == "/tf" for t in m.records}
    R = turned["ptu_tilt"].T_parent_child[:3, :3]
    assert R[:, 0] == pytest.approx([np.cos(0.4), 0, -np.sin(0.4)], abs=1e-3)
    assert turned["base_link"].parent == "odom"


def test_the_tilting_laser_publishes_within_its_windows_only():
    world = replace(bare_world(), tilt_windows=np.array([[0.1, 0.3]]))
    stamps = np.array([s.stamp_ns - EPOCH_NS for s in records(world, topic="/tilt_scan")]) * 1e-9
    assert stamps.min() >= 0.1
    assert stamps.max() + SEGWAY.tilt.offsets[-1] <= 0.3
    always = EXACT.model_copy(update={"always": True})
    assert len(records(world, always, topic="/tilt_scan")) > len(stamps)


def test_the_same_seed_gives_the_same_ranges():
    world, noisy = bare_world(), Options()
    first, again, other = (records(world, noisy, seed=s) for s in (3, 3, 4))
    assert all(a.ranges.tobytes() == b.ranges.tobytes() for a, b in zip(first, again))
    assert any(a.ranges.tobytes() != b.ranges.tobytes() for a, b in zip(first, other))


def test_lasers_measure_the_body_of_the_robot():
    """The actuator of the gripper is in front: its top is 1.1 m high, 0.33 to 0.39 m ahead."""
    tilt = 0.95
    world = bare_world(joints={"ptu_tilt_joint": Profile.rest(tilt)})
    height = 1.336 + 0.064 * np.cos(tilt) - 0.012 * np.sin(tilt)
    own = records(world, topic="/tilt_scan")[0]
    assert at_bearing(own, 0.0) == pytest.approx((height - 1.1) / np.sin(tilt), abs=1e-5)
    through = EXACT.model_copy(update={"self_hits": False})
    scan = records(world, through, topic="/tilt_scan")[0]
    assert at_bearing(scan, 0.0) == pytest.approx(height / np.sin(tilt), abs=1e-5)


def test_without_the_option_tilt_there_are_no_tilting_scans():
    level_only = EXACT.model_copy(update={"tilt": False})
    assert {s.frame_id for s in records(bare_world(), level_only)} == {"lms"}
