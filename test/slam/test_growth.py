"""Solutions that go on from the one before, against the batch of the same records."""

from dataclasses import replace

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import compose2, wrap_angle
from tccm_ros.slam import growth, wall_slam
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.slam.walls.association import associate_walls
from tccm_ros.slam.walls.growing import GrowingWalls

RING = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (12, 0), (12, 9), (6, 9)]
VIEW_STEP, LATE_NS = 40, 30_000_000
MAX_M, MAX_RAD = 1e-3, np.radians(0.01)
"""Tolerance between a solution and its batch (docs/design/wall_slam.md)."""


@pytest.fixture(scope="module")
def laps():
    return plan.drive(plan.ring(), plan.route(RING), seed=3)


@pytest.fixture
def small(monkeypatch):
    """Let a graph go on from the batch of its first keyframes."""
    monkeypatch.setattr(wall_slam, "MIN_KEYFRAMES", 20)


def steps(run, config=None, every=25):
    """Yield the processor after some scans, and the stamps of the views until then."""
    slam = WallSlam(config or Config())
    for k, scan in enumerate(run.scans):
        slam.add_scan(scan)
        if k % every == every - 1 or k == len(run.scans) - 1:
            yield slam, [int(s) + LATE_NS for s in run.stamps_ns[10:k:VIEW_STEP]]


def batch_of(slam, views):
    """Return the batch of the same records, and let the growth go on afterwards."""
    kept, slam._growth = slam._growth, None
    try:
        return slam.solve(views)
    finally:
        slam._growth = kept


def poses_of(solution):
    return np.array([keyframe.pose for keyframe in solution.keyframes])


def distance(one, other):
    """Return the largest distance of keyframes and views of two solutions, m and rad."""
    poses = poses_of(one) - poses_of(other)
    views = np.linalg.norm(one.T_map_views[:, :3, 3] - other.T_map_views[:, :3, 3], axis=1)
    away = max(np.hypot(*poses[:, :2].T).max(), views.max(initial=0.0))
    return float(away), float(np.abs(wrap_angle(poses[:, 2])).max())


@pytest.mark.usefixtures("small")
def test_each_solution_of_a_ring_is_near_its_batch(laps):
    grown = 0
    for slam, views in steps(laps):
        solution = slam.solve(views, is_final=False)
        batch = batch_of(slam, views)
        assert len(solution.keyframes) == len(batch.keyframes)
        assert np.array_equal(solution.stamps_ns, batch.stamps_ns)
        if solution.is_batch:
            continue
        grown += 1
        away_m, away_rad = distance(solution, batch)
        assert away_m < MAX_M
        assert away_rad < MAX_RAD
        assert [(loop.from_id, loop.to_id, loop.accepted) for loop in solution.loops] == [
            (loop.from_id, loop.to_id, loop.accepted) for loop in batch.loops
        ]
    assert any(loop.accepted for loop in solution.loops)
    assert grown > 10


@pytest.mark.usefixtures("small")
def test_growth_uses_all_observations_since_the_batch(laps):
    """Nothing that was seen since the batch is left out: lines, walls, corners, covariance."""
    seen = grown = 0
    for slam, views in steps(laps):
        solution = slam.solve(views, is_final=False)
        batch = batch_of(slam, views)
        if solution.is_batch:
            continue
        grown += 1
        lines = [sum(wall.observations for wall in s.walls) for s in (solution, batch)]
        assert lines[0] == pytest.approx(lines[1], rel=0.03)
        sigmas = [np.sqrt(np.diag(s.cov_keyframes[-1])) for s in (solution, batch)]
        # The error of odometry's scale is filtered, and not smoothed: NEES within 0.5 and 2.
        assert np.all(np.abs(np.log(sigmas[0] / sigmas[1])) < 0.5 * np.log(2.0))
        seen += sum(len(wall.corners) for wall in solution.walls)
        for wall in solution.walls:
            near = [abs(wrap_angle(wall.phi - w.phi)) + abs(wall.rho - w.rho) for w in batch.walls]
            assert min(near) < 0.01
    assert grown > 10
    assert seen


@pytest.mark.usefixtures("small")
def test_the_final_solution_is_the_batch_to_the_bit(laps):
    for slam, views in steps(laps):
        slam.solve(views, is_final=False)
    final = slam.solve(views)
    for fresh, _ in steps(laps, every=len(laps.scans)):
        expected = fresh.solve(views)
    assert final.is_batch
    assert final.poses.tobytes() == expected.poses.tobytes()
    assert final.T_map_views.tobytes() == expected.T_map_views.tobytes()
    assert final.cov_keyframes.tobytes() == expected.cov_keyframes.tobytes()
    assert [w.endpoints.tobytes() for w in final.walls] == [
        w.endpoints.tobytes() for w in expected.walls
    ]


@pytest.mark.usefixtures("small")
def test_map_saved_while_growing_equals_its_solution(laps):
    for slam, views in steps(laps):
        solution = slam.solve(views, is_final=False)
    assert not solution.is_batch
    arrays = slam.saved(solution)
    again = WallSlam.from_saved(Config(), arrays).solve()
    moved = poses_of(again) - poses_of(solution)
    assert np.hypot(*moved[:, :2].T).max() < MAX_M
    assert np.abs(wrap_angle(moved[:, 2])).max() < MAX_RAD


@pytest.mark.usefixtures("small")
def test_a_wrong_loop_closure_asks_for_a_batch_that_takes_it_out(laps, monkeypatch):
    monkeypatch.setattr(growth, "MAX_MOVED", np.inf)  # what it moves would tell as well
    for slam, views in steps(laps):
        solution = slam.solve(views, is_final=False)
    assert not solution.is_batch
    right = slam._closer.accepted[-1]
    wrong = compose2(right.delta, np.array([0.6, 0.4, 0.1]))
    slam._closer.accepted.append(replace(right, delta=wrong))
    asked = slam.solve(views, is_final=False)
    assert asked.is_batch
    assert sum(loop.accepted for loop in asked.loops) == len(slam._closer.accepted) - 1


@pytest.mark.usefixtures("small")
def test_a_map_that_moved_further_than_lines_may_be_from_walls_is_a_batch(laps, monkeypatch):
    """Otherwise lines would stay with walls that they do not fit any more."""
    monkeypatch.setattr(growth, "MAX_MOVED", 0.0)
    assert all(slam.solve(views, is_final=False).is_batch for slam, views in steps(laps, every=100))


def test_small_graphs_are_batches(laps):
    for slam, views in steps(laps, every=100):
        assert slam.solve(views, is_final=False).is_batch


def test_walls_that_grow_are_those_of_the_whole_drive(laps):
    """Added keyframe by keyframe, at poses that do not change, they are those of one pass."""
    for slam, _ in steps(laps, every=len(laps.scans)):
        solution = slam.solve()
    poses, lines, config = poses_of(solution), slam._lines, Config()
    whole = associate_walls(poses, lines, config)
    first = 40
    table = associate_walls(poses[:first], lines[:first], config)
    walls = GrowingWalls(table, poses[:first], lines[:first], config)
    for k in range(first, len(lines)):
        walls.add(poses[: k + 1], lines[: k + 1], k)
    grown = walls.table
    assert len(grown) == len(whole)
    assert np.array_equal(grown.keyframe, whole.keyframe)
    # New walls come last, so that numbers differ: the same lines are together.
    pairs = set(zip(grown.wall.tolist(), whole.wall.tolist()))
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
    order = dict(pairs)
    match = [order[w] for w in range(len(grown))]
    assert np.allclose(grown.phi, whole.phi[match], atol=1e-12)
    assert np.allclose(grown.rho, whole.rho[match], atol=1e-12)
    assert np.allclose(grown.extent, whole.extent[match], atol=1e-12)
