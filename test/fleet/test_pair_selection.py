"""Pairs that contradict the others bend nothing; maps without a pair are their own component."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.fleet.pair_matching import PairLoop, PairMatch, PairReason
from tccm_ros.fleet.pair_selection import select_pairs
from tccm_ros.geometry import between2

POSES = np.array([[0, 0, 0], [5, 1, 0.5], [-3, 4, 2.0], [8, -2, -1.0], [1, 9, 3.0]], float)
LOOP = PairLoop(0, 0, np.zeros(3), np.eye(3), 1.0, 1.0, 1.0)


def match(T, loops=3):
    return PairMatch(PairReason.ACCEPTED, np.asarray(T, float), (LOOP,) * loops)


def right(i, j, noise=0.0, rng=None):
    error = np.zeros(3) if rng is None else rng.normal(size=3) * [noise, noise, noise / 10]
    return match(between2(POSES[i], POSES[j]) + error)


def check_poses(component, poses=POSES):
    for k, T in component.p_root_map.items():
        expected = between2(poses[min(component.p_root_map)], poses[k])
        assert np.allclose(T, expected, atol=0.1)


def test_all_right_pairs_make_one_component_in_the_frame_of_the_first():
    rng = np.random.default_rng(0)
    pairs = {p: right(*p, 0.01, rng) for p in itertools.combinations(range(5), 2)}
    (component,), contradicting = select_pairs(5, pairs)
    assert not contradicting
    assert len(component.pairs) == 10
    assert np.array_equal(component.p_root_map[0], np.zeros(3))
    check_poses(component)


@given(st.sampled_from(list(itertools.combinations(range(5), 2))), st.integers(1, 50))
def test_one_wrong_pair_has_no_effect_for_any_number_of_keyframes(wrong, loops):
    pairs = {p: right(*p) for p in itertools.combinations(range(5), 2)}
    error = np.array([1.0, -2.0, 0.3])
    pairs[wrong] = match(pairs[wrong].p_one_other + error, loops)
    (component,), contradicting = select_pairs(5, pairs)
    assert contradicting == {wrong}
    assert wrong not in component.pairs
    check_poses(component)


def test_unconnected_map_is_its_own_component():
    pairs = {(0, 3): right(0, 3), (1, 4): right(1, 4), (3, 4): right(3, 4)}
    components, _ = select_pairs(5, pairs)
    assert [sorted(c.p_root_map) for c in components] == [[0, 1, 3, 4], [2]]
    for component in components:
        check_poses(component)


def test_maps_without_pairs_stay_separate():
    components, contradicting = select_pairs(3, {})
    assert [list(c.p_root_map) for c in components] == [[0], [1], [2]]
    assert contradicting == set()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_the_order_in_which_pairs_come_has_no_effect(order):
    rng = np.random.default_rng(1)
    known = [((0, 1), right(0, 1, 0.05, rng)), ((1, 2), right(1, 2, 0.05, rng)),
             ((0, 2), right(0, 2, 0.05, rng))]  # fmt: skip
    (component,), _ = select_pairs(3, dict(known[k] for k in order))
    (expected,), _ = select_pairs(3, dict(known))
    assert component.pairs == expected.pairs
    assert all(np.array_equal(component.p_root_map[k], expected.p_root_map[k]) for k in range(3))
