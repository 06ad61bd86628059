"""Rigid transforms: group laws, round trips, and interpolation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.geometry import (
    between2,
    compose2,
    interpolate_poses,
    inverse,
    inverse2,
    level,
    planar,
    pose,
    pose_from_quaternion,
    pose_from_rpy,
    quaternion,
    spatial,
    transform,
    transform2,
    wrap_angle,
)

metre = st.floats(-100, 100)
angle = st.floats(-3.1, 3.1)
poses = st.tuples(metre, metre, metre, angle, angle, angle).map(pose_from_rpy)
poses2 = st.tuples(metre, metre, angle).map(np.array)
points = st.lists(st.tuples(metre, metre, metre), min_size=1, max_size=5).map(np.array)
CLOSE = {"atol": 1e-9, "rtol": 0}  # hundreds of metres in double precision


def assert_same2(a, b):
    np.testing.assert_allclose(a[..., :2], b[..., :2], **CLOSE)
    np.testing.assert_allclose(wrap_angle(a[..., 2] - b[..., 2]), 0.0, **CLOSE)


@settings(deadline=None, max_examples=50)
@given(st.floats(-50, 50))
def test_wrapped_angles_are_the_same_direction_in_half_open_range(value):
    wrapped = float(wrap_angle(value))
    assert -np.pi < wrapped <= np.pi
    assert abs(np.exp(1j * wrapped) - np.exp(1j * value)) < 1e-9


def test_minus_pi_wraps_to_plus_pi():
    assert wrap_angle(-np.pi) == np.pi
    assert wrap_angle(np.pi) == np.pi


@settings(deadline=None, max_examples=50)
@given(poses, points)
def test_inverse_takes_points_back(T, p):
    np.testing.assert_allclose(transform(inverse(T), transform(T, p)), p, **CLOSE)
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), **CLOSE)


@settings(deadline=None, max_examples=50)
@given(poses, poses, points)
def test_a_composed_pose_is_one_transform_after_the_other(A, B, p):
    np.testing.assert_allclose(transform(A @ B, p), transform(A, transform(B, p)), **CLOSE)


@settings(deadline=None, max_examples=50)
@given(poses)
def test_quaternions_round_trip(T):
    q = quaternion(T)
    assert q[3] >= 0
    np.testing.assert_allclose(pose_from_quaternion(T[:3, 3], q), T, **CLOSE)
    np.testing.assert_allclose(pose_from_quaternion(T[:3, 3], -3.0 * q), T, **CLOSE)


def test_a_zero_quaternion_is_refused():
    with pytest.raises(ValueError):
        pose_from_quaternion([0, 0, 0], [0, 0, 0, 0])


def test_roll_pitch_yaw_are_those_of_a_urdf():
    # x forward: pitch down, then turned left: the nose points left and down
    T = pose_from_rpy((0, 0, 0, 0, np.pi / 6, np.pi / 2))
    np.testing.assert_allclose(T[:3, 0], [0, np.cos(np.pi / 6), -0.5], atol=1e-12)
    T = pose_from_rpy((0, 0, 0, np.pi / 2, 0, 0))
    np.testing.assert_allclose(T[:3, 1], [0, 0, 1], atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(poses2, poses2, poses2)
def test_planar_poses_are_a_group(a, b, c):
    assert_same2(compose2(compose2(a, b), c), compose2(a, compose2(b, c)))
    assert_same2(compose2(a, inverse2(a)), np.zeros(3))
    assert_same2(compose2(a, between2(a, b)), b)


@settings(deadline=None, max_examples=50)
@given(poses2, poses2, points)
def test_planar_poses_are_the_spatial_ones_seen_from_above(a, b, p):
    assert_same2(planar(spatial(a)), a)
    assert_same2(planar(spatial(a) @ spatial(b)), compose2(a, b))
    np.testing.assert_allclose(transform2(a, p[:, :2]), transform(spatial(a), p)[:, :2], **CLOSE)


@settings(deadline=None, max_examples=50)
@given(poses)
def test_poses_without_roll_and_pitch_keep_translation_and_yaw(T):
    L = level(T)
    np.testing.assert_allclose(L[:3, 3], T[:3, 3])
    np.testing.assert_allclose(L[2, :3], [0, 0, 1])
    assert_same2(planar(L), planar(T))


@settings(deadline=None, max_examples=50)
@given(poses, poses)
def test_interpolation_keeps_its_ends_and_stays_rigid(A, B):
    np.testing.assert_allclose(interpolate_poses(A, B, 0.0), A, **CLOSE)
    np.testing.assert_allclose(interpolate_poses(A, B, 1.0), B, **CLOSE)
    M = interpolate_poses(A, B, 0.3)
    np.testing.assert_allclose(M[:3, :3] @ M[:3, :3].T, np.eye(3), **CLOSE)


@settings(deadline=None, max_examples=50)
@given(poses, poses, st.floats(0, 1), st.floats(0, 1))
def test_interpolating_in_steps_is_interpolating_once(A, B, f, g):
    M = interpolate_poses(A, B, f)
    np.testing.assert_allclose(
        interpolate_poses(A, M, g), interpolate_poses(A, B, f * g), atol=1e-6
    )


@settings(deadline=None, max_examples=50)
@given(poses, poses, poses, st.floats(0, 1))
def test_rotations_interpolate_the_same_in_any_frame(A, B, F, f):
    """The rotation does; the translation only where the frame keeps the origin."""
    F = pose(F[:3, :3], np.zeros(3))
    moved = interpolate_poses(F @ A, F @ B, f)
    np.testing.assert_allclose(moved, F @ interpolate_poses(A, B, f), atol=1e-6)


def test_pose_operations_broadcast_over_leading_dimensions():
    A, B = pose_from_rpy((0, 0, 0, 0, 0, 0)), pose_from_rpy((1, 0, 0, 0, 0, 1))
    many = interpolate_poses(A, B, np.linspace(0, 1, 5))
    assert many.shape == (5, 4, 4)
    np.testing.assert_allclose(planar(many)[:, 2], np.linspace(0, 1, 5))
    np.testing.assert_allclose(inverse(many) @ many, np.broadcast_to(np.eye(4), (5, 4, 4)), **CLOSE)
