"""Samples in stamp order, interpolated as twins in numpy and scipy do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tccm_ros.geometry import interpolate_poses, pose, pose_from_rpy, quaternion
from tccm_ros.robot.tracks import PoseTrack, ScalarTrack, Track, merge_stamps, pose_to_numbers

angle = st.floats(-3.1, 3.1)
pose6 = st.tuples(*[st.floats(-5, 5)] * 3, *[angle] * 3)
stamps = st.lists(st.integers(-(10**9), 10**9), min_size=1, max_size=30)


@given(stamps)
def test_only_newer_samples_are_kept(order):
    track = ScalarTrack()
    newest, kept = -np.inf, []
    for i, stamp in enumerate(order):
        assert track.append(stamp, float(i)) == (stamp > newest)
        if stamp > newest:
            newest = stamp
            kept.append((stamp, float(i)))
    assert list(zip(track.stamps_ns.tolist(), track.values[:, 0].tolist())) == kept
    assert track.heard == len(order)


@given(stamps, st.integers(-(10**9), 10**9), st.integers(0, 10**9))
def test_widest_gap_is_that_of_a_brute_force_search(order, start, length):
    track = ScalarTrack()
    for stamp in sorted(order):
        track.append(stamp, 0.0)
    known, end = np.array(sorted(set(order))), start + length
    before, after = known[known <= start], known[known >= end]
    gap = track.widest_gap_ns(start, end)
    if not len(before) or not len(after):
        assert gap is None
        return
    inside = known[(known >= before[-1]) & (known <= after[0])]
    assert gap == np.diff(inside).max(initial=0)
    within = known[(known > start) & (known < end)]
    assert track.stamps_within(start, end).tolist() == within.tolist()


@settings(deadline=None)
@given(stamps, st.lists(st.floats(-3, 3), min_size=30, max_size=30), st.floats(0, 1))
def test_scalars_agree_with_numpy(order, values, fraction):
    track = ScalarTrack()
    for stamp, value in zip(sorted(order), values):
        track.append(stamp, value)
    at = np.array([round(min(order) + fraction * (max(order) - min(order)))])
    expected = np.interp(at, track.stamps_ns.astype(float), track.values[:, 0])
    np.testing.assert_allclose(track.at(at, wraps=False), expected, atol=1e-9)


@settings(deadline=None)
@given(st.floats(-10, 10), st.floats(-3.1, 3.1), st.integers(0, 100))
def test_a_wrapping_joint_goes_the_short_way(start, step, percent):
    track = ScalarTrack()
    track.append(0, start)
    track.append(100, (start + step + np.pi) % (2 * np.pi) - np.pi)
    got = track.at(np.array([percent]), wraps=True)[0]
    error = got - (start + step * percent / 100)
    assert abs(np.sin(error / 2)) < 1e-9


@given(pose6, pose6, st.integers(0, 1000))
@settings(deadline=None)
def test_poses_agree_with_scipy(a, b, at):
    T0, T1 = pose_from_rpy(a), pose_from_rpy(b)
    track = PoseTrack()
    track.append_pose(0, T0)
    track.append_pose(1000, T1)
    got = track.at(np.array([at]))[0]
    expected = interpolate_poses(T0, T1, at / 1000)
    angle = Rotation.from_matrix(T0[:3, :3].T @ T1[:3, :3]).magnitude()
    if angle < 3.14:  # at half a turn both ways round are as short
        np.testing.assert_allclose(got, expected, atol=1e-7)
    np.testing.assert_allclose(got[:3, :3] @ got[:3, :3].T, np.eye(3), atol=1e-12)


@given(pose6)
@settings(deadline=None)
def test_numbers_of_a_pose_round_trip(values):
    T = pose_from_rpy(values)
    numbers = pose_to_numbers(T)
    back = pose(Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3])
    np.testing.assert_allclose(back, T, atol=1e-12)
    assert abs(abs(numbers[3:] @ quaternion(T)) - 1.0) < 1e-12


@pytest.mark.parametrize("rpy", [(np.pi, 0, 0), (0, np.pi, 0), (0, 0, np.pi), (np.pi, 0, np.pi)])
def test_numbers_of_a_pose_that_is_rotated_by_pi_round_trip(rpy):
    T = pose_from_rpy((1, 2, 3, *rpy))
    numbers = pose_to_numbers(T)
    back = pose(Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3])
    np.testing.assert_allclose(back, T, atol=1e-12)


def test_history_is_bounded_and_keeps_the_newest():
    track = Track(1, max_samples=100)
    for stamp in range(1000):
        track.append(stamp, float(stamp))
        assert len(track) <= 100
        assert track.latest_ns == stamp
    assert 900 <= track.stamps_ns[0] <= 950
    assert track.values[track.stamps_ns == 990] == 990.0


def test_an_empty_track_has_no_latest_stamp_and_no_gap():
    track = PoseTrack()
    assert track.latest_ns is None
    assert track.widest_gap_ns(0, 0) is None


@settings(deadline=None)
@given(st.integers(-(10**9), 10**9), st.integers(1, 10**9), st.integers(10**6, 10**9), st.data())
def test_merged_stamps_are_dense_and_contain_the_samples(start, length, step, data):
    end = start + length
    inner = data.draw(st.lists(st.integers(start + 1, end - 1), max_size=5)) if length > 1 else []
    merged = merge_stamps(start, end, step, np.array(inner, np.int64))
    assert merged[0] == start
    assert merged[-1] == end
    gaps = np.diff(merged)
    assert (gaps > 0).all()
    assert (gaps <= step + 1).all()
    assert set(inner) <= set(merged.tolist())
