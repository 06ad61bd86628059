from pathlib import Path

import numpy as np
import pytest

from tccm_ros.baselines.seed_segmentation import cluster, segment
from tccm_ros.config import Config
from tccm_ros.replay.run import run_bag

BAGS = Path(__file__).resolve().parents[2] / "bags"


def board(x, y, z, count, seed, noise=0.003):
    rng = np.random.default_rng(seed)
    return np.c_[
        x + rng.uniform(-0.4, 0.4, count),
        y + rng.uniform(-0.3, 0.3, count),
        z + rng.normal(0, noise, count),
    ]


def wall(count, seed):
    rng = np.random.default_rng(seed)
    return np.c_[
        3 + rng.normal(0, 0.003, count), rng.uniform(-2, 2, count), rng.uniform(0, 2, count)
    ]


def test_boards_are_found_and_walls_are_not():
    parts = [board(1, 0, 0.7, 1500, 1), board(1, 1.5, 0.7, 1500, 2), wall(6000, 3)]
    labels = segment(np.concatenate(parts), Config())
    first, second = labels[:1500], labels[1500:3000]
    assert len({*np.unique(first[first >= 0]), *np.unique(second[second >= 0])}) == 2
    assert min((first >= 0).mean(), (second >= 0).mean()) > 0.99
    assert (labels[3000:] >= 0).mean() < 0.05


def test_a_plane_is_refitted_to_its_inliers():
    """Of points with a noise of 8 mm, 98.8 % are within 20 mm of the least-squares plane.

    The best plane through three of them is tilted and has one in a hundred less.
    """
    fractions = []
    for seed in range(8):
        clutter = np.random.default_rng(100 + seed).uniform([0, -1.5, 0], [2.5, 1.5, 2], (4000, 3))
        labels = segment(np.concatenate([board(1, 0, 0.7, 1500, seed, 0.008), clutter]), Config())
        on = labels[:1500]
        fractions.append((on == np.bincount(on[on >= 0]).argmax()).mean())
    # Three standard errors of 12,000 points below.
    assert np.mean(fractions) > 0.9876 - 3 * np.sqrt(0.9876 * 0.0124 / 12_000)


def test_a_board_with_few_points_is_missed_as_published():
    points = np.concatenate([board(1, 0, 0.7, 1500, 1), board(2, 1.5, 0.9, 300, 2)])
    assert np.all(segment(points, Config())[1500:] == -1)


@pytest.mark.parametrize(("count", "surfaces"), [(450, 1), (499, 1), (501, 2)])
def test_a_cluster_of_a_plane_needs_500_points_as_published(count, surfaces):
    """A large board and, 2 m beside it in the same plane, a small dense one."""
    small = board(0, 2.5, 0.7, count, 2) * [0.25, 1.0, 1.0]
    labels = segment(np.concatenate([board(1, 0, 0.7, 1500, 1), small]), Config())
    assert len(set(labels[labels >= 0])) == surfaces
    assert np.all(labels[1500:] >= 0) == (surfaces == 2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_board_is_horizontal_whichever_way_its_normal_points(monkeypatch, sign):
    """The sign of an eigenvector is LAPACK's choice: here it is made up or down."""
    eigh = np.linalg.eigh

    def signed(matrix):
        values, vectors = eigh(matrix)
        return values, vectors * sign * np.sign(vectors[2])

    monkeypatch.setattr(np.linalg, "eigh", signed)
    labels = segment(board(1, 0, 0.7, 800, 1), Config())
    assert (labels == 0).mean() > 0.99


def test_the_same_cloud_gives_the_same_surfaces():
    points = np.concatenate([board(1, 0, 0.7, 900, 1), wall(3000, 3)])
    np.testing.assert_array_equal(segment(points, Config()), segment(points, Config()))


@pytest.mark.parametrize("count", [0, 2, 499])
def test_too_few_points_are_no_surface(count):
    assert np.all(segment(board(0, 0, 0.5, count, 0), Config()) == -1)


def test_clusters_equal_brute_force():
    points = np.random.default_rng(5).uniform(0, 1.2, (300, 3))
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= 0.1
    expected = np.arange(300)
    for _ in range(300):
        lower = np.where(near, expected[None, :], 300).min(axis=1)
        if np.array_equal(lower, expected):
            break
        expected = lower
    labels = cluster(points, 0.1)
    np.testing.assert_array_equal(labels, np.unique(expected, return_inverse=True)[1])


def test_a_replay_with_the_baseline_makes_surface_messages():
    seed = Config.model_validate({"surfaces": {"segmentation": "seed"}})
    cycles = []
    outcome = run_bag(BAGS / "walkthrough", seed, on_cycle=lambda cycle, _: cycles.append(cycle))
    assert cycles
    for cycle in cycles:
        counts = np.bincount(cycle.surfaces.surface)
        assert np.all(counts >= seed.surfaces.min_points)
    assert outcome.solution.floor_z == pytest.approx(0.0, abs=0.005)
    (table,) = [s for s in outcome.solution.surfaces if s.label != "floor" and s.area > 0.5]
    assert table.height == pytest.approx(0.700, abs=0.005)
    assert len(outcome.cycles[-1].planes) > 1, "the planes of the TCCM are there all the same"
