"""Pairs of sides and the poses that they determine: residuals, derivatives, candidates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.geometry import wrap_angle
from tccm_ros.surfaces.registration.side_matching import (
    _candidates,
    _covariance,
    _differ,
    _refine,
    _residuals,
    _solve,
    _system,
)
from tccm_ros.surfaces.registration.sides import Sides

GATE = 3.0  # sigmas: 99.7 % of all measurements
MIN_LENGTH = 0.2  # m, of the overlap of two sides
OPEN_SIGMA = 0.3  # m, rad: the prior, and so the sigma of what no side determines
SAME_POSE = (0.05, np.radians(4.0))  # m, rad, between equal poses
YAW_GATE = np.radians(12.0)  # between sides, beside the search

SEEDS = st.integers(0, 2**32 - 1)
SEARCH = (0.15, 0.1)
HEIGHT_GATE = 0.03


def rotation(yaw):
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def random_sides(seed, pose, errors=(0.0, 0.0), count=8):
    """Return sides in the first frame, and the same ones, with errors, in a frame at `pose`."""
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(-np.pi, np.pi, count)
    outward = np.column_stack([np.cos(yaw), np.sin(yaw)])
    middle, length = rng.uniform(-2.0, 2.0, (count, 2)), rng.uniform(0.25, 1.5, count)
    height, sigma = rng.choice([0.4, 0.7], count), rng.uniform(0.003, 0.01, count)
    first = Sides(np.arange(count), middle, outward, length, height, sigma)
    R = rotation(pose[2])
    seen = (middle + rng.normal(0.0, 1.0, (count, 1)) * errors[0] * outward - pose[:2]) @ R
    turned = yaw - pose[2] + rng.normal(0.0, 1.0, count) * errors[1]
    facing = np.column_stack([np.cos(turned), np.sin(turned)])
    order = rng.permutation(count)
    second = Sides(np.arange(count), seen, facing, length, height, sigma).chosen(order)
    return first, second


def random_pose(seed):
    rng = np.random.default_rng(seed + 1)
    return np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0)])


@given(SEEDS)
def test_candidates_are_pairs_near_each_other_one_by_one(seed):
    pose = random_pose(seed)
    first, second = random_sides(seed, pose, (0.08, 0.15), count=14)
    found = _candidates(first, second, pose, SEARCH, HEIGHT_GATE)
    expected = []
    for a in range(len(first)):
        for b in range(len(second)):
            middle = pose[:2] + rotation(pose[2]) @ second.middle[b] - first.middle[a]
            facing = rotation(pose[2]) @ second.outward[b]
            angle = np.arctan2(
                first.outward[a, 0] * facing[1] - first.outward[a, 1] * facing[0],
                first.outward[a] @ facing,
            )
            along = abs(first.outward[a, 0] * middle[1] - first.outward[a, 1] * middle[0])
            lengths = first.length[a], second.length[b]
            shared = min(min(lengths), 0.5 * sum(lengths) - along)
            limit = SEARCH[0] + SEARCH[1] * np.hypot(*second.middle[b])
            sigma = np.hypot(first.sigma[a], second.sigma[b])
            if (
                abs(first.height[a] - second.height[b]) <= HEIGHT_GATE
                and abs(angle) <= YAW_GATE + SEARCH[1]
                and abs(middle @ first.outward[a]) <= limit + GATE * sigma
                and shared + limit >= MIN_LENGTH
            ):
                expected.append((a, b))
    assert list(zip(found.a.tolist(), found.b.tolist())) == expected


@given(SEEDS)
def test_residuals_are_distance_and_angle_in_deviations(seed):
    pose = random_pose(seed)
    first, second = random_sides(seed, pose, (0.05, 0.05))
    pairs = _candidates(first, second, pose, SEARCH, HEIGHT_GATE)
    moved = pose + np.random.default_rng(seed).normal(0.0, 0.05, 3)
    use = np.arange(len(pairs.a))
    across, angle = _residuals(pairs, use, moved)
    for k, (a, b) in enumerate(zip(pairs.a, pairs.b)):
        off = moved[:2] + rotation(moved[2]) @ second.middle[b] - first.middle[a]
        sigma = np.hypot(first.sigma[a], second.sigma[b])
        assert across[k] * sigma == pytest.approx(off @ first.outward[a])
        yaw_sigma = np.hypot(first.yaw_sigma[a], second.yaw_sigma[b])
        yaws = [np.arctan2(*side[::-1]) for side in (second.outward[b], first.outward[a])]
        assert angle[k] * yaw_sigma == pytest.approx(wrap_angle(yaws[0] + moved[2] - yaws[1]))


@given(SEEDS)
def test_derivatives_are_those_of_differences(seed):
    pose = random_pose(seed)
    pairs = _candidates(*random_sides(seed, pose, (0.05, 0.05)), pose, SEARCH, HEIGHT_GATE)
    use, step = np.arange(len(pairs.a)), 1e-6
    J, r = _system(pairs, use, pose)
    assert r == pytest.approx(np.concatenate(_residuals(pairs, use, pose)))
    for k in range(3):
        moved = [np.concatenate(_residuals(pairs, use, pose + sign * step * np.eye(3)[k]))
                 for sign in (1.0, -1.0)]  # fmt: skip
        assert J[:, k] == pytest.approx((moved[0] - moved[1]) / (2.0 * step), rel=1e-5, abs=1e-4)


@given(SEEDS)
def test_exact_sides_give_the_pose_and_its_covariance(seed):
    """The prior pulls by some micrometres; three degrees of freedom are those of least squares."""
    pose = random_pose(seed)
    first, second = random_sides(seed, pose)
    pairs = _candidates(first, second, pose, SEARCH, HEIGHT_GATE)
    true = np.flatnonzero(np.abs(np.concatenate(_residuals(pairs, np.arange(len(pairs.a)), pose)))
                          .reshape(2, -1).max(axis=0) < 1e-6)  # fmt: skip
    start = pose + np.array([0.03, -0.02, 0.02])
    assert _solve(pairs, true, start, np.ones(len(true))) == pytest.approx(pose, abs=2e-3)
    J, _ = _system(pairs, true, pose)
    R = np.eye(3)
    R[:2, :2] = rotation(pose[2])
    expected = R.T @ np.linalg.inv(J.T @ J + np.eye(3) / OPEN_SIGMA**2) @ R
    assert _covariance(pairs, true, pose) == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_a_pair_that_is_off_pulls_less_than_least_squares():
    """Eight sides of one normal; one of them 2.5 deviations off, which is still an inlier."""
    count, sigma = 8, 0.005
    middle = np.column_stack([np.ones(count), np.linspace(-3.0, 3.0, count)])
    outward = np.tile([1.0, 0.0], (count, 1))
    sides = Sides(np.arange(count), middle, outward, np.full(count, 0.5), np.full(count, 0.7),
                  np.full(count, sigma))  # fmt: skip
    moved = middle.copy()
    moved[3, 0] += 2.5 * np.sqrt(2.0) * sigma
    pairs = _candidates(sides, sides.moved(moved, sides.height), np.zeros(3), (0.02, 0.0), 0.02)
    use = np.flatnonzero(pairs.a == pairs.b)
    squares = _solve(pairs, use, np.zeros(3), np.ones(len(use)))
    robust = _refine(pairs, np.zeros(3), np.zeros(3), 2)
    assert robust.sides == count
    assert squares[0] < 0.95 * robust.pose[0] < 0.0


@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_poses_differ_by_distance_or_yaw(k, sign):
    pose = np.array([1.0, -2.0, np.pi - 0.01])
    limit = SAME_POSE[0] if k < 2 else SAME_POSE[1]
    near, far = (pose + sign * part * limit * np.eye(3)[k] for part in (0.9, 1.1))
    assert _differ(np.array([near, far, pose]), pose).tolist() == [False, True, False]
