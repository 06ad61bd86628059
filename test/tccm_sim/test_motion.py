"""The drive, the wheels and the joints."""

import numpy as np
import pytest

from tccm_sim.joints import Profile, oscillation
from tccm_sim.motion import OdometryErrors, Waypoint, drive, stand, wheel_odometry

STEP = 0.01  # s, between the samples of a drive

ROUTE = [
    Waypoint(0.0, 0.0, 0.0, 1.0),
    Waypoint(2.0, 0.0),
    Waypoint(3.0, 1.5, 2.0, 3.0),
    Waypoint(0.5, 1.0, -1.0, 2.0),
]
PERFECT = OdometryErrors(scale=1.0, yaw_scale=1.0, drift=0.0, noise=0.0, yaw_noise=0.0)


def test_the_robot_stops_at_the_way_points_with_a_pause():
    path = drive(ROUTE)
    assert np.diff(path.stops, axis=1).ravel() == pytest.approx([1.0, 3.0, 2.0], abs=STEP)
    for (start, end), goal in zip(path.stops, [ROUTE[0], *ROUTE[2:]]):
        during = path.poses(np.linspace(start, end - 2 * STEP, 5))
        assert during == pytest.approx(np.tile(during[0], (5, 1, 1)), abs=1e-4)
        assert np.hypot(*(during[0, :2, 3] - (goal.x, goal.y))) < 0.1
        yaw = np.arctan2(during[0, 1, 0], during[0, 0, 0])
        assert yaw == pytest.approx(goal.heading, abs=0.01)


def test_speeds_and_accelerations_stay_within_their_limits():
    path = drive(ROUTE, speed=0.4)
    speed = np.hypot(*np.diff(path.states[:, :2], axis=0).T) / STEP
    turning = np.diff(path.states[:, 2]) / STEP
    assert speed.max() <= 0.4 + 1e-9
    assert np.abs(np.diff(speed)).max() <= 0.4 * STEP + 1e-9
    assert np.abs(turning).max() <= 0.9 + 1e-9


def test_the_robot_never_moves_sideways():
    path = drive(ROUTE)
    step, heading = np.diff(path.states[:, :2], axis=0), path.states[:-1, 2]
    middle = heading + np.diff(path.states[:, 2]) / 2
    sideways = -np.sin(middle) * step[:, 0] + np.cos(middle) * step[:, 1]
    assert np.abs(sideways).max() < 1e-4


def test_the_base_pitches_back_when_it_accelerates():
    """A positive pitch is down, so that an accelerating base has a negative one."""
    path = drive([Waypoint(0, 0, 0.0), Waypoint(3, 0)], base_tilt=1.0)
    flat = drive([Waypoint(0, 0, 0.0), Waypoint(3, 0)], base_tilt=0.0)
    assert np.all(flat.states[:, 3:] == 0.0)
    starting = path.states[(path.times > 0.4) & (path.times < 0.9), 4]
    cruising = path.states[(path.times > 3.0) & (path.times < 3.5), 4]
    assert starting.mean() < cruising.mean() - 0.002
    assert np.abs(path.states[:, 3:]).max() < 0.01


def test_odometry_without_errors_equals_the_true_motion():
    path = drive(ROUTE)
    wheels = wheel_odometry(path, PERFECT, (0, 0, 0), np.random.default_rng(0))
    assert wheels == pytest.approx(path.states[:, :3], abs=1e-3)


def test_odometry_has_the_stated_scale_and_drift():
    path = drive([Waypoint(0, 0, 0.0), Waypoint(10, 0)], base_tilt=0.0)
    errors = OdometryErrors(scale=1.02, yaw_scale=1.0, drift=0.012, noise=0.0, yaw_noise=0.0)
    wheels = wheel_odometry(path, errors, (1.0, 2.0, 0.5), np.random.default_rng(0))
    length = path.states[-1, 0]
    assert wheels[0] == pytest.approx([1.0, 2.0, 0.5])
    assert wheels[-1, 2] - 0.5 == pytest.approx(0.012 * length, rel=1e-6)
    driven = np.hypot(*np.diff(wheels[:, :2], axis=0).T).sum()
    assert driven == pytest.approx(1.02 * length, rel=1e-6)


def test_a_standing_base_has_one_pose():
    assert stand(5.0).poses(np.array([0.0, 2.0]), 0.1)[1, :3, 3] == pytest.approx([0, 0, 0.1])


def test_poses_are_those_of_roll_pitch_and_yaw():
    path = stand(1.0)
    path.states[:] = (1.0, 2.0, 0.3, 0.02, -0.01)
    from tccm_sim.rigid import rigid

    T = path.poses(np.zeros(1), 0.5)[0]
    assert pytest.approx(rigid((1.0, 2.0, 0.5), (0.02, -0.01, 0.3))) == T


class TestJoints:
    def test_an_oscillation_goes_back_and_forth_and_rests_between_windows(self):
        profile = oscillation([(1.0, 5.1), (10.0, 12.0)], 2.0, (-0.5, 1.0))
        assert profile.at([0.0, 1.0, 3.0, 5.0, 8.0, 12.0, 20.0]) == pytest.approx(
            [-0.5, -0.5, 1.0, -0.5, -0.5, 1.0, 1.0]
        )

    def test_the_middle_of_a_move_has_a_constant_speed(self):
        profile = oscillation([(0.0, 2.0)], 2.0, (0.0, 1.0), ramp=0.1)
        t = np.linspace(0.3, 1.7, 50)
        assert np.diff(profile.at(t), 2) == pytest.approx(0.0, abs=1e-12)
        assert profile.at([1.0]) == pytest.approx(0.5)

    @pytest.mark.parametrize("ramp", [0.0, 0.1, 0.5])
    def test_positions_are_continuous(self, ramp):
        profile = oscillation([(0.0, 6.0)], 1.5, (-1.0, 1.0), ramp)
        steps = np.abs(np.diff(profile.at(np.arange(0.0, 7.0, 1e-3))))
        assert steps.max() <= 2.0 / 1.5 * 1e-3 / (1.0 - ramp) + 1e-9

    def test_a_joint_at_rest_does_not_move(self):
        assert Profile.rest(0.3).at([-1.0, 0.5, 9.0]) == pytest.approx(0.3)
