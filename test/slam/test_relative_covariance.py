"""How uncertain two keyframes are against each other, against samples of the graph's Gaussian."""

import gtsam
import numpy as np
import pytest

from tccm_ros.slam.factors.keys import keyframe_key
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.graph.pose_graph import PoseGraph

COV = np.diag([0.02, 0.01, 0.01]) ** 2
STEP = np.array([1.0, 0.1, 0.3])
COUNT = 5


@pytest.fixture(scope="module")
def solved():
    keys = [keyframe_key(k, 0.1 * k) for k in range(COUNT)]
    poses = [np.zeros(3)]
    for _ in range(COUNT - 1):
        x, y, yaw = poses[-1]
        c, s = np.cos(yaw), np.sin(yaw)
        poses.append(np.array([x + c * STEP[0] - s * STEP[1], y + s * STEP[0] + c * STEP[1],
                               yaw + STEP[2]]))  # fmt: skip
    factors = [PriorPose(keys[0], poses[0], np.eye(3) * 1e-8)]
    for a, b, pose in zip(keys, keys[1:], poses[1:]):
        factors += [BetweenKeyframes(a, b, STEP, COV), Planar(b, pose)]
    return PoseGraph(factors, dict(zip(keys, poses))).optimise(), keys, np.array(poses)


def test_relative_covariance_equals_that_of_sampled_points(solved):
    """4,000 samples of the steps between two keyframes: 10 % of a variance is five sigmas."""
    solution, keys, poses = solved
    random, point = np.random.default_rng(0), np.array([2.0, 2.5])
    a, b = 1, 4
    seen = [gtsam.Pose2(*pose).transformTo(point) for pose in poses]
    away = []
    for _ in range(4000):
        moved = gtsam.Pose2(*poses[a])
        for _ in range(b - a):
            noise = random.multivariate_normal(np.zeros(3), COV)
            moved = moved.compose(gtsam.Pose2(*STEP)).compose(gtsam.Pose2(*noise))
        away.append(moved.transformFrom(seen[b]) - point)
    expected = np.cov(np.array(away).T)
    found = solution.relative_covariance(keys[a], keys[b], point)
    assert np.allclose(found, expected, rtol=0.1, atol=0.1 * np.trace(expected) / 2)


def test_relative_covariance_is_zero_for_one_keyframe_and_symmetric(solved):
    solution, keys, _ = solved
    point = np.array([1.0, 2.0])
    assert np.allclose(solution.relative_covariance(keys[3], keys[3], point), 0.0, atol=1e-12)
    one = solution.relative_covariance(keys[1], keys[4], point)
    assert np.allclose(one, solution.relative_covariance(keys[4], keys[1], point))
