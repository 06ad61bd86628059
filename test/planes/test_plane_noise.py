"""Planes of a noisy sensor, faced and looked along, and one that is too thick."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.planes.plane_noise import are_too_thick, range_noise, thickness, weighted_median

PIECE = 0.04  # m, width of a piece: two cells

EYE = np.array([0.0, 0.0, 1.4])


def seen(spans, sigma, rng, count=8000):
    """Return points of a box (spans of x, y, z) with noise along their beams."""
    low, high = np.array(spans).T
    points = rng.uniform(low, high, (count, 3))
    beams = points - EYE
    beams /= np.linalg.norm(beams, axis=1)[:, None]
    return points + beams * rng.normal(0.0, sigma, (count, 1))


def room(sigma, seed, height=0.0):
    """Return points and labels of a wall, a floor and a far ledge, and the planes of these.

    The ledge goes on as a front, so far down, m.
    """
    rng = np.random.default_rng(seed)
    wall = seen(((3.0, 3.0), (-2.0, 2.0), (0.0, 2.0)), sigma, rng)
    floor = seen(((1.0, 2.5), (-1.0, 1.0), (0.0, 0.0)), sigma, rng)
    ledge = seen(((2.8, 3.0), (-0.5, 0.5), (1.0 - height, 1.0)), sigma, rng, 3000)
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    planes = [wall, floor, ledge]
    labels = np.repeat(np.arange(3, dtype=np.int32), [len(p) for p in planes])
    rms = np.array([(p @ n).std() for p, n in zip(planes, normals)])
    offsets = np.array([(p @ n).mean() for p, n in zip(planes, normals)])
    return np.concatenate(planes), labels, normals, offsets, rms


def judged(sigma, points, labels, normals, offsets):
    return are_too_thick(points, labels, normals, offsets, np.full(len(points), sigma), EYE)


@given(st.integers(0, 10_000), st.floats(0.0, 0.02))
@settings(deadline=None, max_examples=40)
def test_planes_as_thick_as_the_noise_explains_are_not_too_thick(seed, sigma):
    points, labels, *planes, _ = room(sigma, seed)
    is_horizontal = labels > 0  # across a wall points are in one column
    assert not judged(sigma, points, np.where(is_horizontal, labels, -1), *planes).any()


@pytest.mark.parametrize("sigma", [0.0025, 0.006])
def test_a_plane_through_the_front_of_a_ledge_is_too_thick(sigma):
    points, labels, *planes, _ = room(sigma, 0, height=0.05)
    labels = np.where(labels > 0, labels, -1)
    assert judged(sigma, points, labels, *planes).tolist() == [False, False, True]


def test_a_plane_is_as_thick_at_the_range_where_it_is():
    """The same points are a plane where the sensor has much noise, and none where it has little."""
    points, labels, *planes, _ = room(0.0, 0)
    points[:, 2] += np.where(
        labels == 2, np.random.default_rng(1).normal(0.0, 0.008, len(labels)), 0.0
    )
    labels = np.where(labels == 2, labels, -1)
    slope = 0.4 / np.hypot(2.9, 0.4)
    assert judged(0.001, points, labels, *planes).tolist() == [False, False, True]
    assert not judged(0.008 / slope, points, labels, *planes).any()


def test_a_bent_plane_is_not_too_thick():
    rng = np.random.default_rng(0)
    points = rng.uniform((1.0, -0.75, 0.0), (1.7, 0.75, 0.0), (20_000, 3))
    points[:, 2] = 0.5 - 0.08 * points[:, 1] ** 2 + rng.normal(0.0, 0.002, len(points))
    labels, normals = np.zeros(len(points), np.int32), np.array([[0.0, 0.0, 1.0]])
    assert points[:, 2].std() > 0.01
    assert not judged(0.003, points, labels, normals, points[:, 2:].mean(axis=0)).any()


def test_thickness_is_that_of_the_median_piece():
    """A numpy twin, piece by piece."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-0.3, 0.3, (2000, 3))
    labels, residuals = rng.integers(0, 3, 2000).astype(np.int32), rng.normal(size=2000)
    expected = []
    for plane in range(3):
        spreads = []
        cells = np.floor(points[labels == plane, :2] / PIECE)
        own = residuals[labels == plane]
        for cell in np.unique(cells, axis=0):
            inside = own[(cells == cell).all(axis=1)]
            spreads += [inside.std(ddof=1)] if len(inside) >= 4 else []
        expected.append(np.sort(spreads)[(len(spreads) - 1) // 2])
    assert thickness(points, labels, residuals, 4) == pytest.approx([*expected, 0.0])


def test_points_of_no_plane_and_planes_without_points_do_not_matter():
    points, labels, normals, offsets, rms = room(0.005, 1, height=0.05)
    labels = np.where(labels > 0, labels, -1)
    far = np.random.default_rng(0).uniform(-5.0, 5.0, (5000, 3))
    points = np.concatenate([points, far])
    labels = np.concatenate([labels, np.full(5000, -1, np.int32)])
    normals, rms = np.concatenate([normals, normals[:1]]), np.append(rms, 0.5)
    offsets = np.append(offsets, 3.0)
    assert judged(0.005, points, labels, normals, offsets).tolist() == [False, False, True, False]
    nothing = judged(0.005, np.zeros((0, 3)), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros(0))
    assert nothing.shape == (0,)


def test_range_noise_equals_the_simulated_sigma():
    points, labels, normals, offsets, rms = room(0.006, 1)
    assert range_noise(points, labels, normals, offsets, rms, EYE) == pytest.approx(0.006, rel=0.1)


def test_a_weighted_median_is_that_of_repeated_values():
    implied, count = np.array([0.1, 0.004, 0.006, 0.005]), np.array([40, 30, 30, 10])
    points = np.sort(np.repeat(implied, count))
    assert weighted_median(implied, count) == points[(len(points) - 1) // 2]
    assert weighted_median(np.zeros(0), np.zeros(0, np.int64)) == 0.0
