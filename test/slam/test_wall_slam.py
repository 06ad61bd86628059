from dataclasses import replace

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.slam.factors.keys import view_key
from tccm_ros.slam.factors.views import BetweenViews
from tccm_ros.slam.wall_slam import WallSlam

LAP = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (4, 0)]
WALLS = plan.ring()


def slam_of(run, config=None):
    slam = WallSlam(config or Config())
    for scan in run.scans:
        slam.add_scan(scan)
    return slam


@pytest.fixture(scope="module")
def lap():
    return plan.drive(WALLS, plan.route(LAP), seed=3)


@pytest.fixture(scope="module")
def solved(lap):
    slam = slam_of(lap)
    return slam, slam.solve(lap.stamps_ns[10::60] + 30_000_000)


def test_the_loop_of_a_ring_is_closed(lap, solved):
    """Odometry turns by 12 mrad/m; 1 cm of range noise leaves well under 2 cm."""
    _, solution = solved
    rms_m, rms_rad = plan.errors(lap.truth, solution.poses)
    assert rms_m < 0.02
    assert rms_rad < np.radians(0.2)
    assert any(loop.accepted for loop in solution.loops)
    assert np.array_equal(solution.stamps_ns, lap.stamps_ns)


def test_walls_are_estimated_at_their_true_lines(solved):
    """Each long wall lies on a side of the plan, within 3 cm and 0.5 deg."""
    _, solution = solved
    long = [w for w in solution.walls if np.hypot(*np.diff(w.endpoints, axis=0)[0]) > 3.0]
    assert len(long) >= 6
    for wall in long:
        assert wall.rho >= 0.0
        quarter = wall.phi / (np.pi / 2)
        assert quarter == pytest.approx(round(quarter), abs=0.006)
        sides = [-1.0, 13.0, 1.0, 11.0] if round(quarter) % 2 == 0 else [-1.0, 10.0, 1.0, 8.0]
        assert min(abs(wall.rho - abs(s)) for s in sides) < 0.03
        c, s = np.cos(wall.phi), np.sin(wall.phi)
        assert np.allclose(wall.endpoints @ [c, s], wall.rho, atol=1e-6)
        assert np.all(np.linalg.eigvalsh(wall.covariance) > 0.0)


def test_walls_that_meet_list_each_other(solved):
    _, solution = solved
    named = [w for w in solution.walls if w.corners]
    assert len(named) >= 4
    for wall in named:
        for other in wall.corners:
            assert wall.id in solution.walls[other].corners
            gaps = np.linalg.norm(
                wall.endpoints[:, None] - solution.walls[other].endpoints[None], axis=2
            )
            assert gaps.min() < 1e-6


def test_the_solution_does_not_depend_on_earlier_calls_of_solve(lap, solved):
    _, solution = solved
    slam = WallSlam(Config())
    for k, scan in enumerate(lap.scans):
        slam.add_scan(scan)
        if k in (50, 200):
            slam.solve()
    again = slam.solve(lap.stamps_ns[10::60] + 30_000_000)
    assert again.poses.tobytes() == solution.poses.tobytes()
    assert again.T_map_views.tobytes() == solution.T_map_views.tobytes()
    assert [w.endpoints.tobytes() for w in again.walls] == [
        w.endpoints.tobytes() for w in solution.walls
    ]
    assert [(p.from_id, p.to_id, p.reason) for p in again.loops] == [
        (p.from_id, p.to_id, p.reason) for p in solution.loops
    ]


def test_views_are_anchored_to_the_trajectory(lap, solved):
    _, solution = solved
    stamps = lap.stamps_ns[10::60] + 30_000_000
    found = np.stack([plan.planar(T) for T in solution.T_map_views])
    expected = solution.pose_at(stamps)
    assert np.allclose(found[:, :2], expected[:, :2], atol=0.03)
    sigmas = np.sqrt(np.stack([np.diag(c) for c in solution.cov_views]))
    assert np.allclose(sigmas[:, 5], 0.005, rtol=0.05)
    assert np.allclose(sigmas[:, 0], np.radians(0.3), rtol=0.05)


@pytest.fixture(scope="module")
def by_walls():
    """The published wall SLAM, walls and odometry without matching, and where odometry ends."""
    config = Config()
    config.matching.enabled = config.loops.enabled = False
    run = plan.drive(WALLS, plan.route(LAP), seed=3, drift=0.003)
    return run, slam_of(run, config)


def odometry_poses(run):
    return np.stack([plan.planar(scan.T_odom_base[0]) for scan in run.scans])


def test_views_stand_where_the_graph_says_and_not_where_odometry_put_them(by_walls):
    """The second paper's reason for full SLAM: the poses of clouds are corrected afterwards."""
    run, slam = by_walls
    at = slice(10, None, 60)
    views = np.stack([plan.planar(T) for T in slam.solve(run.stamps_ns[at]).T_map_views])
    uncorrected = plan.errors(run.truth[at], odometry_poses(run)[at])[0]
    assert uncorrected > 0.4
    assert plan.errors(run.truth[at], views)[0] < 0.1 * uncorrected


def test_factors_between_views_move_them(lap, solved):
    slam, _ = solved
    stamps = [int(lap.stamps_ns[20]), int(lap.stamps_ns[22])]
    free = slam.solve(stamps)
    T = np.linalg.inv(free.T_map_views[0]) @ free.T_map_views[1]
    T[2, 3] += 0.004
    constrained = slam.solve(stamps, [BetweenViews(*map(view_key, stamps), T, np.eye(6) * 1e-8)])
    T_view0_view1 = np.linalg.inv(constrained.T_map_views[0]) @ constrained.T_map_views[1]
    assert T_view0_view1[2, 3] == pytest.approx(0.004, abs=5e-4)


def test_pose_at_is_exact_at_scans_and_interpolates_between_them(solved):
    _, solution = solved
    at = solution.pose_at(solution.stamps_ns[[5, 77]])
    assert np.allclose(at, solution.poses[[5, 77]], atol=1e-9)
    before = solution.pose_at(solution.stamps_ns[0] - 10**9)
    assert np.allclose(before[0], solution.poses[0])


def test_wall_landmarks_do_not_increase_the_error(lap, solved):
    _, solution = solved
    config = Config()
    config.walls.enabled = False
    without = slam_of(lap, config).solve()
    assert not without.walls
    with_m = plan.errors(lap.truth, solution.poses)[0]
    # 3 mm: what either leaves by chance on so short a drive.
    assert with_m <= 1.05 * plan.errors(lap.truth, without.poses)[0] + 0.003


@pytest.mark.parametrize("has_odometry", [False, True])
def test_a_ring_is_mapped_without_odometry(has_odometry):
    """There is none, or it never reports a motion."""
    run = plan.drive(WALLS, plan.route(LAP[:4]), odometry=False)
    run.scans = [replace(scan, has_odometry=has_odometry) for scan in run.scans]
    assert plan.errors(run.truth, slam_of(run).solve().poses)[0] < 0.15


def test_a_ring_is_mapped_with_odometry_that_jumps():
    """A step of 0.4 m and 0.3 rad that did not happen: matching knows better."""
    run = plan.drive(WALLS, plan.route(LAP[:3]), seed=1)
    jump = plan.matrix([0.4, -0.2, 0.3])
    for scan in run.scans[60:]:
        scan.T_odom_base[:] = jump @ scan.T_odom_base
    assert plan.errors(run.truth, slam_of(run).solve().poses)[0] < 0.1


def test_without_scans_the_trajectory_is_that_of_odometry():
    run = plan.drive(WALLS, plan.route(LAP[:3]), drift=0.0, scale=1.0, noise=(0.0, 0.0))
    slam = WallSlam(Config())
    for scan in reversed(run.scans):
        slam.add_odometry(scan.scan.stamp_ns, scan.T_odom_base[0])
    solution = slam.solve([int(run.stamps_ns[40])])
    assert plan.errors(run.truth, solution.poses)[0] < 1e-3
    assert np.allclose(plan.planar(solution.T_map_views[0]), run.truth[40], atol=1e-3)


def test_without_records_the_solution_is_empty():
    solution = WallSlam(Config()).solve([123])
    assert len(solution.poses) == 0
    assert solution.T_map_views.shape == (1, 4, 4)
    assert np.allclose(solution.pose_at([5]), 0.0)


def test_empty_scans_are_accepted():
    run = plan.drive(np.zeros((0, 2, 2)), plan.route(LAP[:2]))
    solution = slam_of(run).solve()
    assert len(solution.poses) == len(run.scans)
    assert not solution.walls


def test_a_scan_that_is_not_newer_is_refused(lap):
    slam = WallSlam(Config())
    slam.add_scan(lap.scans[1])
    with pytest.raises(ValueError, match="not newer"):
        slam.add_scan(lap.scans[0])


def test_the_first_odometry_pose_is_the_origin_of_the_map(lap):
    slam = WallSlam(Config())
    for scan in lap.scans[:8]:
        slam.add_odometry(scan.scan.stamp_ns, scan.T_odom_base[0])
    for scan in lap.scans[5:8]:
        slam.add_scan(scan)
    found = slam.solve().poses[0]
    assert np.allclose(found, plan.planar(lap.scans[5].T_odom_base[0]), atol=1e-3)


@pytest.mark.parametrize("mode", ["mapping", "localisation"])
def test_a_session_is_localised_in_a_saved_map_from_an_unknown_start(lap, solved, mode):
    slam, solution = solved
    config = Config()
    config.graph.mode = mode
    later = WallSlam.from_saved(config, slam.saved())
    route = plan.route([(12, 4), (12, 9), (3, 9)])
    run = plan.drive(WALLS, route, seed=8, start_ns=2 * 10**18)
    assert not later.is_located
    pose = [later.add_scan(scan).pose for scan in run.scans][-1]
    assert later.is_located
    assert np.allclose(pose[:2], route[-1, :2], atol=0.1)
    found = later.solve()
    assert len(found.poses) == len(run.scans)
    assert plan.errors(route, found.poses)[0] < 0.05
    if mode == "localisation":
        for old, new in zip(solution.keyframes, found.keyframes):
            assert np.allclose(old.pose, new.pose, atol=1e-3)


def test_a_damaged_saved_map_is_an_error(solved):
    state = solved[0].saved()
    missing = {k: v for k, v in state.items() if k != "line_cov"}
    with pytest.raises(MapError, match="line_cov"):
        WallSlam.from_saved(Config(), missing)
    with pytest.raises(MapError, match="damaged"):
        WallSlam.from_saved(Config(), {**state, "scan_points": state["scan_points"][:-1]})


def test_a_map_without_keyframes_is_saved_and_loaded():
    arrays = WallSlam(Config()).saved()
    slam = WallSlam.from_saved(Config(), arrays)
    assert slam.first_keyframe == (0, 0)
    assert not slam.solve().keyframes
