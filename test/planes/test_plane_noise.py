"""Planes of a noisy laser, faced and looked along, and one that is too thick."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.planes.plane_noise import are_too_thick, range_noise

EYE = np.array([0.0, 0.0, 1.4])


def seen(spans, sigma, rng, count=800):
    """Return points of a box (spans of x, y, z) with noise along their beams."""
    low, high = np.array(spans).T
    points = rng.uniform(low, high, (count, 3))
    beams = points - EYE
    beams /= np.linalg.norm(beams, axis=1)[:, None]
    return points + beams * rng.normal(0.0, sigma, (count, 1))


def room(sigma, seed, thickness=0.0):
    """Return points and labels of a wall, a floor and a far ledge, and the planes of these."""
    rng = np.random.default_rng(seed)
    wall = seen(((3.0, 3.0), (-2.0, 2.0), (0.0, 2.0)), sigma, rng)
    floor = seen(((1.0, 2.5), (-1.0, 1.0), (0.0, 0.0)), sigma, rng)
    ledge = seen(((2.8, 3.0), (-0.5, 0.5), (1.0 - thickness, 1.0)), sigma, rng, 300)
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    planes = [wall, floor, ledge]
    labels = np.repeat(np.arange(3, dtype=np.int32), [len(p) for p in planes])
    rms = np.array([(p @ n).std() for p, n in zip(planes, normals)])
    offsets = np.array([(p @ n).mean() for p, n in zip(planes, normals)])
    return np.concatenate(planes), labels, normals, offsets, rms


@given(st.integers(0, 10_000), st.floats(0.0, 0.03))
@settings(deadline=None, max_examples=40)
def test_planes_as_thick_as_the_noise_explains_are_not_too_thick(seed, sigma):
    assert not are_too_thick(*room(sigma, seed), EYE).any()


@pytest.mark.parametrize("sigma", [0.0025, 0.006])
def test_a_plane_through_front_and_top_of_a_ledge_is_too_thick(sigma):
    assert are_too_thick(*room(sigma, 0, thickness=0.05), EYE).tolist() == [False, False, True]


def test_points_of_no_plane_and_planes_without_points_do_not_matter():
    points, labels, normals, offsets, rms = room(0.005, 1, thickness=0.05)
    far = np.random.default_rng(0).uniform(-5.0, 5.0, (5000, 3))
    points = np.concatenate([points, far])
    labels = np.concatenate([labels, np.full(5000, -1, np.int32)])
    normals, rms = np.concatenate([normals, normals[:1]]), np.append(rms, 0.5)
    thick = are_too_thick(points, labels, normals, np.append(offsets, 3.0), rms, EYE)
    assert thick.tolist() == [False, False, True, False]
    nothing = are_too_thick(
        np.zeros((0, 3)), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros(0), np.zeros(0), EYE
    )
    assert nothing.shape == (0,)


def test_the_noise_is_the_weighted_median_of_the_planes():
    implied, count = np.array([0.1, 0.004, 0.006, 0.005]), np.array([40, 30, 30, 10])
    points = np.sort(np.repeat(implied, count))
    assert range_noise(implied, count) == points[(len(points) - 1) // 2]
