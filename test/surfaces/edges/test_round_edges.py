"""Circles and ellipses are fitted to last points, as straight edges are."""

from types import SimpleNamespace

import numpy as np
import pytest

from tccm_ros.outlines.edge_position import EdgeSamples
from tccm_ros.outlines.shape_models import RoundModel
from tccm_ros.records import SurfaceShape
from tccm_ros.surfaces.edges.round_edges import edge_jacobian, refine_round

VIEWS, GAP, NOISE = 12, 0.01, 0.004
"""Views, the distance of their samples and the noise of these, m."""


def model(shape, center, yaw, radii):
    c, s = np.cos(yaw), np.sin(yaw)
    return RoundModel(shape, np.array(center), np.array([[c, s], [-s, c]]), np.array(radii))


def sampler_of(truth, rng, seen=lambda middle: True):
    """Return the last points of views before the edge of a true top, anywhere within the gap."""
    outline = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    ring = truth.center + np.stack([np.cos(outline), np.sin(outline)], 1) * truth.radii @ truth.axes

    def edge_samples(edge):
        if not seen(0.5 * (edge.start + edge.end)):
            return EdgeSamples(*np.zeros((4, 0)), np.zeros(0, bool), np.zeros(0))
        at, across = (ring - edge.start) @ edge.along, (ring - edge.start) @ edge.outward
        near = np.abs(across) < 0.2
        order = np.argsort(at[near])
        places = np.linspace(0.04, edge.length - 0.04, 5)
        ends = np.interp(places, at[near][order], across[near][order])
        last = ends - rng.uniform(0.0, GAP, (VIEWS, 5)) + rng.normal(0.0, NOISE, (VIEWS, 5))
        rows = np.ones(last.size)
        return EdgeSamples(
            np.tile(places, VIEWS), last.ravel(), GAP * rows, 0.0 * rows, rows > 0.0, rows
        )

    return SimpleNamespace(edge_samples=edge_samples)


TABLES = {
    "circle": (SurfaceShape.CIRCLE, (1.0, 2.0), 0.0, (0.5, 0.5)),
    "ellipse": (SurfaceShape.ELLIPSE, (1.0, 2.0), 0.4, (0.4, 0.7)),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_union_of_outlines_that_is_too_large_shrinks_to_the_true_top(name):
    shape, center, yaw, radii = TABLES[name]
    guess = model(shape, np.add(center, (0.01, -0.015)), yaw, np.array(radii) + 0.02)
    truth = model(shape, center, yaw, radii)
    found, _ = refine_round(guess, sampler_of(truth, np.random.default_rng(3)))
    assert found.center == pytest.approx(truth.center, abs=0.003)
    assert found.radii == pytest.approx(truth.radii, abs=0.003)


def test_edge_fitted_to_half_a_round_top_is_within_its_covariance():
    """The other half is out of view: its edge is open, and its deviation larger."""
    truth = model(*TABLES["circle"])
    guess = model(SurfaceShape.CIRCLE, (1.01, 2.0), 0.0, (0.51, 0.51))
    sampler = sampler_of(truth, np.random.default_rng(4), lambda middle: middle[0] < 1.0)
    found, cov = refine_round(guess, sampler)
    error = np.r_[found.center - truth.center, found.radii[0] - truth.radii[0]]
    J, _ = edge_jacobian(found, np.array([np.pi, 0.0]))
    near, far = np.sqrt(np.einsum("ki,ij,kj->k", J, cov, J))
    assert abs(J[0] @ error) < 0.003
    assert abs(J[1] @ error) < 3.0 * far + 0.003
    assert far > 2.0 * near


def test_a_top_of_which_no_edge_was_seen_stays():
    truth = model(*TABLES["circle"])
    found, cov = refine_round(truth, sampler_of(truth, np.random.default_rng(5), lambda _: False))
    assert found is truth
    assert np.isnan(cov).all()
    assert cov.shape == (3, 3)


def test_round_fit_extrapolated_beyond_the_search_range_is_refused():
    """The ends of a sliver have no tangents of their own: its middle would move one of them far."""
    guess = model(SurfaceShape.ELLIPSE, (0.0, 0.0), 0.0, (0.65, 0.07))
    truth = model(SurfaceShape.ELLIPSE, (0.6, 0.0), 0.0, (1.3, 0.09))
    sampler = sampler_of(truth, np.random.default_rng(6), lambda middle: abs(middle[0]) < 0.5)
    found, cov = refine_round(guess, sampler)
    assert found is guess
    assert np.isnan(cov).all()
