"""Visibility: points that have moved leave the map, and poses behind walls are rated lower."""

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.slam.matching.alignment import Prior, agreement, align
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.matching.line_map import make_line_map
from tccm_ros.slam.matching.visibility import passes_and_hits

MARGIN = 0.2  # m behind a point: a beam that ends further has passed it
SECTORS = 512  # around a laser

ROOM = np.concatenate([plan.box(-2, -2, 6, 2), plan.box(3.0, 1.4, 3.6, 2)])


def scan_at(pose, walls=ROOM, seed=0):
    run = plan.drive(walls, np.array([pose, pose]), seed=seed, sigma=0.005, mount=(0, 0, 0))
    return make_level_scan(run.scans[0], Config())


def sector_of(x, y):
    """Return sectors as places along the edge of the square |x| + |y| = 1."""
    u = y / (np.abs(x) + np.abs(y))
    along = np.where(x < 0, 2.0 - u, np.where(y < 0, 4.0 + u, u))
    return np.minimum((along * SECTORS / 4).astype(int), SECTORS - 1)


def count_in_numpy(points, origins, scans):
    """Count passes and hits point by point over all beams, in plain numpy."""
    passes, hits = np.zeros(len(points), int), np.zeros(len(points), int)
    for origin, ends in zip(origins, scans):
        x, y = (ends - origin).T
        sector, length = sector_of(x, y), np.hypot(x, y)
        for i, (px, py) in enumerate(points - origin):
            difference = (sector - sector_of(np.array([px]), np.array([py]))) % SECTORS
            beside = length[(difference <= 1) | (difference == SECTORS - 1)]
            if len(beside):
                behind = beside.min() - np.hypot(px, py)
                passes[i] += behind > MARGIN
                hits[i] += abs(behind) <= MARGIN
    return passes, hits


@pytest.mark.parametrize("seed", range(5))
def test_passes_and_hits_are_those_of_a_count_over_all_beams(seed):
    random = np.random.default_rng(seed)
    origins = random.normal(size=(4, 2))
    scans = [origin + random.normal(size=(300, 2)) * 3.0 for origin in origins]
    points = random.normal(size=(200, 2)) * 3.0
    counts = np.array([len(s) for s in scans])
    found = passes_and_hits(points, origins, counts, np.concatenate(scans))
    np.testing.assert_array_equal(found, count_in_numpy(points, origins, scans))
    assert min(np.sum(found, axis=1)) > 20


def test_no_point_of_a_static_room_is_removed_from_the_map():
    poses = np.array([[0.4 * k, 0.1 * k, 0.3 * k] for k in range(6)])
    scans = [scan_at(p, seed=k) for k, p in enumerate(poses)]
    lines = make_line_map(poses, scans)
    for pose, scan in zip(poses, scans):
        alone = make_line_map(pose[None], [scan]).points
        near = np.hypot(*np.moveaxis(alone[:, None] - lines.points, 2, 0)).min(axis=1)
        # What was merged is 5 cm away at most; a grazed corner may be lost.
        assert (near < 0.06).mean() > 0.97


def test_a_person_who_walks_ahead_of_the_robot_leaves_no_points_behind():
    """A box of 0.4 m, 2.5 m ahead in each scan: it is gone from where three scans passed it."""
    poses = np.array([[0.4 * k - 1.0, 0.0, 0.0] for k in range(6)])
    at = [p[0] + 2.5 for p in poses]
    scans = [
        scan_at(p, np.concatenate([ROOM, plan.box(x, -0.2, x + 0.4, 0.2)]), seed=k)
        for k, (p, x) in enumerate(zip(poses, at))
    ]
    lines = make_line_map(poses, scans)
    inside = np.abs(lines.points[:, 1]) < 0.3
    trail = inside & (lines.points[:, 0] < at[-3] - 0.1) & (lines.points[:, 0] > -1.5)
    assert trail.sum() == 0
    assert (inside & (np.abs(lines.points[:, 0] - at[-1]) < 0.1)).any()


@pytest.mark.parametrize("jump", [0.4, -0.4])
def test_a_pose_that_sees_through_walls_has_a_smaller_agreement(jump):
    poses = np.array([[0.2 * k, 0.0, 0.0] for k in range(5)])
    lines = make_line_map(poses, [scan_at(p, seed=k) for k, p in enumerate(poses)])
    scan = scan_at([1.0, 0.0, 0.0], seed=9)
    hold = np.eye(3) * 1e9

    def agreement_at(x):
        pose = np.array([x, 0.0, 0.0])
        held = align(lines, scan.points, scan.normals, pose, 0.02, Prior(pose, hold))
        return agreement(held, scan, lines)

    assert agreement_at(1.0) > 0.9
    assert agreement_at(1.0 + jump) < agreement_at(1.0) - 0.15
