"""The simulated accelerometer against motions and rotations in closed form."""

import numpy as np
from scipy.spatial.transform import Rotation

from tccm_ros.records import Imu
from tccm_sim.accelerometers import (
    GRAVITY,
    Accelerometer,
    measure_forces,
    specific_forces,
)
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.options import Options
from tccm_sim.worlds import build_world

UP = np.array([0.0, 0.0, GRAVITY])


def test_at_rest_it_points_up_in_the_frame_of_the_base():
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
    one = Accelerometer(bias=(0.1, 0.2, -0.3), sigma=0.05)
    measured = measure_forces(one, np.zeros((10_000, 3)), np.random.default_rng(0))
    # 5 sigma of a mean and of a standard deviation of 10,000 samples.
    np.testing.assert_allclose(measured.mean(axis=0), one.bias, atol=2.5e-3)
    np.testing.assert_allclose(measured.std(axis=0), one.sigma, rtol=0.035)


def test_a_base_that_is_tilted_at_stops_tells_so_with_both_sensors():
    options = Options(imu=True, tilt=False, level=False, base_tilt=0.0, stop_tilt=0.02)
    one = Simulation(build_world("flat", options), 0, options)
    imu = [m.records[0] for m in one.run() if isinstance(m.records[0], Imu)]
    times = np.array([(r.stamp_ns - EPOCH_NS) * 1e-9 for r in imu])
    tilted = []
    for start, end in one.world.drive.stops[1:]:
        R = one.true_poses(np.array([start + 0.1]))[0, :3, :3]
        during = (times > start) & (times < end)
        forces = np.array([r.acceleration for r, there in zip(imu, during) if there])
        bias, sigma = one.rig.accelerometer.bias, one.rig.accelerometer.sigma
        error = forces.mean(axis=0) - bias - R.T @ UP
        assert np.abs(error).max() < 4.0 * sigma / np.sqrt(len(forces))
        # It has come while the base stood: the gyroscope's integral is the roll and pitch.
        before = (times > start - 0.9) & (times < start)
        rates = np.array([r.angular_velocity for r, there in zip(imu, before) if there])
        turned = (rates - one.rig.gyro.bias).sum(axis=0) * one.rig.gyro.period
        roll, pitch = Rotation.from_matrix(R).as_euler("xyz")[:2]
        # 90 samples of 2 mrad/s add up to 0.2 mrad.
        np.testing.assert_allclose(turned[:2], [roll, pitch], atol=0.001)
        tilted.append([roll, pitch])
    assert 0.01 < np.std(tilted) < 0.03
    assert np.abs(one.true_poses(one.world.drive.stops[1:, 0] - 0.9)[:, 2, 2] - 1.0).max() < 1e-12
