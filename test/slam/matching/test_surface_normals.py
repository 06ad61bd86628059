"""Normals from several scans, and a corridor of which noise must not be taken for knowledge."""

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.slam.matching.alignment import Prior, align
from tccm_ros.slam.matching.buckets import BUCKET
from tccm_ros.slam.matching.level_scan import LevelScan, make_level_scan
from tccm_ros.slam.matching.line_map import LineMap, make_line_map
from tccm_ros.slam.matching.surface_normals import fit_missing_normals, mean_normals

FLATNESS = 0.2  # thickness over length of a neighbourhood with a normal
PRIOR_SIGMA = 0.08  # rad, of a single normal of an ordinary laser
PRIOR_FREEDOM = 20.0  # degrees of freedom of that prior
RADIUS = 0.2  # m, of the neighbourhood of a missing normal

CORRIDOR = np.array([[[-40.0, 1.0], [40.0, 1.0]], [[-40.0, -1.0], [40.0, -1.0]]])
NOISE = 0.025


def unit(angles):
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def corridor_map(walls=CORRIDOR, sigma=NOISE, seed=0):
    """Twenty scans along x from -3 m on, in one map at their true poses, and a scan at 0."""
    poses = np.column_stack([np.linspace(-3.0, 3.0, 21), np.zeros((21, 2))])
    run = plan.drive(walls, poses, seed=seed, sigma=sigma, mount=(0, 0, 0))
    scans = [make_level_scan(s, Config()) for s in run.scans]
    lines = make_line_map(poses, scans)
    again = plan.drive(walls, np.zeros((1, 3)), seed=seed + 99, sigma=sigma, mount=(0, 0, 0))
    return lines, make_level_scan(again.scans[0], Config())


@pytest.mark.parametrize("seed", range(5))
def test_mean_normals_are_those_of_a_loop_over_groups(seed):
    random = np.random.default_rng(seed)
    normals = unit(random.normal(size=40) * 0.1)
    normals[random.random(40) < 0.2] = 0.0
    owner = np.arange(40)
    owner[10:] = random.integers(0, 10, 30)
    mean, variances = mean_normals(normals, owner)
    squares, freedom, sizes = 0.0, 0, {}
    for j in range(40):
        members = [i for i in range(40) if owner[i] == j and normals[i].any() and normals[j].any()]
        if not members:
            assert not mean[j].any()
            assert variances[j] == 0.0
            continue
        expected = normals[members].sum(axis=0)
        assert mean[j] == pytest.approx(expected / np.linalg.norm(expected))
        angles = np.arctan2(*normals[members].T[::-1])
        squares += ((angles - np.arctan2(expected[1], expected[0])) ** 2).sum()
        freedom += len(members) - 1
        sizes[j] = len(members)
    squares += PRIOR_FREEDOM * PRIOR_SIGMA**2
    freedom += PRIOR_FREEDOM
    for j, size in sizes.items():
        # Cosines instead of squared angles: alike to a hundredth at 0.1 rad.
        assert variances[j] == pytest.approx(squares / freedom / size, rel=0.02)


def test_missing_normals_are_those_of_a_fit_to_all_points_around():
    lines, _ = corridor_map(np.concatenate([CORRIDOR, plan.box(1.0, 0.7, 1.4, 1.0)]))
    random = np.random.default_rng(3)
    points = np.concatenate([lines.points + random.normal(size=lines.points.shape) * 0.01] * 3)
    normals, variances = lines.normals.copy(), lines.variances.copy()
    missing = random.random(len(normals)) < 0.3
    normals[missing] = 0.0
    lasers = np.zeros_like(lines.points)
    missing = ~normals.any(axis=1)
    kept = normals[~missing].copy()
    fit_missing_normals(lines.points, normals, variances, lasers, lines.buckets, points)
    assert np.array_equal(normals[~missing], kept)
    fitted = 0
    for k in np.flatnonzero(missing):
        near = points[np.hypot(*(points - lines.points[k]).T) < RADIUS]
        if len(near) < 4:
            assert not normals[k].any()
            continue
        values, vectors = np.linalg.eigh(np.cov(near.T, bias=True))
        if values[0] > FLATNESS**2 * values[1]:
            assert not normals[k].any()
            continue
        fitted += 1
        assert abs(vectors[:, 0] @ normals[k]) == pytest.approx(1.0, abs=1e-6)
        assert normals[k] @ lines.points[k] <= 0.0
        expected = values[0] / values[1] / (len(near) - 2.0)
        assert variances[k] == pytest.approx(expected, abs=1e-9)
    assert fitted > 20
    assert BUCKET > RADIUS


@pytest.mark.parametrize("seed", range(6))
def test_noise_of_normals_gives_no_information_along_a_plain_corridor(seed):
    """From 0.4 m ahead the match goes to where it is expected, and its information says so."""
    lines, scan = corridor_map(seed=seed)
    prior = np.array([0.05, 0.0, 0.0])
    loose = np.diag([25.0, 25.0, 100.0])
    start = np.add(prior, [0.4, 0.0, 0.0])
    result = align(lines, scan.points, scan.normals, start, 0.02, Prior(prior, loose))
    along, across = np.diag(result.information)[:2]
    assert along < 0.01 * across
    # Four beams count as one: within a standard deviation of where it was expected.
    assert abs(result.pose[0] - prior[0]) < (along / 4.0 + loose[0, 0]) ** -0.5
    assert abs(result.pose[0] - prior[0]) < 0.05
    # Across: noise of 25 mm, 100 beams.
    assert abs(result.pose[1]) < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_a_wall_ahead_gives_information_in_spite_of_noise(seed):
    walls = np.concatenate([CORRIDOR, [[[6.0, -1.0], [6.0, 1.0]]]])
    lines, scan = corridor_map(walls, seed=seed)
    start = np.array([0.1, 0.0, 0.0])
    result = align(lines, scan.points, scan.normals, start, 0.02)
    # Some ten beams on it, and its map is as noisy as they are.
    assert abs(result.pose[0]) < 0.03
    assert result.information[0, 0] > 1000.0


def test_an_empty_map_has_no_normals():
    nothing = np.zeros((0, 2))
    scan = LevelScan(0, np.zeros(3), nothing, np.zeros(2), nothing, nothing)
    lines = make_line_map(np.zeros((1, 3)), [scan])
    assert isinstance(lines, LineMap)
    assert len(lines.variances) == 0


def test_noise_removes_few_normals():
    """At 1.2 m from a wall, noise of 25 mm is a fifth of what a few beams span."""
    _, scan = corridor_map()
    near = np.hypot(*scan.points.T) < 3.0
    assert scan.normals[near].any(axis=1).mean() > 0.95
    off = np.abs(scan.normals[near & scan.normals.any(axis=1), 0])
    assert np.sqrt(np.mean(off**2)) < 0.15
