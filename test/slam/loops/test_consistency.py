from dataclasses import replace

import numpy as np
import pytest

from tccm_ros.geometry import between2, compose2
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.loops.consistency import consistent_with, select_loops
from tccm_ros.slam.loops.matching import Proposal

COV = np.diag([0.02**2, 0.02**2, 0.006**2])


def two_laps(drift=0.004, seed=0):
    """Return true poses of two rounds of a circle, drifted ones, and path lengths."""
    random = np.random.default_rng(seed)
    step = np.array([0.5, 0.0, 2 * np.pi / 100])
    truth, found, steps = [np.zeros(3)], [np.zeros(3)], [np.zeros(3)]
    for _ in range(199):
        wrong = step + [0, 0, drift] + random.normal(size=3) * [0.005, 0.005, 0.001]
        steps.append(wrong)
        truth.append(compose2(truth[-1], step))
        found.append(compose2(found[-1], wrong))
    return np.stack(truth), np.stack(found), np.stack(steps), 0.5 * np.arange(200)


def loops(truth, wrong_fraction, seed=1):
    """Return proposals between the laps, and which are right; wrong ones are anywhere near."""
    random = np.random.default_rng(seed)
    made, right = [], []
    for b in range(105, 199, 3):
        good = random.random() >= wrong_fraction
        delta = between2(truth[b - 100], truth[b]) + random.normal(size=3) * np.sqrt(np.diag(COV))
        if not good:
            delta = delta + random.uniform(-1, 1, size=3) * [4.0, 4.0, 1.0]
        made.append(Proposal(b - 100, b, delta, COV, 0.9, 0.8, 2.0))
        right.append(good)
    return made, np.array(right)


@pytest.mark.parametrize("seed", range(4))
def test_right_proposals_are_consistent_when_half_of_all_are_wrong(seed):
    truth, found, _, path = two_laps(seed=seed)
    made, right = loops(truth, 0.5, seed)
    agree = np.array([consistent_with(p, made, found, path) for p in made])
    assert agree[np.ix_(right, right)].mean() > 0.95
    # Of those a few metres off, some are by chance as good as right: within 0.25 m of it.
    assert agree[np.ix_(~right, right)].mean() < 0.25


@pytest.mark.parametrize("seed", range(3))
def test_graduated_non_convexity_drops_the_wrong_half_of_the_loop_closures(seed):
    truth, found, steps, _ = two_laps(drift=0.001, seed=seed)
    made, right = loops(truth, 0.5, seed)
    chain, cov = KeyframeChain(), np.diag([0.01**2, 0.01**2, 0.002**2])
    for k, (pose, delta) in enumerate(zip(found, steps)):
        chain.add(GraphKeyframe(k, None, pose, delta, cov), np.zeros(0))
    poses, kept = select_loops(chain.graph(found, {}), chain.keys, made)
    # A wrong one may by chance lie within the noise of a right one: none is dropped wrongly.
    assert not np.any(kept & ~right)
    assert kept[right].mean() > 0.9
    error = between2(poses[:90], poses[100:190]) - between2(truth[:90], truth[100:190])
    assert np.hypot(*error[:, :2].T).max() < 0.1


def test_proposal_uncertain_along_a_corridor_confirms_no_position():
    """It is consistent with others like it across the corridor; along it, any of them are."""
    truth, _, _, path = two_laps(drift=0.0)
    made, _ = loops(truth, 0.0)
    along = np.diag([20.0**2, 0.02**2, 0.006**2])
    vague = [replace(p, cov=along) for p in made]
    assert consistent_with(vague[0], vague[1:6], truth, path).all()
    assert not consistent_with(made[0], vague[1:6], truth, path).any()
    assert not consistent_with(vague[0], made[1:6], truth, path).any()
    # Off by 3 m in b's own frame: along x it may be, across it may not.
    ahead, beside = (
        replace(vague[0], delta=compose2(vague[0].delta, shift))
        for shift in ([3.0, 0.0, 0.0], [0.0, 3.0, 0.0])
    )
    assert consistent_with(ahead, vague[:1], truth, path).all()
    assert not consistent_with(beside, vague[:1], truth, path).any()


def test_proposals_of_one_pass_agree_and_a_shifted_one_does_not():
    truth, _, _, path = two_laps(drift=0.0)
    made, _ = loops(truth, 0.0)
    assert consistent_with(made[0], made[1:6], truth, path).all()
    shifted = Proposal(5, 105, np.add(made[0].delta, [3.0, 0, 0]), COV, 0.9, 0.8, 2.0)
    assert not consistent_with(shifted, made[1:6], truth, path).any()
    assert consistent_with(shifted, [], truth, path).shape == (0,)
