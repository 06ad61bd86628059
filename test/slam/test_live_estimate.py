"""The live estimate is held to the solutions: by their corrections, and by walls in between."""

import numpy as np
import plan
import pytest
from solved import solved_map

from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2, inverse2
from tccm_ros.records import Wall
from tccm_ros.slam.front_end import GraphKeyframe, TrackedPose
from tccm_ros.slam.live_estimate import LiveEstimate, MapWalls, SolvedKeyframe
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.tracking import SolvedMap, Tracker
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.slam.walls.lines import Lines

LAP = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (4, 0)]
EMPTY = LevelScan(0, np.zeros(3), *[np.zeros((0, 2))] * 2, np.zeros((0, 2)), np.zeros((0, 2)))


def follow(run, config, *, period=30):
    """Return live poses and those of the solution after each, solved every `period` scans."""
    tracker, slam = Tracker(config), WallSlam(config)
    live, solved = [], []
    for k, scan in enumerate(run.scans):
        tracker.add(scan)
        slam.add_scan(scan)
        live.append(tracker.current_pose().pose)
        if k % period == period - 1 or k == len(run.scans) - 1:
            solution, taken = solved_map(slam)
            tracker.take(taken)
            solved.extend(solution.poses[len(solved) :])
    return np.array(live), np.array(solved), solution


def test_live_poses_are_those_of_the_solution_that_follows():
    """A lap with 12 mrad/m of drift; without the corrections it is 28 mm."""
    run = plan.drive(plan.ring(), plan.route(LAP), seed=3)
    live, solved, final = follow(run, Config())
    delta = between2(live, solved)
    assert np.quantile(np.hypot(*delta.T[:2]), 0.95) < 0.010
    assert np.degrees(np.quantile(np.abs(delta[:, 2]), 0.95)) < 0.1
    from_final = between2(live[-20:], final.poses[-20:])
    assert np.hypot(*from_final.T[:2]).max() < 0.005


def test_without_matching_walls_localise_the_live_pose():
    """The second paper's own configuration: bare odometry ends 2 m off here."""
    config = Config()
    config.matching.enabled = config.loops.enabled = False
    run = plan.drive(plan.ring(), plan.route(LAP), seed=3)
    live, _, final = follow(run, config)
    batch = plan.errors(run.truth, final.poses)[0]
    assert batch < 0.5
    assert plan.errors(run.truth, live)[0] < 1.3 * batch


def test_corrections_do_not_enter_tracking():
    run = plan.drive(plan.ring(), plan.route(LAP[:3]), seed=3)
    corrected, alone = Tracker(Config()), Tracker(Config())
    shift = np.array([3.0, -2.0, 1.0])
    for k, scan in enumerate(run.scans):
        corrected.add(scan)
        alone.add(scan)
        if k == 40:
            newest = corrected._front.keyframes[-1]
            pose = compose2(shift, newest.pose)
            keyframe = SolvedKeyframe(newest.id, pose, np.eye(3))
            corrected.take(SolvedMap(shift, keyframe, MapWalls.of((), np.zeros(3))))
    assert np.array_equal(corrected._front.pose, alone._front.pose)
    expected = compose2(shift, alone.current_pose().pose)
    assert np.allclose(corrected.current_pose().pose, expected, atol=1e-9)
    assert corrected.current_covariance()[2, 2] > 1.0 > alone.current_covariance()[2, 2]


def test_a_solution_of_keyframes_that_are_not_ours_is_not_taken():
    """Before the first scan of a session in a saved map, its newest keyframe is another's."""
    estimate = LiveEstimate(Config())
    add(estimate, 7, np.zeros(3))
    before = estimate.pose(TrackedPose(0, 7, np.zeros(3), np.zeros((3, 3))))
    estimate.take(SolvedKeyframe(6, np.ones(3), np.eye(3)), MapWalls.of((), np.zeros(3)))
    after = estimate.pose(TrackedPose(0, 7, np.zeros(3), np.zeros((3, 3))))
    assert np.array_equal(before, after)


def add(estimate, number, delta, lines=None, sigma=0.05):
    none = np.zeros(0)
    empty = Lines(none, none, np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), none.astype(int))
    keyframe = GraphKeyframe(number, EMPTY, np.zeros(3), delta, np.eye(3) * sigma**2)
    estimate.add(keyframe, lines or empty)


WALLS = [
    Wall(0, 0.0, 4.0, np.array([[4.0, -5.0], [4.0, 5.0]]), 9, np.eye(2)),
    Wall(1, np.pi / 2, 3.0, np.array([[5.0, 3.0], [-5.0, 3.0]]), 9, np.eye(2)),
    # The far side of a wall at x = 1: seen from beyond it, the origin at its back.
    Wall(2, 0.0, 1.0, np.array([[1.0, -5.0], [1.0, -2.0]]), 9, np.eye(2), (), False),
]


def seen_from(pose, walls):
    """Return walls as lines in a base frame, by their endpoints; exact to a millimetre."""
    ends = np.array([w.endpoints for w in walls])
    local = np.array([[compose2(inverse2(pose), [*p, 0.0])[:2] for p in e] for e in ends])
    along = local[:, 1] - local[:, 0]
    phi = np.arctan2(-along[:, 0], along[:, 1])
    rho = np.cos(phi) * local[:, 0, 0] + np.sin(phi) * local[:, 0, 1]
    cov = np.broadcast_to(np.diag([1e-6, 1e-6]), (len(walls), 2, 2)).copy()
    return Lines(phi, rho, cov, local, np.full(len(walls), 99))


@pytest.mark.parametrize("seed", range(5))
def test_two_walls_put_a_pose_back_to_where_it_is(seed):
    """By as much as information says: 5 cm of odometry against lines flat to 1 mm."""
    config = Config()
    config.walls.flatness = 0.001
    random = np.random.default_rng(seed)
    truth = np.array([0.3, -0.2, 0.4])
    p_map_walls = random.normal(size=3)
    estimate = LiveEstimate(config)
    add(estimate, 0, np.zeros(3))
    start = compose2(p_map_walls, np.zeros(3))
    estimate.take(SolvedKeyframe(0, start, np.zeros((3, 3))), MapWalls.of(WALLS[:2], p_map_walls))
    error = random.normal(size=3) * [0.01, 0.01, 0.003]
    add(estimate, 1, truth + error, seen_from(truth, WALLS[:2]))
    found = estimate.pose(TrackedPose(0, 1, np.zeros(3), np.zeros((3, 3))))
    assert np.abs(between2(compose2(p_map_walls, truth), found)[:2]).max() < 0.001
    # Along one wall alone it stays where odometry put it.
    single = LiveEstimate(config)
    add(single, 0, np.zeros(3))
    single.take(SolvedKeyframe(0, np.zeros(3), np.zeros((3, 3))), MapWalls.of(WALLS, np.zeros(3)))
    add(single, 1, truth + error, seen_from(truth, WALLS[:1]))
    found = single.pose(TrackedPose(0, 1, np.zeros(3), np.zeros((3, 3))))
    assert found[0] == pytest.approx(truth[0], abs=0.002)
    assert found[1] == pytest.approx(truth[1] + error[1], abs=0.002)
    cov = single.covariance(TrackedPose(0, 1, np.zeros(3), np.zeros((3, 3))))
    assert cov[0, 0] < 1e-4 < 1e-3 < cov[1, 1]


def test_the_two_sides_of_a_wall_are_two_walls():
    walls = MapWalls.of(WALLS, np.zeros(3))
    assert walls.phi[2] == pytest.approx(np.pi)
    assert walls.rho.tolist() == pytest.approx([4.0, 3.0, -1.0])
    assert walls.extent[2].tolist() == pytest.approx([2.0, 5.0])
    estimate = LiveEstimate(Config())
    add(estimate, 0, np.zeros(3))
    estimate.take(SolvedKeyframe(0, np.zeros(3), np.zeros((3, 3))), walls)
    front = [Wall(0, 0.0, 1.02, np.array([[1.02, -5.0], [1.02, -2.0]]), 9, np.eye(2))]
    lines = seen_from(np.zeros(3), front)
    assert estimate._wall_of(lines, 0, np.zeros(3)) == -1
    turned = Lines(lines.phi + np.pi, -lines.rho, lines.cov, lines.endpoints, lines.count)
    assert estimate._wall_of(turned, 0, np.zeros(3)) == 2
