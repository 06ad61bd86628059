import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.baselines.line_ransac import _count, _support, label_by_ransac
from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.slam.walls.lines import label_by_splitting


@pytest.fixture(scope="module")
def beams() -> np.ndarray:
    """A corner of two noisy walls, on which the two methods do not give the same labels."""
    rng = np.random.default_rng(4)
    along = np.linspace(0.0, 3.0, 120)
    far = np.column_stack((np.full(120, 2.0), along - 1.0))
    side = np.column_stack((2.0 - along, np.full(120, 2.0)))
    return np.concatenate((far, side)) + rng.normal(0.0, 0.02, (240, 2))


@pytest.mark.parametrize(
    ("extractor", "label"), [("split_merge", label_by_splitting), ("ransac", label_by_ransac)]
)
def test_the_setting_of_the_extractor_chooses_the_labelling_of_beams(extractor, label, beams):
    config = Config()
    config.lines.extractor = extractor
    labels = SurfaceSlam(config).wall_slam.label(beams, config)
    other = label_by_ransac if extractor == "split_merge" else label_by_splitting
    assert np.array_equal(labels, label(beams, config))
    assert not np.array_equal(labels, other(beams, config))


def noisy_wall(seed: int) -> np.ndarray:
    """A wall of 120 beams with a noise of 15 mm, half the distance of an inlier."""
    rng = np.random.default_rng(seed)
    along = np.linspace(-1.0, 2.0, 120)
    return np.column_stack((np.full(120, 2.0), along)) + rng.normal(0.0, 0.015, (120, 2))


def largest_support(beams: np.ndarray, distance: float) -> int:
    """Return how many beams are near the best of all lines through two of them."""
    i, j = np.triu_indices(len(beams), 1)
    d = beams[j] - beams[i]
    x, y = np.moveaxis(beams[None] - beams[i][:, None], 2, 0)
    off = (d[:, :1] * y - d[:, 1:] * x) / np.hypot(*d.T)[:, None]
    return int((np.abs(off) <= distance).sum(axis=1).max())


def test_inliers_are_within_the_distance_of_their_line():
    """Points 60 mm beside an exact wall: twice the distance, so of another line or of none."""
    wall = np.column_stack((np.full(100, 2.0), np.linspace(-1.0, 1.0, 100)))
    beside = wall[::10] + np.array([0.06, 0.0])
    config = Config()
    assert config.lines.distance == 0.03
    labels = label_by_ransac(np.concatenate((wall, beside)), config)
    assert np.all(labels[:100] == 0)
    assert not np.any(labels[100:] == 0)


def test_the_line_with_the_largest_support_is_kept():
    """60 pairs of a wall: the best is near the best of all 7,140, the last one mostly is not."""
    config = Config()
    fractions = []
    for seed in range(8):
        beams = noisy_wall(seed)
        found = int((label_by_ransac(beams, config) == 0).sum())
        fractions.append(found / largest_support(beams, config.lines.distance))
    assert min(fractions) > 0.95


def inliers_by_hand(beams, free, i, j, distance, max_gap):
    """The free beams near the line through two of them that no gap parts from the first."""
    direction = (beams[j] - beams[i]) / np.hypot(*(beams[j] - beams[i]))
    offset = beams - beams[i]
    along = offset @ direction
    away = offset @ [-direction[1], direction[0]]
    near = sorted((k for k in free if abs(away[k]) <= distance), key=lambda k: along[k])
    at = near.index(i)
    low = high = at
    while low > 0 and along[near[low]] - along[near[low - 1]] <= max_gap:
        low -= 1
    while high + 1 < len(near) and along[near[high + 1]] - along[near[high]] <= max_gap:
        high += 1
    return near[low : high + 1]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_support_of_a_line_ends_at_gaps(seed):
    rng = np.random.default_rng(seed)
    across = rng.normal(0.0, 0.03, 80)
    yaw, origin = rng.uniform(-np.pi, np.pi), rng.uniform(-3.0, 3.0, 2)
    direction = np.array([np.cos(yaw), np.sin(yaw)])
    along = np.cumsum(rng.exponential(0.05, 80))
    beams = origin + along[:, None] * direction + across[:, None] * [-direction[1], direction[0]]
    free = np.sort(rng.permutation(80)[:70])
    for i, j in rng.permutation(free)[:10].reshape(5, 2):
        expected = inliers_by_hand(beams, free.tolist(), i, j, 0.03, 0.15)
        assert _support(beams, free, i, j, 0.03, 0.15).tolist() == expected
        xs, ys = beams[free, 0], beams[free, 1]
        everywhere = inliers_by_hand(beams, free.tolist(), i, j, 0.03, np.inf)
        assert _count(xs, ys, beams[i], beams[j], 0.03) == len(everywhere)
