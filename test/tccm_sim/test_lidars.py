"""What a spinning lidar makes of distances."""

from dataclasses import replace

import numpy as np
import pytest

from tccm_sim.heads import VLP_16
from tccm_sim.lidars import measure_points

QUIET = replace(VLP_16, laser=replace(VLP_16.laser, sigma=0.0, quantum=0.0, lost=0.0))
RINGS = len(VLP_16.elevations)


def measured(exact, lidar=QUIET):
    return measure_points(lidar, exact, np.random.default_rng(2))


def test_points_lie_on_the_measured_cylinder_in_time_order():
    rays = QUIET.rays
    points, since_ns = measured(3.0 / np.hypot(rays[:, 0], rays[:, 1]))
    assert len(points) == QUIET.laser.beams * RINGS
    assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx(3.0, abs=1e-5)
    assert (np.diff(since_ns) >= 0).all()
    elevations = np.degrees(np.arctan2(points[:, 2], 3.0)).reshape(-1, RINGS)
    assert elevations == pytest.approx(np.tile(np.arange(-15.0, 16.0, 2.0), (900, 1)), abs=1e-3)


def test_all_rings_have_one_bearing_and_rotate_clockwise_in_a_period():
    points, since_ns = measured(np.full(QUIET.laser.beams * RINGS, 2.0))
    times = since_ns.reshape(-1, RINGS) * 1e-9
    bearings = np.arctan2(points[:, 1], points[:, 0]).reshape(-1, RINGS)
    assert (times == times[:, :1]).all()
    # In a period the lidar goes round once: the bearing is pi - 2 pi t / T.
    expected = np.pi - 2.0 * np.pi * times / QUIET.laser.period
    assert np.abs(np.angle(np.exp(1j * (bearings - expected)))).max() < 1e-5
    assert times[-1, 0] + QUIET.laser.time_increment == pytest.approx(QUIET.laser.period)


def test_beams_without_return_have_no_point():
    exact = np.full(QUIET.laser.beams * RINGS, 2.0)
    exact[::3], exact[1::3] = np.inf, 0.1
    points, since_ns = measured(exact)
    assert len(points) == len(since_ns) == len(exact[2::3])
    assert np.linalg.norm(points, axis=1) == pytest.approx(2.0, abs=1e-5)


def test_ranges_have_the_noise_of_the_laser():
    points, _ = measured(np.full(QUIET.laser.beams * RINGS, 4.0), VLP_16)
    ranges = np.linalg.norm(points.astype(float), axis=1)
    laser = VLP_16.laser
    assert ranges.std() == pytest.approx(
        np.hypot(laser.sigma, laser.quantum / np.sqrt(12)), rel=0.05
    )
