"""Chords of curved surfaces are no walls: held against trying all, and against round halls."""

from itertools import combinations, pairwise, product

import numpy as np
import plan
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from tccm_ros.config import Config
from tccm_ros.geometry import between2
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.slam.walls.line_curves import curved_segments
from tccm_ros.slam.walls.line_split import split_segments
from tccm_ros.slam.walls.lines import extract_lines

MAX_GAP, MIN_BEND = 0.6, 0.08


def residuals(points, degree):
    """Return the squared residuals across the chord, and the curvature of a polynomial."""
    along = points[-1] - points[0]
    frame = np.array([along, [-along[1], along[0]]]) / np.hypot(*along)
    t, y = frame @ (points - points.mean(axis=0)).T
    fit = Polynomial.fit(t, y, degree)
    return np.sum((y - fit(t)) ** 2), abs(fit.deriv(2)(0.0))


def curved_by_hand(beams, labels):
    """Try all ways to cut the scan into runs of pieces, and a line or an arc for each run."""
    pieces = [beams[labels == k] for k in range(labels.max() + 1)]
    gaps = [np.hypot(*(b[0] - a[-1])) > MAX_GAP for a, b in pairwise(pieces)]
    variance = sum(residuals(p, 1)[0] for p in pieces) / sum(len(p) - 2 for p in pieces)
    parameter, best = np.log(len(beams)), (np.inf, None)
    shapes = {}
    for first, last in combinations(range(len(pieces) + 1), 2):
        run = np.concatenate(pieces[first:last])
        arc, curvature = residuals(run, 2)
        bend = curvature * np.hypot(*(run[-1] - run[0])) * (1.0 - 1.0 / (last - first))
        shapes[first, last] = residuals(run, 1)[0], arc, bend
    for cuts in product([False, True], repeat=len(gaps)):
        if any(gap and not cut for gap, cut in zip(gaps, cuts)):
            continue
        ends = [k + 1 for k, cut in enumerate(cuts) if cut]
        total, curved = 0.0, np.zeros(len(pieces), bool)
        for first, last in pairwise([0, *ends, len(pieces)]):
            line, arc, bend = shapes[first, last]
            # Of a line two parameters, of an arc three; where they end is one more.
            costs = [line / variance + 3 * parameter, arc / variance + 4 * parameter]
            if last - first > 1 and costs[1] < costs[0]:
                curved[first:last] = bend > MIN_BEND
                total += costs[1]
            else:
                total += costs[0]
        if total < best[0]:
            best = total, curved
    return best[1]


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.003, 0.01, 0.03]))
@example(33513, 0.003)  # an arc of more pieces leaves less
def test_curved_pieces_are_those_of_the_best_cut(seed, sigma):
    """A run of straight and curved surfaces, joined, with noise, cut anywhere."""
    rng = np.random.default_rng(seed)
    bends = np.cumsum(np.repeat(rng.normal(0.0, 0.05, 4) * rng.integers(0, 2, 4), 30))
    bends += np.repeat(rng.normal(0.0, 0.3, 4), 30)
    steps = 0.06 * np.stack([np.cos(bends), np.sin(bends)], axis=1)
    beams = np.cumsum(steps, axis=0) + rng.normal(0.0, sigma, (120, 2)) + [0.0, 3.0]
    cuts = 3 * np.sort(rng.choice(np.arange(1, 39), 6, replace=False))
    labels = np.searchsorted(cuts, np.arange(120), side="right").astype(np.int32)
    found = curved_segments(beams, labels, MAX_GAP, MIN_BEND)
    assert np.array_equal(found, curved_by_hand(beams, labels))


def hall(radius, sides=720):
    angles = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.stack([ring[:-1], ring[1:]], axis=1)


def beams_in(walls, pose, sigma, seed=0, count=720):
    bearings = np.linspace(-np.pi, np.pi, count, endpoint=False)
    ranges = plan.cast(walls, np.asarray(pose, float), bearings, max_range=40.0)
    ranges = ranges + np.random.default_rng(seed).normal(size=count) * sigma
    rays = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    return rays * ranges[:, None]


@pytest.mark.parametrize("radius", [2.0, 6.0, 15.0])
@pytest.mark.parametrize("sigma", [0.003, 0.01])
def test_a_round_hall_has_hardly_any_walls(radius, sigma):
    beams = beams_in(hall(radius), (0.3 * radius, 0.1, 0.4), sigma)
    x = Config().lines
    pieces = split_segments(beams, x.distance, x.max_gap, x.min_points)
    assert pieces.max() > 10, "there are no chords to be found"
    lines = extract_lines(beams, np.zeros(2), Config())
    assert lines.count.sum() < 0.05 * len(beams)


@pytest.mark.parametrize("sides", [4, 6, 12])
def test_the_sides_of_a_polygon_are_walls(sides):
    beams = beams_in(hall(6.0, sides), (1.0, 0.5, 0.3), 0.005)
    lines = extract_lines(beams, np.zeros(2), Config())
    assert len(lines) >= sides
    assert lines.count.sum() > 0.9 * len(beams)


def test_a_wall_that_noise_has_cut_stays_a_wall():
    """Beside a laser beams are dense: one of hundreds is off by more than a line allows."""
    walls = np.array([[[-9.0, 1.0], [9.0, 1.0]]])
    for seed in range(20):
        bearings = np.linspace(0.1, np.pi - 0.1, 720)
        ranges = plan.cast(walls, np.zeros(3), bearings)
        ranges = ranges + np.random.default_rng(seed).normal(size=720) * 0.012
        beams = np.stack([np.cos(bearings), np.sin(bearings)], axis=1) * ranges[:, None]
        lines = extract_lines(beams, np.zeros(2), Config())
        assert np.hypot(*(lines.endpoints[:, 1] - lines.endpoints[:, 0]).T).max() > 5.0


def turned_in_hall(walls_enabled, seed):
    """Return the error of the last yaw in a round hall, and what the covariance says of it."""
    poses = plan.route([(0, 0), (3, 0), (3, 2), (-3, 2), (-3, -2), (1, 0.5)])
    run = plan.drive(hall(6.0), poses, seed=seed, drift=0.0, scale=1.0, noise=(0.02, 0.02))
    config = Config()
    config.walls.enabled = walls_enabled
    slam = WallSlam(config)
    for scan in run.scans:
        slam.add_scan(scan)
    solution = slam.solve()
    last = solution.keyframes[-1]
    at = int(np.searchsorted(run.stamps_ns, last.stamp_ns))
    error = between2(run.truth[at], last.pose)[2]
    return error, error**2 / solution.cov_keyframes[-1][2, 2]


def test_walls_of_a_round_hall_do_not_observe_the_yaw():
    """Of a rotation about the middle nothing is seen: the error is that without walls."""
    with_walls, without = (
        np.array([turned_in_hall(enabled, seed) for seed in range(8)]) for enabled in (True, False)
    )
    rms = [np.sqrt(np.mean(found[:, 0] ** 2)) for found in (with_walls, without)]
    assert rms[0] < 1.1 * rms[1]
    # Of eight draws of one degree of freedom, 99.9 % of the sums are below.
    assert with_walls[:, 1].mean() < 26.1 / 8
