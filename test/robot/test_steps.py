"""Outliers of joints and odometry, and positions that limits contradict."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import MS, START, joints_at, odometry_at

from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.odometry import OdometryFilter
from tccm_ros.robot.steps import StepGuard


def nod(k):
    return 0.6 * math.sin(k * 0.05)


def fed(samples):
    """Return a track of joint 'nod' that was given (ms, position), and what was left out."""
    joints, left_out = JointTracks(0), {}
    for ms, position in samples:
        for reason, count in joints.add(joints_at(START + ms * MS, nod=position)).items():
            left_out[reason] = left_out.get(reason, 0) + count
    return joints.of("nod"), left_out


def test_a_joint_that_nods_is_followed():
    track, left_out = fed([(10 * k, nod(k)) for k in range(500)])
    assert len(track) == 500
    assert left_out == {}


@pytest.mark.parametrize("after_ms", [0, 4])
def test_zeros_of_a_second_publisher_are_left_out(after_ms):
    """In place of a sample, or 4 ms later: those far from the position as it is."""
    samples, far = [], 0
    for k in range(500):
        is_zero = k % 10 == 9
        if after_ms or not is_zero:
            samples.append((10 * k, nod(k)))
        if is_zero:
            samples.append((10 * k + after_ms, 0.0))
            far += abs(nod(k)) > 0.1
    track, left_out = fed(samples)
    assert left_out["outliers of joint 'nod'"] >= far > 30
    true = np.array([nod((s - START) / (10 * MS)) for s in track.stamps_ns.tolist()])
    assert np.abs(track.values[:, 0] - true).max() < 0.1


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("after_ms", [0, 1, 4])
@pytest.mark.parametrize("value", [0.0, 0.4])
def test_a_value_that_a_second_publisher_repeats_as_often_is_left_out(times, after_ms, value):
    """As often as the driver and more often; a joint at rest, then one that nods."""
    samples = []
    for k in range(800):
        position = nod(max(k - 100, 0))
        samples.append((10 * k, position))
        samples += [(10 * k + after_ms + j, value) for j in range(times)]
    track, left_out = fed(samples)
    assert left_out["one value of joint 'nod' by a second publisher"] > 0.8 * 700 * times
    late = track.stamps_ns > START + 2000 * MS
    true = np.interp((track.stamps_ns - START) / MS, 10.0 * np.arange(800),
                     [nod(max(k - 100, 0)) for k in range(800)])  # fmt: skip
    assert np.abs(track.values[:, 0] - true)[late].max() < 0.01
    assert np.count_nonzero(late) > 500


@given(st.lists(st.integers(-3, 3), min_size=50, max_size=300), st.floats(0.0, 0.01))
def test_a_joint_with_a_coarse_encoder_has_no_second_publisher(ticks, tick):
    _, left_out = fed([(10 * k, tick * value) for k, value in enumerate(np.cumsum(ticks))])
    assert not any("second publisher" in reason for reason in left_out)


def test_a_joint_that_starts_at_once_or_goes_on_elsewhere_is_followed():
    rest = [(100 * k, 0.0) for k in range(30)]
    moving = [(3000 + 100 * k, 0.1 * (k + 1)) for k in range(10)]
    elsewhere = [(4000 + 100 * k, -2.0) for k in range(5)]
    track, left_out = fed([*rest, *moving, *elsewhere])
    assert len(track) == 45
    assert left_out == {}


@given(st.lists(st.tuples(st.integers(1, 2000), st.floats(-1e9, 1e9)), max_size=60))
@settings(max_examples=100, deadline=None)
def test_every_sample_is_admitted_held_or_refused(steps):
    guard = StepGuard(lambda a, b: abs(b - a), 0.01)
    stamp, admitted, refused = START, [], 0
    for count, (step_ms, value) in enumerate(steps, 1):
        stamp += step_ms * MS
        found = guard.add(stamp, value)
        admitted += found.admitted
        refused += found.refused
        assert 0 <= count - len(admitted) - refused <= 102  # held, for 100 ms
    assert [s for s, _ in admitted] == sorted({s for s, _ in admitted})


def test_a_motion_whose_messages_are_stamped_together_is_kept():
    """A busy computer stamps those of each half second within microseconds: 0.15 m in 1 us."""
    guard = StepGuard(lambda a, b: abs(b - a), 0.1, 10.0)
    sent = [(START + k // 5 * 500 * MS + k % 5 * 1000, 0.15 * k) for k in range(51)]
    found = [guard.add(*sample) for sample in sent]
    assert [item for steps in found for item in steps.admitted] == sent
    assert not any(steps.refused or steps.has_jumped for steps in found)


def test_positions_beyond_the_limits_are_left_out():
    joints = JointTracks(0)
    joints.set_limits({"nod": (-0.5, 1.0)})
    for k, position in enumerate([0.0, 0.01, 1.3, 1.4, 0.02, -0.7, 0.03]):
        joints.add(joints_at(START + 10 * k * MS, nod=position))
    assert joints.of("nod").values[:, 0].tolist() == [0.0, 0.01, 0.02, 0.03]
    assert joints.explain(joints.of("nod")) is None


@pytest.mark.parametrize("is_late", [False, True])
def test_joint_in_degrees_is_refused_and_reported(is_late):
    """Not even where it passes zero; the description may come later."""
    joints = JointTracks(0)
    if not is_late:
        joints.set_limits({"nod": (-2.0, 2.0)})
    for k in range(400):
        joints.add(joints_at(START + 10 * k * MS, nod=math.degrees(nod(k + 10))))
    if is_late:
        joints.set_limits({"nod": (-2.0, 2.0)})
    track = joints.of("nod")
    assert len(track) < 20
    assert "beyond its limits -2 to 2" in joints.explain(track)
    assert "degrees" in joints.explain(track)


def positions(records):
    odometry, found = OdometryFilter(), []
    for record in records:
        found += odometry.add(record)
    return odometry, np.array([r.T_odom_base[:3, 3] for r in found])


def drive(x=0.0, y=0.0, z=0.0, first=0, count=50):
    ks = range(first, first + count)
    return [odometry_at(START + 50 * k * MS, (x + 0.02 * k, y, z, 0, 0, 0)) for k in ks]


def test_odometry_near_its_origin_is_as_it_is():
    records = drive(z=0.76)
    odometry, found = OdometryFilter(), []
    for record in records:
        found += odometry.add(record)
    assert found == records
    np.testing.assert_array_equal(odometry.T_near_odom, np.eye(4))


@pytest.mark.parametrize("start", [(110_000.0, 0, 0), (500_000.5, 4_649_776.25, 123.0)])
def test_odometry_far_away_is_moved_near(start):
    odometry, found = positions(drive(*start))
    assert np.abs(found).max() <= 514.0
    np.testing.assert_allclose(found - found[0], [[0.02 * k, 0, 0] for k in range(50)], atol=1e-8)
    np.testing.assert_allclose(odometry.T_near_odom[:3, 3] + start, found[0], atol=1e-8)


def test_a_step_that_no_base_makes_is_left_out():
    records = drive()
    records.insert(20, odometry_at(START + 990 * MS, (1e7, 0, 0, 0, 0, 0)))
    odometry, found = positions(records)
    assert odometry.refused == 1
    assert odometry.jumps == 0
    np.testing.assert_allclose(found[:, 0], 0.02 * np.arange(50))


def test_odometry_that_begins_anew_goes_on_where_it_was():
    odometry, found = positions([*drive(x=3.0), *drive(x=-400.0, first=50)])
    assert odometry.jumps == 1
    expected = 3.0 + 0.02 * np.concatenate([np.arange(50), np.arange(49, 99)])
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-9)


def test_samples_that_jump_back_and_forth_on_the_way_are_left_out():
    """A motion goes on in its direction; of two samples that contradict each other one is used."""
    guard = StepGuard(lambda a, b: abs(a - b), slack=0.1, speed=2.0)
    used, refused = [], 0
    for us, x in ((0, 0.0), (100_000, 0.1), (100_001, 0.9), (100_002, 0.5), (1_100_000, 1.0)):
        steps = guard.add(1000 * us, x)
        used += [sample for _, sample in steps.admitted]
        refused += steps.refused
    assert used == [0.0, 0.1, 0.9, 1.0]
    assert refused == 1
