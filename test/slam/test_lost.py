"""A robot that is carried away while its wheels stand still: noticed, found again, no bend."""

from dataclasses import replace

import numpy as np
import plan
import pytest
from solved import solved_map

from tccm_ros.config import Config
from tccm_ros.geometry import between2
from tccm_ros.records import PoseGuess
from tccm_ros.slam.matching.alignment import seen_through
from tccm_ros.slam.tracking import LocalisationState, Tracker
from tccm_ros.slam.wall_slam import WallSlam

WALLS = plan.ring()
LAP = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (2, 0)]
STANDING = 40
"""Scans (4 s) of a robot that stands where it was put down."""


def carried(walls, before, after, seed=5):
    """Return a run whose robot is put down elsewhere after one route and goes on by another.

    Its truth is relative to the first pose; its odometry goes on where it was.
    """
    first = plan.drive(walls, np.concatenate([before, [before[-1]] * 10]), seed=seed)
    start = int(first.stamps_ns[-1]) + 100_000_000
    poses = np.concatenate([[after[0]] * STANDING, after])
    second = plan.drive(walls, poses, seed=seed + 1, start_ns=start)
    T_odom = first.scans[-1].T_odom_base[0]
    scans = [replace(s, T_odom_base=(T_odom @ s.T_odom_base[0])[None]) for s in second.scans]
    truth = between2(before[0], np.concatenate([before, [before[-1]] * 10, poses]))
    return plan.Run(truth, first.scans + scans), len(first.scans)


@pytest.fixture(scope="module")
def run():
    """A lap; it is put down askew 5 m further on, and goes on round the ring."""
    after = [(6.5, -0.5), (7, 0), (12, 0), (12, 9), (3, 9)]
    return carried(WALLS, plan.route(LAP), plan.route(after))


@pytest.fixture(scope="module")
def mapped(run):
    slam, lost_s, found = WallSlam(Config()), None, None
    for k, scan in enumerate(run[0].scans):
        slam.add_scan(scan)
        if slam.is_lost and lost_s is None:
            lost_s = 0.1 * (k - run[1])
        if lost_s is not None and not slam.is_lost and found is None:
            found = k
    return slam, slam.solve(), lost_s, found


def test_kidnapped_robot_is_lost_within_three_seconds_and_found_again(run, mapped):
    _, solution, lost_s, found = mapped
    assert 0.0 < lost_s < 3.0
    assert found is not None
    assert len(solution.stamps_ns) == len(run[0].scans)


def test_the_map_is_not_bent(run, mapped):
    _, solution, *_ = mapped
    rms_m, rms_rad = plan.errors(run[0].truth[: run[1]], solution.poses[: run[1]])
    assert rms_m < 0.02
    assert rms_rad < np.radians(0.2)
    after = slice(run[1] + STANDING, None)
    assert plan.errors(run[0].truth[after], solution.poses[after])[0] < 0.03


def test_the_tracker_says_lost_then_searching_then_tracking(run, mapped):
    slam, solution, *_ = mapped
    tracker, states = Tracker(Config()), []
    for scan in run[0].scans:
        tracker.add(scan)
        states.append(tracker.state)
    at = run[1]
    assert set(states[: at + 1]) == {LocalisationState.TRACKING}
    assert LocalisationState.LOST in states[at : at + 30]
    assert states[-1] == LocalisationState.SEARCHING
    assert tracker.counts["lost"] == 1
    tracker.take(solved_map(slam)[1])
    assert tracker.state == LocalisationState.TRACKING
    assert np.allclose(tracker.current_pose().pose, solution.poses[-1], atol=1e-6)


def test_scans_of_a_lost_robot_are_not_mapped():
    """It is put down in a room that nothing has seen: the map stays as it was."""
    walls = np.concatenate([WALLS, plan.box(40.0, 40.0, 47.0, 44.5)])
    # For less than 2 m and 10 s: after that it is a trajectory of its own.
    before, after = plan.route(LAP[:4]), plan.route([(42, 42), (43.2, 42.4)])
    run, at = carried(walls, before, after)
    slam = WallSlam(Config())
    for scan in run.scans[:at]:
        slam.add_scan(scan)
    alone = slam.solve()
    for scan in run.scans[at:]:
        slam.add_scan(scan)
    solution = slam.solve()
    assert slam.is_lost
    # The scans until it was noticed hang on the last keyframe; none comes after.
    assert at <= len(solution.stamps_ns) < at + 30
    assert len(solution.walls) == len(alone.walls)
    assert np.allclose(solution.poses[:at], alone.poses, atol=1e-6)
    saved = slam.saved(solution)
    assert set(saved["keyframe_session"].tolist()) == {0}
    again = WallSlam.from_saved(Config(), saved).solve()
    assert len(again.keyframes) == len(alone.keyframes)


def test_supplied_pose_places_the_robot_where_a_scan_fits(run):
    """It stands where it was put down, and is told the pose to 0.4 m and 6 deg."""
    run, at = run
    slam, tracker = WallSlam(Config()), Tracker(Config())
    for scan in run.scans[:at]:
        slam.add_scan(scan)
        tracker.add(scan)
    error = np.array([0.3, -0.25, 0.1])
    guess = PoseGuess(int(run.stamps_ns[at]), run.truth[at] + error, np.diag([0.25, 0.25, 0.07]))
    for processor in (slam.add_guess, tracker.add):
        processor(guess)
    slam.add_scan(run.scans[at])
    tracker.add(run.scans[at])
    assert not slam.is_lost
    # The known pose is kept until a scan fits the supplied one.
    assert tracker.state == LocalisationState.TRACKING
    assert np.hypot(*between2(run.truth[at - 1], tracker.current_pose().pose)[:2]) < 0.05
    assert slam.is_at_given_pose
    solution, taken = solved_map(slam)
    tracker.take(taken)
    assert tracker.state == LocalisationState.TRACKING
    for pose in (solution.poses[-1], tracker.current_pose().pose):
        assert np.hypot(*between2(run.truth[at], pose)[:2]) < 0.03
        assert abs(between2(run.truth[at], pose)[2]) < np.radians(0.5)


def test_wrong_supplied_pose_removes_nothing_of_a_localised_robot(run):
    run, at = run
    slam, tracker = WallSlam(Config()), Tracker(Config())
    for scan in run.scans[: at - 1]:
        slam.add_scan(scan)
        tracker.add(scan)
    far = PoseGuess(int(run.stamps_ns[at - 1]), np.array([11.5, 8.0, 1.0]), np.diag([0.2] * 3))
    for processor in (slam.add_guess, tracker.add):
        processor(far)
    slam.add_scan(run.scans[at - 1])
    tracker.add(run.scans[at - 1])
    assert tracker.state == LocalisationState.TRACKING
    assert slam.is_located
    assert not slam.is_at_given_pose
    tracker.take(solved_map(slam)[1])
    for pose in (slam.solve().poses[-1], tracker.current_pose().pose):
        assert np.hypot(*between2(run.truth[at - 1], pose)[:2]) < 0.05


def test_wrong_supplied_pose_is_refused(run):
    run, at = run
    slam = WallSlam(Config())
    for scan in run.scans[:at]:
        slam.add_scan(scan)
    outside = np.array([6.0, 4.5, 0.3])  # within the block that the ring goes round
    slam.add_guess(PoseGuess(int(run.stamps_ns[at]), outside, np.diag([0.04, 0.04, 0.01])))
    for scan in run.scans[at : at + 20]:
        slam.add_scan(scan)
    assert slam.is_lost


def test_person_walking_past_does_not_make_a_stationary_robot_lost():
    """Half of the beams end at people for a second."""
    poses = np.concatenate([plan.route([(0, 0), (3, 0)]), [[3.0, 0.0, 0.0]] * 40])
    run = plan.drive(WALLS, poses)
    scans = []
    for k, posed in enumerate(run.scans):
        ranges = posed.scan.ranges.copy()
        if len(run.scans) - 25 < k < len(run.scans) - 15:
            ranges[40:140] = np.minimum(ranges[40:140], 0.6)
        scans.append(replace(posed, record=replace(posed.scan, ranges=ranges)))
    slam = WallSlam(Config())
    for scan in scans:
        slam.add_scan(scan)
        assert not slam.is_lost
    assert plan.errors(run.truth, slam.solve().poses)[0] < 0.02


def test_a_door_that_opens_before_a_standing_robot_carries_nobody():
    """A quarter of its beams go through where the door was, the others fit the map as before."""
    wall = np.array([[[3.2, -1.0], [3.2, -0.45]], [[3.2, 0.45], [3.2, 1.0]]])
    door = np.array([[[3.2, -0.45], [3.2, 0.45]]])
    route, standing = plan.route([(0, 0), (2, 0)]), np.repeat([[2.0, 0.0, 0.0]], STANDING, axis=0)
    closed = plan.drive(np.concatenate([WALLS, wall, door]), np.concatenate([route, standing]))
    start = int(closed.stamps_ns[-1]) + 100_000_000
    opened = plan.drive(np.concatenate([WALLS, wall]), standing, seed=1, start_ns=start)
    T_odom = closed.scans[-1].T_odom_base[0]
    later = [replace(s, T_odom_base=(T_odom @ s.T_odom_base[0])[None]) for s in opened.scans]
    slam = WallSlam(Config())
    for k, scan in enumerate(closed.scans + later):
        slam.add_scan(scan)
        assert not slam.is_lost
        front = slam._front
        if front._map is not None and k == len(closed.scans):
            assert seen_through(front.pose, front._last, front._map.lines) > 0.2
    assert len(slam.solve().poses) == len(closed.scans) + len(later)


# --- a robot that starts anywhere in a saved map ---

STARTS = [(0.0, 0.0, 0.3), (8.0, 9.1, 3.0), (12.1, 4.0, -1.5)]


@pytest.fixture(scope="module")
def saved():
    slam = WallSlam(Config())
    for scan in plan.drive(WALLS, plan.route(LAP), seed=2).scans:
        slam.add_scan(scan)
    return slam.saved()


def standing(place, count=20, walls=WALLS):
    return plan.drive(walls, np.array([place] * count), seed=9).scans


@pytest.mark.parametrize("place", STARTS)
def test_a_robot_that_stands_is_found_by_its_first_scan_or_waits(saved, place):
    """Never wrongly: where one scan does not tell, it says what it waits for."""
    slam = WallSlam.from_saved(Config(), saved)
    pose = slam.add_scan(standing(place)[0]).pose
    error = between2(np.array(place), pose)
    is_right = np.hypot(*error[:2]) < 0.1 and abs(error[2]) < 0.05
    assert is_right if slam.is_located else slam.waits_for


def test_stationary_robot_at_a_unique_place_is_found(saved):
    slam = WallSlam.from_saved(Config(), saved)
    pose = slam.add_scan(standing((2.0, 0.3, 0.5))[0]).pose
    assert slam.is_located
    assert slam.waits_for == ""
    assert np.hypot(*between2(np.array([2.0, 0.3, 0.5]), pose)[:2]) < 0.1


def test_a_robot_whose_first_scan_is_hidden_is_found_standing(saved):
    """People stand around it at first; no keyframe comes while it stands."""
    scans = standing((2.0, 0.3, 0.5))
    ranges = np.full_like(scans[0].scan.ranges, 0.4)
    slam = WallSlam.from_saved(Config(), saved)
    slam.add_scan(replace(scans[0], record=replace(scans[0].scan, ranges=ranges)))
    assert not slam.is_located
    pose = [slam.add_scan(scan).pose for scan in scans[1:]][-1]
    assert slam.is_located
    assert np.hypot(*between2(np.array([2.0, 0.3, 0.5]), pose)[:2]) < 0.1


def test_pose_supplied_before_the_first_scan_places_a_stationary_robot(saved):
    place = np.array([8.0, 9.1, 3.0])
    slam = WallSlam.from_saved(Config(), saved)
    off = np.array([0.4, -0.3, np.radians(20.0)])
    cov = np.diag([0.25, 0.25, np.radians(15.0) ** 2])
    slam.add_guess(PoseGuess(10**18, place + off, cov))
    pose = slam.add_scan(standing(place)[0]).pose
    assert slam.is_located
    assert slam.is_at_given_pose
    assert np.hypot(*between2(place, pose)[:2]) < 0.1


def test_a_robot_in_a_room_that_the_map_does_not_have_is_found_nowhere(saved):
    walls = np.concatenate([plan.box(0.0, 0.0, 7.0, 4.5), plan.box(2.0, 1.0, 2.8, 1.6)])
    slam = WallSlam.from_saved(Config(), saved)
    for scan in plan.drive(walls, plan.route([(1, 0.6), (6, 2), (1, 3.5)]), seed=3).scans:
        slam.add_scan(scan)
        assert not slam.is_located
    assert slam.waits_for


# --- a robot in a room that no map has ---


def with_annex():
    """Return the ring (N, 2, 2) with a door in its east side to a room that is 7 m long."""
    room = plan.box(13.2, 2.0, 20.2, 6.5)
    ring = plan.ring()
    is_east = (ring[:, :, 0] == 13.0).all(axis=1)
    door = [[[x, y], [x, to]] for x in (13.0, 13.2) for y, to in ((-1.0, 4.2), (5.2, 10.0))]
    posts = [[[13.0, y], [13.2, y]] for y in (4.2, 5.2)]
    is_west = (room[:, :, 0] == 13.2).all(axis=1)
    boxes = [plan.box(16.0, 2.0, 16.8, 2.6), plan.box(18.5, 5.9, 19.7, 6.5)]
    return np.concatenate([ring[~is_east], door, posts, room[~is_west], *boxes])


ANNEX = with_annex()
INSIDE = plan.route([(19.0, 3.0), (19.3, 4.7), (17.0, 5.2), (17.0, 3.2), (15.5, 3.4)])
OUTSIDE = plan.route([(15.5, 3.4), (15.0, 4.7), (12.0, 4.7), (12.0, 9.0), (6.0, 9.0)])
FROM_THE_ROOM = np.concatenate([INSIDE, OUTSIDE])


@pytest.fixture(scope="module")
def ring_alone():
    """The map of the ring, made while the door was shut."""
    slam = WallSlam(Config())
    for scan in plan.drive(WALLS, plan.route(LAP), seed=2).scans:
        slam.add_scan(scan)
    return slam.saved()


def drive_on(slam, poses, start_s=0.0, seed=6):
    """Return a row for each scan: path (m), and whether it has a place, and one beside the map."""
    start_ns = 2 * 10**18 + round(start_s * 1e9)
    rows = []
    for k, scan in enumerate(plan.drive(ANNEX, poses, seed=seed, start_ns=start_ns).scans):
        slam.add_scan(scan)
        path = np.hypot(*np.diff(poses[: k + 1, :2], axis=0).T).sum()
        rows.append((path, slam.is_located, slam.is_unjoined))
    return np.array(rows)


def errors_of_session(solution, poses, session_first):
    """Return the errors (K, 3) of the keyframes from one on, in the map's frame."""
    stamps = np.array([k.stamp_ns for k in solution.keyframes[session_first:]])
    scans = (stamps - 2 * 10**18) // 100_000_000
    truth = between2(np.array([0.0, 0.0, 0.0]), poses[scans])
    return between2(truth, np.array([k.pose for k in solution.keyframes[session_first:]]))


def test_a_new_trajectory_begins_beside_the_map_after_two_metres(ring_alone):
    slam = WallSlam.from_saved(Config(), ring_alone)
    path, has_place, is_unjoined = drive_on(slam, INSIDE).T
    assert not has_place.any()
    assert 2.0 <= path[np.argmax(is_unjoined)] < 2.5
    assert is_unjoined[np.argmax(is_unjoined) :].all()
    assert "beside the map" in slam.waits_for
    assert slam.unjoined_trajectories == 1
    solution = slam.solve()
    first = len(ring_alone["keyframe_stamp_ns"])
    x = np.array([k.pose[0] for k in solution.keyframes])
    assert x[first:].min() > x[:first].max() + 29.9
    # In itself it is right, and what the map has is where it was.
    moved = np.array([k.pose for k in solution.keyframes[first:]])
    scans = [(k.stamp_ns - 2 * 10**18) // 100_000_000 for k in solution.keyframes[first:]]
    error = between2(between2(INSIDE[0], INSIDE[scans]), between2(moved[0], moved))
    assert np.abs(error[:, :2]).max() < 0.05
    before = ring_alone["keyframe_pose"]
    after = np.array([k.pose for k in solution.keyframes[:first]])
    assert np.abs(before - after).max() < 0.02


def test_a_new_trajectory_begins_after_ten_seconds_of_standing(ring_alone):
    slam = WallSlam.from_saved(Config(), ring_alone)
    _, has_place, is_unjoined = drive_on(slam, np.array([INSIDE[0]] * 120)).T
    assert not has_place.any()
    # With the first search, each half second, at least 10 s after the first scan.
    assert 100 <= np.argmax(is_unjoined) <= 105


def test_separate_trajectory_is_joined_where_it_meets_the_map(ring_alone):
    slam = WallSlam.from_saved(Config(), ring_alone)
    _, has_place, is_unjoined = drive_on(slam, FROM_THE_ROOM).T
    assert not has_place[: len(INSIDE)].any()
    assert has_place[-1]
    assert not is_unjoined[-1]
    assert slam.waits_for == ""
    assert slam.unjoined_trajectories == 0
    first = len(ring_alone["keyframe_stamp_ns"])
    error = errors_of_session(slam.solve(), FROM_THE_ROOM, first)
    assert np.abs(error[:, :2]).max() < 0.15
    assert np.abs(error[:, 2]).max() < 0.03


def test_a_saved_trajectory_is_found_again_and_joined_by_a_later_drive(ring_alone):
    slam = WallSlam.from_saved(Config(), ring_alone)
    drive_on(slam, INSIDE)
    slam = WallSlam.from_saved(Config(), slam.saved())
    assert slam.unjoined_trajectories == 1
    _, has_place, _ = drive_on(slam, FROM_THE_ROOM, start_s=1000.0, seed=7).T
    assert has_place[-1]
    assert slam.unjoined_trajectories == 0
    first = len(ring_alone["keyframe_stamp_ns"])
    solution = slam.solve()
    between = [FROM_THE_ROOM[:1]] * (10_000 - len(INSIDE))
    error = errors_of_session(solution, np.concatenate([INSIDE, *between, FROM_THE_ROOM]), first)
    assert np.abs(error[:, :2]).max() < 0.15


def test_a_map_that_must_not_change_gets_no_trajectory(ring_alone):
    slam = WallSlam.from_saved(Config(graph={"mode": "localisation"}), ring_alone)
    _, has_place, is_unjoined = drive_on(slam, INSIDE).T
    assert not has_place.any()
    assert not is_unjoined.any()


def test_a_lost_robot_in_a_room_that_no_map_has_goes_on_beside_the_map():
    run, _ = carried(ANNEX, plan.route(LAP), INSIDE)
    slam = WallSlam(Config())
    for scan in run.scans:
        slam.add_scan(scan)
    assert slam.is_unjoined
    assert not slam.is_lost
    assert not slam.is_located
    assert slam.saved()["unjoined_sessions"].tolist() == [[1, 1]]
