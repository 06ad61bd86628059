"""What a laser makes of distances."""

from dataclasses import replace

import numpy as np
import pytest

from tccm_sim.lasers import measure, rim_directions
from tccm_sim.robots import LMS_291, UTM_30LX

BARE = replace(UTM_30LX, mixed=0.0, lost=0.0, invalid=0.0)
MANY = 20_000


def random():
    return np.random.default_rng(4)


def test_ranges_have_the_noise_and_the_resolution_of_the_laser():
    ranges = measure(BARE, np.full(MANY, 2.0), None, random()).astype(float)
    # The standard error of the mean is sigma / sqrt(n), that of sigma is sigma / sqrt(2 n).
    assert ranges.mean() == pytest.approx(2.0, abs=4 * 0.006 / np.sqrt(MANY))
    assert ranges.std() == pytest.approx(np.hypot(0.006, 0.001 / np.sqrt(12)), rel=0.03)
    assert np.abs(ranges / 0.001 - np.round(ranges / 0.001)).max() < 1e-3


def test_ranges_beyond_the_limits_and_failures_are_marked():
    exact = np.array([0.01, 1.0, 40.0, np.inf])
    ranges = measure(replace(BARE, sigma=0.0), exact, None, random())
    assert ranges.tolist() == [-np.inf, 1.0, np.inf, np.inf]
    broken = measure(replace(BARE, lost=0.3, invalid=0.2), np.ones(MANY), None, random())
    fraction = 4 * np.sqrt(0.25 / MANY)
    assert np.isposinf(broken).mean() == pytest.approx(0.3, abs=fraction)
    assert (np.isnan(broken) | (broken == 0)).mean() == pytest.approx(0.2, abs=fraction)


def test_mixed_pixels_are_between_both_ranges():
    laser = replace(BARE, sigma=0.0, mixed=0.5)
    near, far = np.full(MANY, 1.0), np.full(MANY, 2.0)
    ranges = measure(laser, near, far.__getitem__, random())
    between = (ranges > 1.001) & (ranges < 1.999)
    assert between.mean() == pytest.approx(0.5, abs=0.02)
    assert measure(laser, near, (near + 0.01).__getitem__, random()) == pytest.approx(1.0)


def test_rim_directions_are_at_the_divergence_from_the_beam():
    bearings = np.linspace(-2.0, 2.0, 200)
    around = random().uniform(0.0, 2.0 * np.pi, len(bearings))
    rays = rim_directions(bearings, 0.01, around)
    center = np.stack([np.cos(bearings), np.sin(bearings), 0 * bearings], -1)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(1.0)
    assert np.arccos((rays * center).sum(1)) == pytest.approx(0.01, rel=1e-3)


def test_lasers_have_the_fields_of_view_of_their_data_sheets():
    assert np.degrees(UTM_30LX.angle_increment) == pytest.approx(0.25)
    assert np.degrees(LMS_291.bearings[[0, -1]]) == pytest.approx([-90, 90])
    assert UTM_30LX.offsets[-1] == pytest.approx(0.75 * 0.025)
