"""What views know of edges: where points end, and whether a view looked past the surface."""

import numpy as np
import pytest
from room import Board, Room
from surface_maps import build

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.surfaces.edge_samples import Edge, EdgeSampler
from tccm_ros.surfaces.merged_surface import fit_surface
from tccm_ros.surfaces.surface_slam import SurfaceSlam

TABLE = Board(1.6, 0.0, 0.8, 1.2, 0.74)
T = spatial(np.zeros((1, 3)))


@pytest.fixture(scope="module")
def sampler():
    surface_map = SurfaceSlam(Config()).map
    for record in Room([TABLE]).look((0.0, 0.0, 0.0), 10):
        surface_map.add(record)
    mapped = build([(Room([TABLE]), (0.0, 0.0, 0.0), 10)])
    of_table = next(m for m, s in zip(mapped.members, mapped.surfaces) if s.label != "floor")
    views = surface_map.views
    return EdgeSampler(fit_surface(of_table, views, T, Config()), views, T)


def test_an_edge_has_its_surface_on_the_left():
    edge = Edge(np.array([0.0, 0.0]), np.array([2.0, 0.0]))
    assert edge.length == 2.0
    assert edge.outward == pytest.approx([0.0, -1.0])


def test_the_outline_is_sampled_all_round_and_seen_beyond(sampler):
    samples = sampler.outline_samples()
    away = samples.points - [TABLE.x, TABLE.y]
    assert ((samples.outward * away).sum(axis=1) > 0.0).mean() > 0.95
    assert samples.seen.mean() > 0.7
    assert np.hypot(*samples.outward.T) == pytest.approx(np.ones(len(samples.points)))


def test_the_last_points_are_within_a_gap_of_a_side(sampler):
    """The left side of the table, seen along it: beams end one gap before it at most."""
    edge = Edge(np.array([2.0, 0.6]), np.array([1.2, 0.6]))
    samples = sampler.edge_samples(edge)
    assert len(samples.at) > 5
    assert samples.ends.mean() > 0.7
    within = (samples.last <= 1e-3) & (samples.last >= -samples.gap - 0.03)
    assert within.mean() > 0.8


def test_views_look_over_what_is_beside_a_table_and_not_over_what_is_far_away(sampler):
    assert sampler.looks_over(Edge(np.array([2.0, 0.6]), np.array([1.2, 0.6])))
    assert not sampler.looks_over(Edge(np.array([-9.0, 0.6]), np.array([-9.8, 0.6])))
