import gtsam
import numpy as np
import pytest

from tccm_ros.geometry import between2, compose2, inverse, spatial
from tccm_ros.slam.chain import yaw_offset_for
from tccm_ros.slam.factors.factor import by_variables
from tccm_ros.slam.factors.keys import keyframe_key, view_key, wall_key
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.factors.views import BetweenViews, KeyframeView
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.incremental import IncrementalGraph
from tccm_ros.slam.graph.pose_graph import PoseGraph

COV = np.diag([0.02**2, 0.02**2, 0.01**2])
PHIS = np.radians([0.0, 90.0, 180.0, -90.0, 0.00001, 37.0, -140.0])


def solve_graph(factors, starts):
    return PoseGraph(factors, starts).optimise()


def observation(pose, phi_map, rho_map, key, wall, cov, noise=(0.0, 0.0)):
    """Return what a keyframe at `pose` sees of a wall in map."""
    phi = phi_map - pose[2] + noise[0]
    rho = rho_map - np.cos(phi_map) * pose[0] - np.sin(phi_map) * pose[1] + noise[1]
    return WallObservation(key, wall, float(phi), float(rho), cov)


def error_of(factor, pose, plane):
    """Return twice the factor's error for a keyframe's planar pose and a wall (phi, rho)."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    factor.add_to(graph)
    values.insert(factor.keyframe.symbol, factor.keyframe.to_value(spatial(np.array(pose))))
    phi, rho = plane
    coefficients = np.array([np.cos(phi), np.sin(phi), 0.0, -rho])
    values.insert(factor.wall.symbol, gtsam.OrientedPlane3(coefficients))
    return 2.0 * graph.at(0).error(values)


@pytest.mark.parametrize("phi", PHIS)
def test_error_of_a_wall_is_its_mahalanobis_distance_at_any_angle(phi):
    """Also dead ahead and at right angles, where GTSAM's tangent basis flips."""
    key = keyframe_key(0, yaw_offset_for(np.array([phi])))
    yc, v_phi, v_perp = 1.2, 0.02**2, 0.01**2
    cov = np.array([[v_phi, yc * v_phi], [yc * v_phi, v_perp + yc**2 * v_phi]])
    factor = WallObservation(key, wall_key(0), float(phi), 2.0, cov)
    for dphi, drho in [(0.01, 0.0), (0.0, 0.02), (0.01, 0.012), (-0.01, 0.012)]:
        difference = np.array([-dphi, -drho])
        expected = difference @ np.linalg.solve(cov, difference)
        found = error_of(factor, [0.0, 0.0, 0.0], (phi + dphi, 2.0 + drho))
        assert found == pytest.approx(expected, rel=0.01, abs=1e-6)


@pytest.mark.parametrize("phi", PHIS)
def test_walls_determine_a_pose_in_every_direction(phi):
    """Two walls at right angles, seen before and after a step whose odometry is wrong."""
    truth = np.array([[0.0, 0.0, 0.0], [0.5, 0.2, 0.3]])
    walls = [(phi, 3.0), (phi + np.pi / 2, 2.0)]
    bearings = [np.array([w[0] - p[2] for w in walls]) for p in truth]
    keys = [keyframe_key(k, yaw_offset_for(b)) for k, b in enumerate(bearings)]
    sharp = np.diag([0.001**2, 0.001**2])
    wrong = compose2(between2(truth[0], truth[1]), np.array([0.05, -0.03, 0.04]))
    factors = [
        PriorPose(keys[0], truth[0], COV * 1e-6),
        BetweenKeyframes(keys[0], keys[1], wrong, COV * 100),
        Planar(keys[1], truth[1]),
    ]
    for key, pose in zip(keys, truth):
        for w, (a, rho) in enumerate(walls):
            factors.append(observation(pose, a, rho, key, wall_key(w), sharp))
    solution = solve_graph(factors, {keys[0]: truth[0], keys[1]: wrong})
    assert np.allclose(solution.planar_poses(keys), truth, atol=1e-4)


def test_chi_square_of_a_pose_among_walls_has_the_right_mean():
    """The correlation's sign: with it wrong the pose's NEES is far from 1."""
    random = np.random.default_rng(0)
    yc, v_phi, v_perp = 2.0, 0.01**2, 0.005**2
    cov = np.array([[v_phi, yc * v_phi], [yc * v_phi, v_perp + yc**2 * v_phi]])
    root = np.linalg.cholesky(cov)
    walls = [(0.3, 3.0), (1.9, 2.0), (-2.0, 4.0)]
    key = keyframe_key(1, yaw_offset_for(np.array([w[0] for w in walls])))
    first = keyframe_key(0, key.yaw_offset)
    sharp, loose = np.eye(2) * 1e-10, np.diag([1.0, 1.0, 1.0])
    values = []
    for _ in range(300):
        factors = [
            PriorPose(first, np.zeros(3), np.eye(3) * 1e-12),
            BetweenKeyframes(first, key, np.zeros(3), loose),
            Planar(key, np.zeros(3)),
        ]
        for w, (phi, rho) in enumerate(walls):
            factors.append(observation(np.zeros(3), phi, rho, first, wall_key(w), sharp))
            noise = root @ random.normal(size=2)
            factors.append(observation(np.zeros(3), phi, rho, key, wall_key(w), cov, noise))
        solution = solve_graph(factors, {first: np.zeros(3), key: np.zeros(3)})
        error = solution.planar_poses([key])[0]
        values.append(error @ np.linalg.solve(solution.planar_covariance(key), error) / 3.0)
    # Standard error of the mean of 300 with 3 degrees each: sqrt(2 / 900) = 0.05.
    assert np.mean(values) == pytest.approx(1.0, abs=0.2)


def test_a_yaw_offset_of_keys_does_not_change_the_solution():
    """All factors mean the same whatever the yaw offset of their keys."""
    random = np.random.default_rng(2)
    results = []
    for offsets in ([0.0, 0.0, 0.0], [0.3, 1.1, 0.7]):
        keys = [keyframe_key(k, t) for k, t in enumerate(offsets)]
        random = np.random.default_rng(2)
        factors = [PriorPose(keys[0], np.array([1.0, 2.0, 0.5]), COV)]
        for a, b in ((0, 1), (1, 2), (0, 2)):
            delta = random.normal(size=3) * 0.5
            factors.append(BetweenKeyframes(keys[a], keys[b], delta, np.diag([0.01, 0.04, 0.02])))
        factors += [Planar(key, np.zeros(3)) for key in keys[1:]]
        solution = solve_graph(factors, {key: np.zeros(3) for key in keys})
        cov = np.stack([solution.planar_covariance(key) for key in keys])
        results.append((solution.planar_poses(keys), cov))
    # Both stop where a step changes the cost by less than 1e-5.
    assert np.allclose(results[0][0], results[1][0], atol=2e-3)
    assert np.allclose(results[0][1], results[1][1], rtol=0.02, atol=1e-6)


def test_registration_of_views_is_robust_against_an_outlier():
    key = keyframe_key(0)
    cov = np.eye(6) * 0.01**2
    good, bad = spatial(np.array([0.02, 0.0, 0.0])), spatial(np.array([3.0, 0.0, 0.0]))
    factors = [
        PriorPose(key, np.zeros(3), COV * 1e-6),
        KeyframeView(key, view_key(0), np.zeros(3), COV * 1e-4),
        KeyframeView(key, view_key(1), np.zeros(3), COV),
        BetweenViews(view_key(0), view_key(1), good, cov),
        BetweenViews(view_key(0), view_key(1), good, cov),
        BetweenViews(view_key(0), view_key(1), bad, cov),
    ]
    starts = {key: np.zeros(3), view_key(0): np.zeros(3), view_key(1): np.zeros(3)}
    solution = solve_graph(factors, starts)
    T = inverse(solution.pose(view_key(0))) @ solution.pose(view_key(1))
    assert T[0, 3] < 0.05


def test_incremental_and_batch_optimisation_agree():
    random = np.random.default_rng(5)
    truth = [np.zeros(3)]
    for k in range(60):
        truth.append(compose2(truth[-1], np.array([0.3, 0.0, 0.1 if k % 9 else -0.4])))
    walls = [(0.0, 9.0), (np.pi / 2, 8.0)]
    groups, starts, cov = [], {}, np.diag([0.01**2, 0.02**2])
    keys = [
        keyframe_key(k, yaw_offset_for(np.array([-p[2], np.pi / 2 - p[2]])))
        for k, p in enumerate(truth)
    ]
    pose = truth[0]
    for k, (key, p) in enumerate(zip(keys, truth)):
        group = [observation(p, *w, key, wall_key(i), cov) for i, w in enumerate(walls)]
        if k == 0:
            group.insert(0, PriorPose(key, p, COV * 1e-4))
        else:
            noise = random.normal(size=3) * [0.01, 0.01, 0.005]
            delta = compose2(between2(truth[k - 1], p), noise)
            pose = compose2(pose, delta)
            group = [BetweenKeyframes(keys[k - 1], key, delta, COV), Planar(key, pose), *group]
        groups.append(group)
        starts[key] = pose
    isam = IncrementalGraph()
    for key, group in zip(keys, groups):
        isam.update(by_variables(group), {key: starts[key]})
    batch = solve_graph([f for group in groups for f in group], starts)
    # ISAM2 leaves alone what would move by less than its threshold of linearisation.
    assert np.allclose(isam.planar_poses(keys), batch.planar_poses(keys), atol=0.03)
    assert np.allclose(batch.planar_poses(keys), np.stack(truth), atol=0.05)


def test_a_chain_with_an_uncertainty_of_tens_of_metres_is_optimised():
    """A quarter of a radian lost at the start of a long corridor: 50 m of uncertainty at its end.

    Elimination by Cholesky calls such a graph indeterminate.
    """
    steps, cov = 600, np.diag([0.01**2, 0.01**2, 0.002**2])
    keys = [keyframe_key(k) for k in range(steps)]
    poses = np.zeros((steps, 3))
    poses[:, 0] = 0.35 * np.arange(steps)
    delta = np.array([0.35, 0.0, 0.0])
    live = IncrementalGraph()
    factors = [[PriorPose(keys[0], poses[0], np.eye(3) * 1e-8)]]
    for k in range(1, steps):
        lost = np.diag([1.0, 1.0, 0.25**2]) if k == 5 else cov
        factors.append(
            [BetweenKeyframes(keys[k - 1], keys[k], delta, lost), Planar(keys[k], poses[k])]
        )
    for k in range(steps):
        live.update(by_variables(factors[k]), {keys[k]: poses[k]})
    assert np.allclose(live.planar_poses(keys), poses, atol=1e-6)
    solution = solve_graph([f for group in factors for f in group], dict(zip(keys, poses)))
    sigma = np.sqrt(np.diag(solution.planar_covariance(keys[-1])))
    # The yaw error at step 5 over the rest of the path; later ones grow with its power of 1.5.
    way = 0.35 * (steps - 5)
    expected = np.hypot(0.25 * way, 0.002 * way * np.sqrt(steps / 3))
    assert sigma[1] == pytest.approx(expected, rel=0.02)
