"""The simulated IMU against motions and rotations in closed form."""

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.records import Imu
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.imu import ImuModel, angular_velocities, specific_forces
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

GRAVITY = 9.80665  # m/s2, standard gravity

TURNING = Options(imu=True, tilt=False, self_hits=False)
UP = np.array([0.0, 0.0, GRAVITY])


def test_a_constant_rotation_has_its_rate_in_the_frame_of_the_base():
    rate, start = np.array([0.2, -0.1, 0.7]), Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    T = np.tile(np.eye(4), (50, 1, 1))
    T[:, :3, :3] = (start * Rotation.from_rotvec(np.outer(np.arange(50) * 0.01, rate))).as_matrix()
    # The sine of an angle of 7 mrad is short by 1 in 10^5.
    np.testing.assert_allclose(angular_velocities(T, 0.01), np.tile(rate, (49, 1)), rtol=2e-5)


def test_bias_and_noise_are_those_of_the_gyroscope():
    imu = ImuModel(rate_bias=(0.01, 0.02, -0.03), rate_sigma=0.005)
    measured = imu.measure_rates(np.zeros((10_000, 3)), np.random.default_rng(0))
    # 5 sigma of a mean and of a standard deviation of 10,000 samples.
    np.testing.assert_allclose(measured.mean(axis=0), imu.rate_bias, atol=2.5e-4)
    np.testing.assert_allclose(measured.std(axis=0), imu.rate_sigma, rtol=0.035)


def samples(world, options):
    """Return the times (N,) and the rates (N, 3) of a world's gyroscope."""
    run = [m.records[0] for m in Simulation(build_world(world, options), 0, options).run()]
    imu = [r for r in run if isinstance(r, Imu)]
    return np.array([(r.stamp_ns - EPOCH_NS) * 1e-9 for r in imu]), np.array(
        [r.angular_velocity for r in imu]
    )


def test_the_rates_of_a_drive_integrate_to_its_yaw():
    times, rates = samples("turning", TURNING)
    drive = build_world("turning", TURNING).drive
    yaw = np.interp(times[[0, -1]], drive.times, drive.columns[2])
    turned = (rates[1:, 2] - ImuModel().rate_bias[2]).sum() * ImuModel().period
    # Two rounds; 3,000 samples of 2 mrad/s add up to 1 mrad, and the roll of the base hides 1e-5.
    assert abs(yaw[1] - yaw[0]) > 12.0
    assert abs(turned - (yaw[1] - yaw[0])) < 0.006


def test_without_the_option_there_is_no_imu():
    assert not len(samples("turning", TURNING.model_copy(update={"imu": False}))[0])


def test_acceleration_at_rest_points_up_in_the_base_frame():
    """Roll lifts the left side (y), pitch lowers the front (x): REP-103."""
    T = np.tile(np.eye(4), (5, 1, 1))
    T[:, :3, :3] = Rotation.from_euler("xyz", [0.1, 0.2, 1.0]).as_matrix()
    expected = GRAVITY * np.array(
        [-np.sin(0.2), np.sin(0.1) * np.cos(0.2), np.cos(0.1) * np.cos(0.2)]
    )
    np.testing.assert_allclose(specific_forces(T, 0.01), np.tile(expected, (3, 1)))


def test_a_base_that_accelerates_ahead_feels_it_ahead():
    T, t = np.tile(np.eye(4), (5, 1, 1)), 0.01 * np.arange(5)
    T[:, :3, :3] = Rotation.from_euler("z", np.pi / 2).as_matrix()
    T[:, 1, 3] = 0.5 * 0.4 * t**2
    np.testing.assert_allclose(
        specific_forces(T, 0.01), np.tile([0.4, 0.0, GRAVITY], (3, 1)), atol=1e-9
    )


def test_bias_and_noise_are_those_of_the_accelerometer():
    imu = ImuModel(force_bias=(0.1, 0.2, -0.3), force_sigma=0.05)
    measured = imu.measure_forces(np.zeros((10_000, 3)), np.random.default_rng(0))
    # 5 sigma of a mean and of a standard deviation of 10,000 samples.
    np.testing.assert_allclose(measured.mean(axis=0), imu.force_bias, atol=2.5e-3)
    np.testing.assert_allclose(measured.std(axis=0), imu.force_sigma, rtol=0.035)


def test_tilt_at_stops_appears_in_gyroscope_and_accelerometer():
    options = Options(imu=True, tilt=False, level=False, base_tilt=0.0, stop_tilt=0.02)
    one = Simulation(build_world("flat", options), 0, options)
    imu = [m.records[0] for m in one.run() if isinstance(m.records[0], Imu)]
    times = np.array([(r.stamp_ns - EPOCH_NS) * 1e-9 for r in imu])
    tilted = []
    for start, end in one.world.drive.stops[1:]:
        R = one.true_poses(np.array([start + 0.1]))[0, :3, :3]
        during = (times > start) & (times < end)
        forces = np.array([r.acceleration for r, there in zip(imu, during) if there])
        bias, sigma = one.rig.imu.force_bias, one.rig.imu.force_sigma
        error = forces.mean(axis=0) - bias - R.T @ UP
        assert np.abs(error).max() < 4.0 * sigma / np.sqrt(len(forces))
        # It has come while the base stood: the gyroscope's integral is the roll and pitch.
        before = (times > start - 0.9) & (times < start)
        rates = np.array([r.angular_velocity for r, there in zip(imu, before) if there])
        turned = (rates - one.rig.imu.rate_bias).sum(axis=0) * one.rig.imu.period
        roll, pitch = Rotation.from_matrix(R).as_euler("xyz")[:2]
        # 90 samples of 2 mrad/s add up to 0.2 mrad.
        np.testing.assert_allclose(turned[:2], [roll, pitch], atol=0.001)
        tilted.append([roll, pitch])
    assert 0.01 < np.std(tilted) < 0.03
    assert np.abs(one.true_poses(one.world.drive.stops[1:, 0] - 0.9)[:, 2, 2] - 1.0).max() < 1e-12
