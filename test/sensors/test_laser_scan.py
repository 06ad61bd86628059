"""From ranges to points: hand-computed, against numpy twins, and on real recordings."""

import json
from dataclasses import replace

import numpy as np
import pytest
from bag_records import read
from fed import role_of
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import (
    MS,
    START,
    TILTING,
    description,
    joint,
    joints_at,
    odometry_at,
    robot,
    scan_at,
)
from shared_data import shared

from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.geometry import interpolate_poses, inverse, pose_from_rpy, transform
from tccm_ros.records import PosedScan, Scan, SelfShapes
from tccm_ros.robot import Robot
from tccm_ros.sensors.laser_scan import (
    beam_stamps,
    bearings,
    laser_poses,
    project,
    project_level,
    used_beams,
    valid_beams,
)
from tccm_ros.sensors.laser_scan_kernels import mark_inside, mark_valid, refine_poses
from tccm_ros.sensors.registry import default_streams

BLEND_ANGLE = 0.005  # rad between poses: blending shortens a vector by angle^2 / 8

PLAIN = read_config(None, ["scan.shadow_angle=0"])


def posed_scan(scan, T_odom_base=None, T_base_laser=None, stamps_ns=None):
    stamps_ns = np.array([scan.stamp_ns] if stamps_ns is None else stamps_ns, np.int64)
    still = np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4))
    return PosedScan(
        scan,
        stamps_ns,
        still if T_odom_base is None else np.asarray(T_odom_base),
        still if T_base_laser is None else np.asarray(T_base_laser),
    )


def put_together(records, scans="tilt_scan", config=PLAIN):
    """Return the posed scans of records, all scans being of one laser, and its mount."""
    one = Robot(config, default_streams())
    events = [e for r in records for e in one.add(role_of(r, scans), r)] + one.flush()
    return [e for e in events if isinstance(e, PosedScan)], one.sensors[scans].mount


def hits(posed, config):
    """Return the points of a scan in odom and their beams, without the robot itself."""
    return project(posed, used_beams(posed, config))


# -- which beams --------------------------------------------------


def test_ranges_invalid_by_rep_117_or_beyond_limits_are_dropped():
    ranges = [np.inf, -np.inf, np.nan, 0.0, -1.0, 0.04, 0.05, 1.0, 30.0, 30.1]
    valid = valid_beams(scan_at(START, ranges=ranges), PLAIN)
    assert valid.tolist() == [False] * 6 + [True, True, True, False]


def test_configured_limits_apply_and_a_limit_that_is_nan_admits_no_beam():
    config = read_config(None, ["scan.min_range=0.5", "scan.max_range=2", "scan.shadow_angle=0"])
    scan = scan_at(START, ranges=[0.4, 0.6, 1.9, 2.1])
    assert valid_beams(scan, config).tolist() == [False, True, True, False]
    scan = scan_at(START, ranges=[np.nan, 1.0], range_min=np.nan)
    assert valid_beams(scan, PLAIN).tolist() == [False, False]


def test_mixed_pixels_between_a_table_and_the_floor_are_dropped():
    step = 0.0065
    table, floor = np.full(10, 1.0), np.full(10, 2.0)
    scan = scan_at(START, ranges=[*table, 1.3, 1.65, *floor], angle_increment=step)
    valid = valid_beams(scan, Config())
    assert not valid[10:12].any()
    assert valid[:9].all()
    assert valid[13:].all()


def test_noisy_ranges_are_not_taken_for_mixed_pixels():
    ranges = 1.0 + 0.01 * np.random.default_rng(3).standard_normal(500).clip(-1.4, 1.4)
    assert valid_beams(scan_at(START, ranges=ranges, angle_increment=0.004), Config()).all()


@pytest.mark.parametrize("lateral", [0.7, 1.5])
def test_a_wall_along_a_corridor_is_kept(lateral):
    step = np.deg2rad(0.5)
    angles = np.arange(0.05, 1.5, step)
    ranges = lateral / np.sin(angles)
    ranges += 0.01 * np.random.default_rng(1).standard_normal(len(angles))
    scan = scan_at(START, ranges=ranges, angle_min=angles[0], angle_increment=step)
    seen = (ranges < 12.0) & (np.arange(len(angles)) > 1)
    assert valid_beams(scan, Config())[seen].mean() > 0.96


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("mixed", [0, 1, 2])
def test_the_last_beam_before_an_edge_is_kept_and_mixed_pixels_are_not(sign, mixed):
    """A line over a table from near to far, 2 to 4 cm from beam to beam, and a wall behind it."""
    step, height = np.radians(0.25), 0.7
    angles = np.arange(0.25, 0.35, step)
    ranges = height / np.sin(angles[::-1])
    behind = np.full(8, 4.0)
    between = np.linspace(ranges[-1], 4.0, mixed + 2)[1:-1]
    line = np.concatenate([ranges, between, behind]) + 0.0025 * np.random.default_rng(3).normal(
        size=len(ranges) + mixed + 8
    )
    scan = scan_at(START, ranges=line[::sign], angle_min=0.0, angle_increment=step)
    kept = valid_beams(scan, Config())[::sign]
    assert kept[: len(ranges)].all()
    assert not kept[len(ranges) : len(ranges) + mixed].any()
    without = valid_beams(scan, Config(), line_ends=False)[::sign]
    assert without[: len(ranges) - 1].all()
    assert not without[len(ranges) - 1]


def straight_twin(ranges, hit, i, step, noise):
    if i < 1 or i + 1 >= len(ranges) or not hit[i - 1 : i + 2].all():
        return False
    a, r, b = ranges[i - 1 : i + 2].astype(float)
    on_line = 2 * np.cos(step) / (1 / a + 1 / b)
    return abs(r - on_line) <= 0.5 * noise + 0.2 * max(abs(r - a), abs(r - b))


def ends_twin(ranges, kept, straight, i, step, noise):
    for inward in (-1, 1):
        k = i + inward * np.arange(-1, 6)
        in_scan = k.min() >= 0 and k.max() < len(ranges)
        if not in_scan or not kept[k[2]] or not all(straight[j] for j in k[3:6]):
            continue
        beyond, r, a, b = ranges[k[:4]].astype(float)
        on_line = 2 * np.cos(step) / a - 1 / b
        if on_line > 0 and abs(r - 1 / on_line) <= 0.5 * noise and not 0 < beyond < r:
            return True
    return False


def valid_twin(ranges, low, high, step, shadow_angle, shadow_jump, line_ends):
    with np.errstate(invalid="ignore"):
        hit = (ranges >= low) & (ranges <= high) & (ranges > 0)
    angles = step * np.arange(len(ranges))
    xy = ranges[:, None].astype(float) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shadowed = np.zeros(len(ranges), bool)
    for i in range(len(ranges)):
        for j in (i - 1, i + 1):
            if 0 <= j < len(ranges) and hit[i] and hit[j]:
                if abs(float(ranges[i]) - float(ranges[j])) <= shadow_jump:
                    continue
                line = xy[j] - xy[i]
                cosine = abs(line @ xy[i]) / np.linalg.norm(line) / np.linalg.norm(xy[i])
                shadowed[i] |= np.arccos(min(cosine, 1.0)) < shadow_angle
    straight = [straight_twin(ranges, hit, i, step, shadow_jump) for i in range(len(ranges))]
    for i in np.flatnonzero(shadowed):
        runs = [straight[k : k + 3] for k in (i - 2, i - 1, i) if k >= 0]
        shadowed[i] = not any(len(run) == 3 and all(run) for run in runs)
    kept, measured = hit & ~shadowed, np.where(hit, ranges, 0)
    for i in np.flatnonzero(shadowed) if line_ends else ():
        shadowed[i] = not ends_twin(measured, kept, straight, i, step, shadow_jump)
    return hit & ~shadowed


@given(
    st.lists(
        st.one_of(
            st.floats(0.3, 12.0).map(lambda r: round(r, 2)),
            st.sampled_from([np.inf, -np.inf, np.nan, 0.0]),
        ),
        max_size=20,
    ),
    st.sampled_from([0.004363, 0.0087266, -0.0087266]),
    st.sampled_from([0.0, 0.1437, 0.3]),
    st.booleans(),
)
@settings(deadline=None, max_examples=200)
def test_valid_beams_agree_with_a_twin(ranges, step, shadow_angle, line_ends):
    ranges = np.array(ranges, np.float32)
    got = mark_valid(ranges, 0.5, 10.0, step, shadow_angle, 0.0313, line_ends)
    with np.errstate(invalid="ignore"):
        expected = valid_twin(ranges, 0.5, 10.0, step, shadow_angle, 0.0313, line_ends)
    assert got.tolist() == expected.tolist()


# -- where they hit --------------------------------------------------


def test_bearings_and_stamps_of_beams_follow_from_the_increments():
    scan = scan_at(START, ranges=[1] * 5, angle_min=0.4, angle_increment=-0.2, time_increment=0.001)
    np.testing.assert_allclose(bearings(scan), [0.4, 0.2, 0.0, -0.2, -0.4], atol=1e-12)
    assert beam_stamps(scan).tolist() == [START + k * MS for k in range(5)]
    points, _ = hits(posed_scan(scan), PLAIN)
    np.testing.assert_allclose(points[0], [np.cos(0.4), np.sin(0.4), 0])
    np.testing.assert_allclose(points[4], [np.cos(0.4), -np.sin(0.4), 0])


def test_points_name_their_beams_and_times():
    scan = scan_at(START, ranges=[1, np.inf, 2, np.nan, 3], time_increment=0.002)
    points, beams = hits(posed_scan(scan), PLAIN)
    assert beams.tolist() == [0, 2, 4]
    assert ((beam_stamps(scan)[beams] - START) // MS).tolist() == [0, 4, 8]
    assert points.dtype == np.float64


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("axis", [1, -1])
def test_a_level_floor_is_level_however_the_laser_hangs(upside_down, axis):
    """A laser 5 cm ahead of and 2 cm above a tilt axis at 1 m looks at z = 0 while it tilts."""
    roll = np.pi if upside_down else 0.0
    text = TILTING.replace('axis xyz="0 1 0"', f'axis xyz="0 {axis} 0"').replace(
        'xyz="0.05 0 0.02" rpy="0 0 0"', f'xyz="0.05 0 0.02" rpy="{roll} 0 0"'
    )
    records = [description(text)]
    angles = np.linspace(-1, 1, 41)
    for k in range(60):
        records.append(joints_at(START + 10 * k * MS, tilt=axis * (0.3 + 0.01 * k)))
        records.append(odometry_at(START + 10 * k * MS))
    for k in range(0, 50, 5):
        tilt = 0.3 + 0.01 * k + 0.1 * np.arange(41) * 1e-3  # rad: 1 rad/s, 0.1 ms between beams
        # height of the laser, and how steeply each beam falls, by hand
        height = 1.0 - 0.05 * np.sin(tilt) + 0.02 * np.cos(tilt)
        ranges = height / (np.sin(tilt) * np.cos(angles))
        records.append(
            scan_at(
                START + 10 * k * MS,
                ranges=ranges,
                angle_min=-1.0,
                angle_increment=0.05,
                time_increment=1e-4,
            )
        )
    posed, _ = put_together(records)
    assert len(posed) == 10
    for p in posed:
        points = hits(p, PLAIN)[0]
        # a blend over 5 mrad is 3e-6 short of hits that are up to 8 m away
        np.testing.assert_allclose(points[:, 2], 0.0, atol=3e-5)
        first, last = points[0], points[-1]
        assert (first[1] > 0) == upside_down  # the first beam is at -1 rad: to the right
        assert (last[1] > 0) != upside_down


def test_a_moving_robot_sees_a_straight_wall():
    """Driving at 1 m/s and turning at 1 rad/s while a slow scan is taken."""
    n, dt = 181, 0.5e-3
    times = np.arange(n) * dt
    bearing = np.deg2rad(np.arange(n) - 90.0) * 0.9
    x, yaw = 1.0 * times, 1.0 * times
    ranges = (4.0 - x) / np.cos(bearing + yaw)
    keep = (ranges > 0) & (ranges < 25)
    ranges[~keep] = np.inf
    scan = scan_at(
        START, ranges=ranges, angle_min=bearing[0], angle_increment=bearing[1] - bearing[0],
        time_increment=dt,
    )  # fmt: skip
    stamps_ns = START + (np.linspace(0, times[-1], 10) * 1e9).round().astype(np.int64)
    seconds = (stamps_ns - START) * 1e-9
    T_odom_base = [pose_from_rpy((t, 0, 0, 0, 0, t)) for t in seconds]
    posed = posed_scan(scan, T_odom_base, np.broadcast_to(np.eye(4), (10, 4, 4)), stamps_ns)
    points = hits(posed, PLAIN)[0]
    # blending over 5 mrad shortens by 3e-6; float32 ranges err by 6e-8: 0.1 mm at 25 m
    np.testing.assert_allclose(points[:, 0], 4.0, atol=1e-4)
    level_points, beams = project_level(posed, PLAIN)
    np.testing.assert_allclose(level_points[:, 0], 4.0, atol=1e-4)
    assert beams.tolist() == np.flatnonzero(keep).tolist()


def test_level_points_are_levelled_at_the_scans_stamp():
    scan = scan_at(START, ranges=[2.0], angle_min=0.0)
    T_odom_base = pose_from_rpy((5, 6, 0.02, 0, 0.1, 0.7))
    points, _ = project_level(posed_scan(scan, T_odom_base[None]), PLAIN)
    np.testing.assert_allclose(points, [[2.0 * np.cos(0.1), 0.0]], atol=1e-12)


def test_level_points_of_backward_stamped_beams_are_in_the_base_frame():
    scan = scan_at(
        START, ranges=[2.0, 2.0], angle_min=0.0, angle_increment=0.0, time_increment=-0.1
    )
    T = [pose_from_rpy((x, 0, 0, 0, 0, 0)) for x in (-0.1, 0.0)]
    posed = posed_scan(scan, T, None, [START - 100 * MS, START])
    points, _ = project_level(posed, PLAIN)
    np.testing.assert_allclose(points[:, 0], [2.0, 1.9], atol=1e-12)


pose6 = st.tuples(*[st.floats(-2, 2)] * 3, *[st.floats(-1.5, 1.5)] * 3)


@given(st.lists(pose6, min_size=1, max_size=4), st.integers(0, 2**31))
@settings(deadline=None, max_examples=50)
def test_projection_agrees_with_a_twin(poses, seed):
    """Each beam with the pose interpolated at its own time, one by one."""
    random = np.random.default_rng(seed)
    stamps_ns = START + np.sort(random.choice(100 * MS, len(poses), replace=False)).astype(np.int64)
    if len(stamps_ns) > 1:
        stamps_ns = START + (stamps_ns - stamps_ns[0])
    n = int(random.integers(1, 30))
    span = (stamps_ns[-1] - stamps_ns[0]) * 1e-9
    scan = scan_at(
        int(stamps_ns[0]),
        ranges=random.uniform(0.5, 5.0, n),
        angle_min=-1.0,
        angle_increment=2.0 / n,
        time_increment=span / max(n - 1, 1),
    )
    T = np.array([pose_from_rpy(p) for p in poses])
    posed = posed_scan(scan, T, None, stamps_ns)
    got, _ = hits(posed, PLAIN)
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    for k, angle in enumerate(bearings(scan)):
        time = min(k * scan.time_increment, seconds[-1])
        j = min(int(np.searchsorted(seconds, time, "right")), len(seconds) - 1)
        i = max(j - 1, 0)
        f = (time - seconds[i]) / (seconds[j] - seconds[i]) if j > i else 0.0
        hit = scan.ranges[k].astype(float) * np.array([np.cos(angle), np.sin(angle), 0])
        expected = transform(interpolate_poses(T[i], T[j], f), hit[None])[0]
        # angle^2 / 8 of 5 m, and what a blend of chords moves it sideways
        np.testing.assert_allclose(got[k], expected, atol=5.0 * BLEND_ANGLE**2)


@given(pose6, pose6)
@settings(deadline=None)
def test_refined_poses_lie_on_the_great_circle(a, b):
    T = np.array([pose_from_rpy(a), pose_from_rpy(b)])
    times, fine = refine_poses(np.array([0.0, 2.0]), T)
    assert times[0] == 0.0
    assert times[-1] == 2.0
    expected = interpolate_poses(T[0], T[1], times / 2.0)[:, :3]
    np.testing.assert_allclose(fine, expected, atol=1e-7)
    chords = np.linalg.norm(np.diff(fine[:, :, :3], axis=0), axis=(1, 2)) / np.sqrt(2)
    assert (chords <= BLEND_ANGLE * 1.001).all()


def test_laser_poses_can_be_given_in_another_frame():
    scan = scan_at(START)
    T = pose_from_rpy((1, 2, 3, 0.1, 0.2, 0.3))
    times, poses = laser_poses(posed_scan(scan, T[None]), inverse(T))
    np.testing.assert_allclose(poses[0], np.eye(4)[:3], atol=1e-12)
    assert times.tolist() == [0.0]


# -- the robot itself --------------------------------------------------


@given(st.integers(0, 2**31), st.floats(0, 0.2))
@settings(deadline=None, max_examples=50)
def test_points_in_shapes_agree_with_a_twin(seed, padding):
    random = np.random.default_rng(seed)
    points = random.uniform(-1, 1, (200, 3))
    kinds = random.integers(0, 3, 4)
    half = random.uniform(0.1, 0.5, (4, 3))
    T = np.array([pose_from_rpy(random.uniform(-1, 1, 6)) for _ in range(4)])
    expected = np.zeros(200, bool)
    for kind, h, T_frame_shape in zip(kinds, half, T):
        p = transform(np.linalg.inv(T_frame_shape), points)
        box = (np.abs(p) <= h + padding).all(axis=1)
        ball = np.linalg.norm(p, axis=1) <= h[0] + padding
        ball &= np.abs(p[:, 2]) <= h[2] + padding
        tube = np.hypot(p[:, 0], p[:, 1]) <= h[0] + padding
        tube &= np.abs(p[:, 2]) <= h[2] + padding
        expected |= [box, ball, tube][kind]
    got = mark_inside(points, kinds, half, np.linalg.inv(T), padding)
    assert got.tolist() == expected.tolist()


def test_the_arm_is_not_part_of_the_scene():
    cylinder = (
        '<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision>'
    )
    text = robot(
        [
            joint("tilt", "revolute", "base", "laser"),
            joint("shoulder", "revolute", "base", "arm", axis="0 0 1"),
        ],
        {"arm": cylinder},
    )
    records = [description(text)]
    for k in range(20):
        angle = 0.1 * k
        records += [
            joints_at(START + 10 * k * MS, tilt=0.0, shoulder=angle),
            odometry_at(START + 10 * k * MS, (k, 0, 0, 0, 0, 0)),
        ]
    records.append(scan_at(START + 100 * MS, ranges=[0.45, 0.45, 0.7], angle_min=1.0,
                           angle_increment=-0.5))  # fmt: skip
    (posed,), _ = put_together(records)
    assert hits(posed, PLAIN)[1].tolist() == [1, 2]
    assert hits(replace(posed, own_shapes=None), PLAIN)[1].tolist() == [0, 1, 2]
    off = read_config(None, ["scan.self_filter=false", "scan.shadow_angle=0"])
    (posed,), _ = put_together(records, config=off)
    assert hits(posed, off)[1].tolist() == [0, 1, 2]


@given(st.integers(0, 2**31))
@settings(deadline=None, max_examples=60)
def test_the_self_filter_agrees_with_testing_every_hit(seed):
    """What is too far from all shapes is not placed: nothing else comes of it."""
    random = np.random.default_rng(seed)
    n, k = 200, int(random.integers(1, 4))
    scan = scan_at(
        START, ranges=random.uniform(0.05, 3.0, n), angle_min=-np.pi,
        angle_increment=2.0 * np.pi / n, time_increment=1e-4 if k > 1 else 0.0,
    )  # fmt: skip
    stamps_ns = np.linspace(START, scan.end_ns, k).astype(np.int64)
    T = np.array([[pose_from_rpy(random.uniform(-0.4, 0.4, 6)) for _ in range(k)] for _ in "ab"])
    count = int(random.integers(0, 5))
    shapes = SelfShapes(
        random.integers(0, 3, count),
        random.uniform(0.01, 0.5, (count, 3)),
        np.array([pose_from_rpy(random.uniform(-1.2, 1.2, 6)) for _ in range(count)]).reshape(
            -1, 4, 4
        ),
    )
    posed = replace(posed_scan(scan, T[0], T[1], stamps_ns), own_shapes=shapes)
    points, beams = project(posed, valid_beams(scan, PLAIN))
    T_shape_odom = inverse(posed.T_odom_base[0] @ shapes.T_base_shape)
    inside = mark_inside(points, shapes.kinds, shapes.half, T_shape_odom, PLAIN.scan.self_padding)
    expected = valid_beams(scan, PLAIN)
    expected[beams[inside]] = False
    assert used_beams(posed, PLAIN).tolist() == expected.tolist()


# -- recordings --------------------------------------------------


def cloud_of(name, topic, until_s=None):
    records = [r for t, r in read(name, until_s) if not isinstance(r, Scan) or t == topic]
    posed, kin = put_together(records, topic.lstrip("/"), Config())
    clouds = [hits(p, Config())[0] for p in posed]
    return np.concatenate(clouds), posed, kin


def height_and_spread(z, near, within):
    layer = z[np.abs(z - near) < within]
    return np.median(layer), np.std(layer), len(layer)


# The simulator's noise is 5 mm in range; the median of thousands of hits is good to 1 mm.
@pytest.mark.parametrize(
    ("name", "until_s", "joint_name", "base"),
    [
        ("sim2_other_names", None, "head_tilt", "footprint"),
        ("sim2_flat", 25, "tilt_joint", "base_link"),
    ],
)
def test_simulated_floors_and_tables_are_at_their_height(name, until_s, joint_name, base):
    points, _, kin = cloud_of(name, "/tilt_scan", until_s)
    assert (kin.tilt_joint, kin.base) == (joint_name, base)
    z = points[:, 2]
    floor, spread, count = height_and_spread(z, 0.0, 0.03)
    assert abs(floor) < 1e-3
    assert spread < 0.007
    assert count > 0.1 * len(z)
    assert (z < -0.03).mean() < 1e-3
    truth = json.loads(shared(f"bags/{name}/truth.json").read_text())
    height = truth["surfaces"][0]["height"]
    table, spread, count = height_and_spread(z, height, 0.02)
    assert count > 500
    assert abs(table - height) < 3e-3


def test_a_table_stands_where_the_truth_has_it():
    """The base moves in this recording, and the laser hangs upside down."""
    points, _, _ = cloud_of("sim2_other_names", "/tilt_scan")
    (surface,) = json.loads(shared("bags/sim2_other_names/truth.json").read_text())["surfaces"]
    boundary = np.array(surface["boundary"])
    on_top = points[np.abs(points[:, 2] - surface["height"]) < 0.015]
    on_top = on_top[np.hypot(on_top[:, 0], on_top[:, 1]) < 2.3]  # nearer than the walls
    u = boundary[1] - boundary[0]
    v = boundary[3] - boundary[0]
    a, b = ((on_top - boundary[0]) @ w / (w @ w) for w in (u, v))
    # odometry drifts by some centimetres; a mirrored or turned laser would miss it altogether
    inside = (a > -0.08) & (a < 1.08) & (b > -0.08) & (b < 1.08)
    assert inside.mean() > 0.95
    np.testing.assert_allclose([np.ptp(a[inside]), np.ptp(b[inside])], 1.0, atol=0.15)


def test_a_real_corridor_has_a_flat_floor_below_and_a_ceiling_above():
    points, _, _ = cloud_of("kurt3d_corridor", "/tilt_scan")
    near = points[np.linalg.norm(points[:, :2], axis=1) < 4.0]
    floor, spread, count = height_and_spread(near[:, 2], 0.0, 0.06)
    assert abs(floor) < 0.04
    assert spread < 0.03
    assert count > 0.2 * len(near)
    assert np.percentile(near[:, 2], 1) > -0.15
    assert near[:, 2].max() > 1.9


def test_real_level_walls_stay_straight():
    points, posed, _ = cloud_of("sim2_other_names", "/scan")
    assert len(posed) == 248
    np.testing.assert_allclose(points[:, 2], 0.2, atol=1e-3)


def test_recorded_topics_may_arrive_with_different_delays():
    """The same bytes come out when each topic is late by up to 0.15 s of its own."""
    records = [(t, r) for t, r in read("sim2_other_names") if t != "/scan"][:3000]
    random = np.random.default_rng(4)
    outcomes = []
    for spread in (0, 150 * MS):
        latest, arriving = {}, []
        for topic, record in records:
            at = getattr(record, "stamp_ns", 0) + random.integers(0, spread + 1)
            latest[topic] = at = max(at, latest.get(topic, 0))
            arriving.append((at, len(arriving), record))
        order = [record for *_, record in sorted(arriving, key=lambda a: a[:2])]
        posed, _ = put_together(order, config=Config())
        outcomes.append([hits(p, Config())[0].tobytes() for p in posed])
    assert len(outcomes[0]) > 100
    assert outcomes[0] == outcomes[1]
