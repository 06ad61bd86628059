"""An edge lies within the sampling of the last points before it; views together know it better."""

import numpy as np
import pytest
from scipy.stats import norm

from tccm_ros.outlines.edge_position import EdgeSamples, locate_edge

FADE = 0.06  # m, decay of the density of an edge where the view did not look
HALF_RANGE = 0.15  # m, of the candidate positions on each side of the first guess
OUTLIER = 0.05  # fraction of last samples at occluded edges
OUTLIER_BEYOND = 0.2  # factor on the density of outliers beyond the edge
SIGMA = 0.006  # m, of a last sample: range noise, pose noise, thinning


def samples(last, gap, *, front=0.0, ends=True):
    last = np.asarray(last, float)
    n = len(last)
    return EdgeSamples(
        np.linspace(0.0, 1.0, n), last, np.full(n, gap), np.full(n, front), np.full(n, ends),
        np.ones(n),
    )  # fmt: skip


def log_density(found, across):
    """Return the log likelihood of positions of an edge, term by term."""
    log = np.zeros(len(across))
    for last, gap, front, ends, weight in zip(*found[1:]):
        gap = max(gap, SIGMA)
        inside = norm.cdf((across - last) / SIGMA)
        if ends:
            inside *= norm.cdf((last + gap - across) / SIGMA)
        else:
            inside *= np.exp(-np.maximum(across - last - gap, 0.0) / FADE)
        at_edge = norm.pdf(across, last - SIGMA / np.sqrt(np.pi), SIGMA)
        outlier = OUTLIER / HALF_RANGE
        outlier = np.where(across > last - SIGMA, outlier, OUTLIER_BEYOND * outlier)
        log += weight * np.log(outlier + front * at_edge + (1.0 - front) * inside / gap)
    return log


def by_integral(found):
    """Return median and deviation of the same density, on a grid ten times as fine."""
    across = np.arange(-HALF_RANGE, HALF_RANGE, 2e-4)
    log = log_density(found, across)
    density = np.exp(log - log.max())
    density /= density.sum()
    mean = density @ across
    median = across[np.searchsorted(np.cumsum(density), 0.5)]
    return median, np.sqrt(density @ (across - mean) ** 2)


@pytest.mark.parametrize("front", [0.0, 0.6])
@pytest.mark.parametrize("ends", [True, False])
def test_the_position_is_that_of_the_fine_integral(front, ends):
    rng = np.random.default_rng(3)
    found = samples(rng.uniform(-0.05, 0.01, 7), 0.04, front=front, ends=ends)
    assert locate_edge(found) == pytest.approx(by_integral(found), abs=5e-4)


@pytest.mark.parametrize("true", [-0.03, 0.0, 0.04])
def test_an_edge_of_even_samples_is_found_within_its_deviation(true):
    """40 edges of six scan lines each, one each 4 cm: errors are as large as their sigmas say."""
    rng = np.random.default_rng(5)
    errors, sigmas = [], []
    for _ in range(40):
        last = true - rng.uniform(0.0, 0.04, 6) + rng.normal(0.0, SIGMA, 6)
        position, sigma = locate_edge(samples(last, 0.04))
        errors.append(position - true)
        sigmas.append(sigma)
    rms = float(np.sqrt(np.mean(np.square(errors))))
    assert 0.6 < rms / np.mean(sigmas) < 1.5
    assert rms < 0.04 / np.sqrt(12.0)  # better than one scan line alone


def test_more_views_make_an_edge_sharper():
    one = locate_edge(samples([-0.02], 0.04))[1]
    four = locate_edge(samples([-0.035, -0.02, -0.01, -0.002], 0.04))[1]
    assert four < 0.7 * one


def test_an_object_before_an_edge_does_not_move_it():
    clean, _ = locate_edge(samples([-0.01] * 8, 0.02))
    disturbed, _ = locate_edge(samples([-0.01] * 8 + [-0.09] * 3, 0.02))
    assert disturbed == pytest.approx(clean, abs=2e-3)


def test_an_edge_near_a_wall_is_at_the_wall():
    found = samples([-0.03, -0.02], 0.05, ends=False)
    position, sigma = locate_edge(found, wall=0.01)
    assert position == pytest.approx(0.01, abs=5e-3)
    assert sigma < 0.7 * locate_edge(found)[1]


def test_no_edge_is_behind_a_wall():
    position, _ = locate_edge(samples([-0.01], 0.08, ends=False), wall=0.0)
    assert position < 0.006


def test_points_of_a_wall_behind_an_edge_do_not_move_it():
    clean, _ = locate_edge(samples([-0.01] * 8, 0.02))
    disturbed, _ = locate_edge(samples([-0.01] * 8 + [0.06] * 2, 0.02))
    assert disturbed == pytest.approx(clean, abs=2e-3)


def test_the_outermost_points_of_a_front_are_further_out_than_the_front():
    """Each of 300 edges has six last points, each the outermost of two; the mean has no bias."""
    rng = np.random.default_rng(6)
    errors = [
        locate_edge(samples(rng.normal(0.0, SIGMA, (6, 2)).max(axis=1), 0.04, front=1.0))[0]
        for _ in range(300)
    ]
    assert np.mean(errors) == pytest.approx(0.0, abs=5e-4)
