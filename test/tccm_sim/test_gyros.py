"""The simulated gyroscope against rotations in closed form."""

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.records import Imu
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.gyros import Gyro, angular_velocities, measure_rates
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

TURNING = Options(imu=True, tilt=False, self_hits=False)


def test_a_constant_rotation_has_its_rate_in_the_frame_of_the_base():
    rate, start = np.array([0.2, -0.1, 0.7]), Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    T = np.tile(np.eye(4), (50, 1, 1))
    T[:, :3, :3] = (start * Rotation.from_rotvec(np.outer(np.arange(50) * 0.01, rate))).as_matrix()
    # The sine of an angle of 7 mrad is short by 1 in 10^5.
    np.testing.assert_allclose(angular_velocities(T, 0.01), np.tile(rate, (49, 1)), rtol=2e-5)


def test_bias_and_noise_are_those_of_the_gyroscope():
    gyro = Gyro(bias=(0.01, 0.02, -0.03), sigma=0.005)
    measured = measure_rates(gyro, np.zeros((10_000, 3)), np.random.default_rng(0))
    # 5 sigma of a mean and of a standard deviation of 10,000 samples.
    np.testing.assert_allclose(measured.mean(axis=0), gyro.bias, atol=2.5e-4)
    np.testing.assert_allclose(measured.std(axis=0), gyro.sigma, rtol=0.035)


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
    turned = (rates[1:, 2] - Gyro().bias[2]).sum() * Gyro().period
    # Two rounds; 3,000 samples of 2 mrad/s add up to 1 mrad, and the roll of the base hides 1e-5.
    assert abs(yaw[1] - yaw[0]) > 12.0
    assert abs(turned - (yaw[1] - yaw[0])) < 0.006


def test_without_the_option_there_is_no_imu():
    assert not len(samples("turning", TURNING.model_copy(update={"imu": False}))[0])
