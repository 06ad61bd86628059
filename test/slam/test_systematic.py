"""The error that all steps of odometry share, against solutions of displaced steps and samples."""

from functools import cache

import numpy as np
import plan
import pytest
from scipy.optimize import least_squares

from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2, wrap_angle
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.factors.poses import BetweenKeyframes
from tccm_ros.slam.front_end import FrontEnd, GraphKeyframe
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.systematic import systematic_covariances
from tccm_ros.slam.wall_slam import WallSlam

SCALE_DRIFT = 0.001  # per root m, growth of the scale's sigma

CORRIDOR = np.array([[[-60.0, 1.0], [90.0, 1.0]], [[-60.0, -1.0], [90.0, -1.0]]])
ROOM = plan.box(-1.5, -2.0, 6.0, 2.0)
ALONG = np.column_stack([np.arange(0.0, 25.0, 0.1), np.zeros((250, 2))])
SIGMA = 0.01
STEP, COV = np.array([0.3, 0.02, 0.1]), np.diag([0.02, 0.01, 0.006]) ** 2
SHIFT = np.array([0.003, -0.001, 0.0])
LOOP, LOOP_COV = (2, 9), np.diag([0.03, 0.02, 0.01]) ** 2


def nees(errors, covariances):
    """Return normalised estimation errors squared per degree of freedom, float64 (N,)."""
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.sum(errors * solved, axis=-1) / errors.shape[-1]


def chain_of(session_starts=(0,), count=12):
    """Return a chain of equal steps; yaw offsets differ, as walls ask for them."""
    chain, pose = KeyframeChain(), np.zeros(3)
    random = np.random.default_rng(0)
    for k in range(count):
        session = sum(k >= start for start in session_starts) - 1
        first = k in session_starts
        pose = np.array([5.0 * session, 1.0, 0.3]) * session if first else compose2(pose, STEP)
        delta, systematic = (np.zeros(3), np.zeros(3)) if first else (STEP, SHIFT)
        keyframe = GraphKeyframe(k, None, pose, delta, COV, session, systematic)
        chain.add(keyframe, random.uniform(-3.0, 3.0, 4))
    return chain


def solved(chain, loops=()):
    starts = {k.id: k.pose for k in chain.keyframes if k.id and chain.starts(k.id)}
    graph = chain.graph(np.array([k.pose for k in chain.keyframes]), starts)
    graph.add([BetweenKeyframes(chain.keys[a], chain.keys[b], d, LOOP_COV) for a, b, d in loops])
    return graph.optimise()


def by_least_squares(steps, loops):
    """Return the poses (K, 3) of a chain by a solver that shares nothing with the graph."""

    def residuals(x):
        poses = np.concatenate([[np.zeros(3)], x.reshape(-1, 3)])
        e = between2(steps, between2(poses[:-1], poses[1:])) / np.sqrt(np.diag(COV))
        rows = [e.ravel()]
        for a, b, delta in loops:
            away = between2(delta, between2(poses[a], poses[b]))
            rows.append(away / np.sqrt(np.diag(LOOP_COV)))
        return np.concatenate(rows)

    start = [np.zeros(3)]
    for step in steps:
        start.append(compose2(start[-1], step))
    x = least_squares(residuals, np.array(start[1:]).ravel(), xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    return np.concatenate([[np.zeros(3)], x.reshape(-1, 3)])


@pytest.mark.parametrize("is_closed", [False, True])
def test_covariance_is_the_motion_of_the_solution_for_one_sigma_of_scale(is_closed):
    chain = chain_of()
    truth = np.array([k.pose for k in chain.keyframes])
    a, b = LOOP
    loops = [(a, b, between2(truth[a], truth[b]))] if is_closed else []
    covs = systematic_covariances(solved(chain, loops), chain)
    fraction = 0.01  # small, as both are of first order
    steps = compose2(np.tile(STEP, (len(truth) - 1, 1)), fraction * SHIFT)
    moved = between2(truth, by_least_squares(steps, loops)) / fraction
    expected = np.einsum("ki,kj->kij", moved, moved)
    assert np.allclose(covs, expected, rtol=0.01, atol=1e-9)
    assert covs[-1, 0, 0] > 1e-5


def test_loop_closure_removes_the_covariance_that_it_observes():
    chain = chain_of()
    truth = np.array([k.pose for k in chain.keyframes])
    b = len(truth) - 1
    free = systematic_covariances(solved(chain), chain)[b]
    closed = systematic_covariances(solved(chain, [(0, b, between2(truth[0], truth[b]))]), chain)[b]
    assert np.trace(closed[:2, :2]) < 0.5 * np.trace(free[:2, :2])


def test_the_scales_of_two_sessions_are_independent():
    """A session that is not located is pinned where it began: the other's scale is not its own."""
    both, chain = chain_of((0, 6)), chain_of(count=6)
    covs = systematic_covariances(solved(both), both)
    alone = systematic_covariances(solved(chain), chain)
    assert np.allclose(covs[:6], alone, atol=1e-12)
    assert np.allclose(covs[6:], alone, rtol=1e-6, atol=1e-10)


def test_keyframes_that_must_not_move_do_not():
    chain = chain_of()
    chain.fixed = {k.id: k.pose for k in chain.keyframes}
    assert not systematic_covariances(solved(chain), chain).any()


def test_covariance_equals_that_of_sampled_wheels():
    """Over robots: the graph's covariance and this one, together, are that of the last pose.

    2,000 robots: 10 % of a variance is three sigmas.
    """
    random, ends = np.random.default_rng(0), []
    chain = chain_of()
    for _ in range(2000):
        scale, pose = random.normal(), np.zeros(3)
        for _ in range(len(chain.keyframes) - 1):
            noise = random.normal(size=3) * np.sqrt(np.diag(COV))
            pose = compose2(compose2(pose, STEP), scale * SHIFT + noise)
        ends.append(between2(chain.keyframes[-1].pose, pose))
    solution = solved(chain)
    found = solution.planar_covariance(chain.keys[-1]) + systematic_covariances(solution, chain)[-1]
    expected = np.cov(np.array(ends).T)
    assert np.allclose(np.diag(found), np.diag(expected), rtol=0.1)


def systematic_of(walls, poses):
    """Return the systematic steps (K, 3) of a drive, along map's axes."""
    front = FrontEnd(Config())
    for posed in plan.drive(walls, poses, beams=361, drift=0.0, scale=1.0, noise=(0.0, 0.0)).scans:
        front.add(make_level_scan(posed, Config()))
    yaw = np.array([k.pose[2] for k in front.keyframes])
    x, y, turned = np.array([k.systematic for k in front.keyframes]).T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * x - s * y, s * x + c * y, wrap_angle(turned)], axis=1)


def test_along_a_plain_corridor_all_of_the_way_counts():
    """One sigma of the scale, and what floors add to it: the integral of its sigma by the way."""
    shift = systematic_of(CORRIDOR, ALONG).sum(axis=0)
    start, end = SIGMA**2, SIGMA**2 + SCALE_DRIFT**2 * ALONG[-1, 0]
    expected = 2.0 / 3.0 * (end**1.5 - start**1.5) / SCALE_DRIFT**2
    assert shift[0] == pytest.approx(expected, rel=0.02)
    assert np.abs(shift[1:]).max() < 0.1 * shift[0]


def test_in_a_room_matching_corrects_the_scale():
    """Four walls at 1 cm of range noise tell 0.3 m to some millimetres, odometry to 2 cm."""
    poses = plan.route([(0.0, 0.0), (3.5, 0.0), (3.5, 1.0), (0.0, 1.0), (0.0, 0.0)])
    shift = np.abs(systematic_of(ROOM, poses)).sum(axis=0)
    assert np.hypot(*shift[:2]) < 0.2 * SIGMA * 9.0


@pytest.mark.parametrize("scale", [1.0 - SIGMA, 1.0 + SIGMA])
def test_covariance_along_a_corridor_covers_the_error(scale):
    """Wheels that are off by one sigma end one sigma off; across the corridor walls tell."""
    run = plan.drive(CORRIDOR, ALONG, beams=361, scale=scale, drift=0.0, noise=(0.002, 0.002))
    slam = WallSlam(Config())
    for scan in run.scans:
        slam.add_scan(scan)
    solution = slam.solve()
    last = solution.keyframes[-1]
    at = int(np.searchsorted(solution.stamps_ns, last.stamp_ns))
    error, cov = between2(run.truth[at], last.pose), solution.cov_keyframes[-1]
    assert 0.5 < error[0] ** 2 / cov[0, 0] < 2.0
    assert cov[1, 1] < 0.05**2
    # Noise alone, 2 mm per root m, would be 1 cm.
    assert abs(error[0]) > 0.2


def bowed(walls, bow, panel=3.0):
    """Return walls (N, 2, 2) of panels that bow to one side and the other, as short segments."""
    segments = []
    for start, end in walls:
        along = end - start
        count = max(1, round(float(np.hypot(*along)) / panel))
        t = np.linspace(0.0, count, 8 * count + 1)
        side = 4.0 * bow * (t % 1.0) * (1.0 - t % 1.0) * np.where(t // 1.0 % 2.0, 1.0, -1.0)
        normal = np.array([-along[1], along[0]]) / np.hypot(*along)
        points = start + np.outer(t / count, along) + np.outer(side, normal)
        segments.append(np.stack([points[:-1], points[1:]], axis=1))
    return np.concatenate(segments)


BOWED = [(0.0, 0.005), (0.01, 0.005), (0.02, 0.005), (0.02, -0.005), (0.03, 0.0)]
"""How far walls bow, and the error of ranges, m."""


@cache
def in_a_room_that_bows(bow, offset):
    """Return the normalised error squared of keyframes, and the largest rms, of two drives."""
    rms = []
    blocks = [plan.box(-1.0, -3.0, 0.0, -2.4), plan.box(3.3, 0.0, 4.0, 1.0)]
    room = bowed(np.concatenate([plan.box(-4.0, -3.0, 4.0, 3.0), *blocks]), bow)
    lap = [(-2.0, -1.2), (2.0, -1.2), (2.0, 1.2), (-2.0, 1.2), (-2.0, -1.2)]
    found = []
    for seed in (0, 1):
        run = plan.drive(room, plan.route(lap, yaw_step=0.2), seed=seed)
        slam = WallSlam(Config())
        for posed in run.scans:
            posed.scan.ranges[:] += offset
            slam.add_scan(posed)
        solution = slam.solve()
        at = np.searchsorted(run.stamps_ns, [k.stamp_ns for k in solution.keyframes])
        errors = between2(run.truth[at], np.stack([k.pose for k in solution.keyframes]))
        found.append(nees(errors[1:], solution.cov_keyframes[1:]).mean())
        rms.append(np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))))
    return float(np.mean(found)), max(rms)


@pytest.mark.parametrize(("bow", "offset"), BOWED)
def test_covariances_hold_with_bowed_walls_and_ranges_that_are_biased(bow, offset):
    """Normalised errors squared of all keyframes, per degree of freedom, over two drives."""
    assert 0.5 < in_a_room_that_bows(bow, offset)[0] < 2.0


@pytest.mark.parametrize(("bow", "offset"), BOWED)
def test_bowed_walls_and_biased_ranges_displace_no_keyframe(bow, offset):
    """With one landmark for all pieces of a wall the error was 8 mm."""
    assert in_a_room_that_bows(bow, offset)[1] < 0.0045
