"""Where geometry says little, odometry rules: plain walls that go on beyond the laser's range."""

from dataclasses import replace

import numpy as np
import plan
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tccm_ros.config import Config
from tccm_ros.geometry import planar
from tccm_ros.slam.front_end import FrontEnd, decayed, decaying_motion
from tccm_ros.slam.matching.alignment import align
from tccm_ros.slam.matching.level_scan import make_level_scan, point_sigma
from tccm_ros.slam.odometry_model import odometry_covariance

FRONT = np.array([[[1.0, -60.0], [1.0, 60.0]]])
CORRIDOR = np.array([[[-60.0, 1.0], [90.0, 1.0]], [[-60.0, -1.0], [90.0, -1.0]]])
STANDING = np.zeros((80, 3))
NICHES = np.concatenate([CORRIDOR, *(plan.box(x, 0.7, x + 0.4, 1.0) for x in (2, 5, 9))])


def follow(run):
    """Return the front end after a run, and its poses (N, 3)."""
    front, poses = FrontEnd(Config()), []
    for posed in run.scans:
        front.add(make_level_scan(posed, Config()))
        poses.append(front.pose)
    return front, np.array(poses)


@pytest.mark.parametrize("sigma", [0.005, 0.010])
@pytest.mark.parametrize("distance", [0.4, 1.0, 3.0])
def test_a_robot_that_stands_before_a_front_from_the_start_stays(distance, sigma):
    run = plan.drive(FRONT * [distance, 1.0], STANDING, sigma=sigma, beams=361, mount=(0, 0, 0))
    _, poses = follow(run)
    assert np.hypot(*poses.T[:2]).max() < 0.010
    assert np.abs(poses[:, 2]).max() < np.radians(0.2)


@pytest.mark.parametrize("seed", range(6))
def test_a_robot_that_stands_before_a_pole_keeps_its_heading(seed):
    """A pole hardly shows the heading: what noise adds to it must not add up from scan to scan."""
    angles = np.linspace(0.0, 2.0 * np.pi, 13)
    ring = np.column_stack([2.5 + 0.15 * np.cos(angles), 0.8 + 0.15 * np.sin(angles)])
    pole = np.stack([ring[:-1], ring[1:]], axis=1)
    run = plan.drive(pole, np.zeros((200, 3)), seed=seed, beams=361, mount=(0, 0, 0))
    _, poses = follow(run)
    assert np.hypot(*poses.T[:2]).max() < 0.010
    assert np.abs(poses[:, 2]).max() < np.radians(0.2)


@pytest.mark.parametrize(("source", "independent"), [("none", True), ("depth", False)])
def test_depths_have_the_same_weight_in_pose_and_covariance(source, independent):
    """At the pose, the pulls of the match and of odometry, which errs by 3 cm, are equal."""
    config = Config()
    config.sensors.level_from = source
    ends = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]])
    room, exact = plan.box(-4.0, -3.0, 4.0, 3.0), {"drift": 0.0, "noise": (0.0, 0.0)}
    run = plan.drive(room, ends, scale=1.15, beams=91, mount=(0, 0, 0), **exact)
    front = FrontEnd(config)
    for posed in run.scans:
        scan = make_level_scan(posed, config)
        front.add(scan)
    prior, sigma = planar(run.scans[1].T_odom_base[0]), point_sigma(config)
    match = align(front._map.lines, scan.points, scan.normals, front.pose, sigma)
    used = config.matching.correlated_beams if independent else 1.0
    pull = used * front._information @ (front.pose - match.pose)
    by_odometry = np.linalg.solve(odometry_covariance(prior, config.odometry), prior - front.pose)
    # Beams that choose other neighbours make the equations nonlinear; a wrong weight is fourfold.
    assert pull[0] == pytest.approx(by_odometry[0], rel=0.25)


@pytest.mark.parametrize("seed", [1, 3])
def test_without_odometry_a_motion_that_nothing_observes_decays(seed):
    """Beyond the last niche at 9.4 m, nothing tells that the robot drives on."""
    poses = np.column_stack([np.arange(0.0, 14.0, 0.1), np.zeros((140, 2))])
    run = plan.drive(NICHES, poses, beams=361, odometry=False, seed=seed)
    _, found = follow(run)
    # At 1 m/s, a motion that decays in 0.5 s goes on for 0.5 m, one that does not for 4.5 m.
    assert np.abs(found[95:, 0] - 9.5).max() < 0.8


@pytest.mark.parametrize("seed", [0, 1, 3, 7])
def test_a_camera_is_never_worse_than_its_odometry(seed):
    """Within 30 deg and 3 m it sees a short arc of furniture, which fits by accident elsewhere."""
    random = np.random.default_rng(seed)
    places, sides = (
        random.uniform([-3.0, -2.5], [3.0, 2.5], (30, 2)),
        random.uniform(0.2, 0.7, (30, 2)),
    )
    around = [(*low, *(low + side)) for low, side in zip(places, sides)]
    free = [b for b in around if abs(b[0] + b[2]) > 3.8 or abs(b[1] + b[3]) > 3.0]
    room = np.concatenate([plan.box(-4.0, -3.0, 4.0, 3.0), *(plan.box(*b) for b in free)])
    lap = [(-1.2, -0.8), (1.2, -0.8), (1.2, 0.8), (-1.2, 0.8), (-1.2, -0.8)]
    route = plan.route(lap * 2, yaw_step=0.1)
    run = plan.drive(room, route, seed=seed, sigma=0.015, beams=361, mount=(0, 0, 0), drift=0.01)
    is_cut = np.abs(np.linspace(-90.0, 90.0, 361)) > 30.0
    for posed in run.scans:
        posed.scan.ranges[is_cut | (posed.scan.ranges > 3.0)] = np.nan
    _, found = follow(run)
    odometry = np.array([planar(posed.T_odom_base[0]) for posed in run.scans])
    by_odometry = plan.errors(run.truth, odometry)[0]
    assert plan.errors(run.truth, found)[0] < max(1.1 * by_odometry, by_odometry + 0.010)


@pytest.mark.parametrize(("half_view", "jump"), [(90.0, 0.8), (40.0, 0.0)])
def test_better_match_overrules_odometry_for_lasers_and_not_for_cameras(half_view, jump):
    """The last scan is of a place 0.8 m further on than odometry says."""
    room = np.concatenate([plan.box(-2.0, -3.0, 6.0, 3.0), plan.box(4.0, -1.0, 4.7, 0.0)])
    places = np.column_stack([np.arange(0.0, 2.0, 0.1), np.zeros((20, 2))])
    exact = {"drift": 0.0, "scale": 1.0, "noise": (0.0, 0.0), "mount": (0, 0, 0)}
    run = plan.drive(room, places, beams=181, **exact)
    further = plan.drive(room, [(1.9 + 0.8, 0.0, 0.0)], beams=181, **exact)
    run.scans[-1].scan.ranges[:] = further.scans[0].scan.ranges
    for posed in run.scans:
        posed.scan.ranges[np.abs(np.linspace(-90.0, 90.0, 181)) > half_view] = np.nan
    _, poses = follow(run)
    assert poses[-1, 0] == pytest.approx(1.9 + jump, abs=0.1)


FINITE = {"allow_nan": False, "allow_infinity": False}


def matrices(scale):
    """Return a strategy of positive semidefinite matrices (3, 3) up to about `scale`."""
    entry = st.floats(-1.0, 1.0, **FINITE)
    square = arrays(float, (3, 3), elements=entry)
    return st.builds(lambda A, e: scale * 10.0**e * (A @ A.T), square, st.floats(-6.0, 0.0))


@given(
    velocity=arrays(float, 3, elements=st.floats(-5.0, 5.0, **FINITE)),
    seconds=st.floats(0.01, 10.0),
    information=matrices(1e6),
    cov=matrices(10.0),
)
def test_the_decay_of_the_velocity_is_a_contraction(velocity, seconds, information, cov):
    cov = cov + 1e-4 * np.eye(3)
    after = decayed(velocity, seconds, information, cov)
    weight = np.linalg.inv(cov)
    before, now = (float(v @ weight @ v) for v in (velocity, after))
    assert now <= before * (1.0 + 1e-6) + 1e-9
    # Where nothing is observed, as much is left as at the end of an exponential decay.
    x = seconds / 0.5
    unobserved = decayed(velocity, seconds, np.zeros((3, 3)), cov)
    assert unobserved == pytest.approx(velocity * x / np.expm1(x), abs=1e-9)
    assert np.abs(decaying_motion(velocity, seconds)).max() <= 0.5 * np.abs(velocity).max()


# A room of 10 m with two cupboards; the robot drives 4 m at 0.5 m/s, and stands for 4 s.
ROOM = np.concatenate(
    [
        plan.box(-2.0, -5.0, 8.0, 5.0),
        plan.box(2.0, 2.0, 3.0, 2.6),
        plan.box(5.0, -4.0, 5.5, -3.0),
    ]
)
SPEED, STOPS_AT = 0.5, 8.0
BEARINGS = np.linspace(-np.pi / 2, np.pi / 2, 361)


def crowded(ranges, pose, time, people, seed):
    """Return ranges with people who walk around the robot, 0.6 to 1.2 m away."""
    random = np.random.default_rng(seed)
    start, distance, yaw_rate = (
        random.uniform(*x, people) for x in ((0, 6.3), (0.6, 1.2), (-1, 1))
    )
    angle = start + yaw_rate * time
    middles = pose[:2] + np.column_stack([np.cos(angle), np.sin(angle)]) * distance[:, None]
    middles += 0.3 * np.sin(5.0 * time + start)[:, None]
    walls = np.concatenate([plan.box(x - 0.2, y - 0.2, x + 0.2, y + 0.2) for x, y in middles])
    return np.minimum(ranges, plan.cast(walls, [*pose, 0.1, 0.0, 0.0], BEARINGS))


def drive_in_the_room(rate, *, seed, gap=0.0, people=0, crowd_time=3.0):
    """Return errors (N,) of the position, the stamps at which lost is said, and the front end."""
    times = np.arange(0.0, 12.0, 1.0 / rate)
    poses = np.column_stack([SPEED * np.minimum(times, STOPS_AT), np.zeros((len(times), 2))])
    run = plan.drive(ROOM, poses, seed=seed, beams=361, odometry=False)
    front, errors, lost = FrontEnd(Config()), [], []
    for pose, time, posed in zip(poses, times, run.scans):
        if 4.0 <= time < 4.0 + gap:
            continue
        scan = replace(posed.scan, stamp_ns=10**18 + int(time * 1e9))
        if people and 4.0 <= time < 4.0 + crowd_time:
            ranges = crowded(scan.ranges, pose, time, people, seed)
            scan = replace(scan, ranges=ranges.astype(np.float32))
        front.add(make_level_scan(replace(posed, record=scan), Config()))
        errors.append(float(np.hypot(*(front.pose - pose)[:2])))
        if front.is_pose_unknown(scan.stamp_ns):
            lost.append(time)
    return np.array(errors), lost, front


@pytest.mark.parametrize("rate", [5, 10])
@pytest.mark.parametrize("gap", [0.0, 3.0])
def test_without_odometry_a_gap_and_slow_scans_lose_nothing(rate, gap):
    errors, lost, front = drive_in_the_room(rate, seed=0, gap=gap)
    assert errors.max() < 0.02
    assert not lost
    assert front.session == 0


@pytest.mark.parametrize("rate", [5, 10])
@pytest.mark.parametrize("seed", [1, 2])
def test_lost_in_a_crowd_without_odometry_is_reported(rate, seed):
    errors, lost, front = drive_in_the_room(rate, seed=seed, people=24)
    # The robot drives 1.5 m in the crowd; its last trusted motion says at most 0.25 m of it.
    assert errors.max() < 1.5 + 0.25
    assert min(lost) < 4.0 + 2.0
    assert max(lost) < 4.0 + 3.0 + 0.5
    assert errors[-1] < 0.02
    assert front.session == 0


@pytest.mark.parametrize("rate", [5, 10])
def test_without_odometry_a_few_people_do_not_carry_the_robot_along(rate):
    errors, _, front = drive_in_the_room(rate, seed=3, people=8)
    assert errors.max() < 0.05
    assert front.session == 0


def test_without_odometry_no_wide_search_is_repeated(monkeypatch):
    searches, align_near = [], FrontEnd._align_near

    def recorded(front, scan, centre, prior, window):
        searches.append((scan.stamp_ns, window, *centre))
        return align_near(front, scan, centre, prior, window)

    monkeypatch.setattr(FrontEnd, "_align_near", recorded)
    drive_in_the_room(5, seed=1, people=24)
    assert len(searches) > len({stamp for stamp, *_ in searches})
    assert len(searches) == len(set(searches))


@pytest.mark.parametrize("seed", range(3))
def test_along_a_plain_corridor_the_motion_is_that_of_odometry(seed):
    poses = np.column_stack([np.arange(0.0, 25.0, 0.1), np.zeros((250, 2))])
    run = plan.drive(CORRIDOR, poses, seed=seed, beams=361, scale=1.01, drift=0.0)
    front, found = follow(run)
    odometry = planar(run.scans[-1].T_odom_base[0])
    assert abs(found[-1, 0] - odometry[0]) < 0.05
    assert abs(found[-1, 1]) < 0.03
    # Nothing shows the scale there, and the covariance is odometry's.
    assert front._scale.value == pytest.approx(1.0, abs=0.002)
    last = [t for t in front.tracked if t.pose[0] > 0.2][-1]
    by_odometry = odometry_covariance(last.pose, Config().odometry)
    assert last.cov[0, 0] == pytest.approx(by_odometry[0, 0], rel=0.1)
    assert last.cov[1, 1] < 0.2 * by_odometry[1, 1]
