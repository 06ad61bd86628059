import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.geometry import between2, compose2, inverse2, transform2
from tccm_ros.slam import se2

number = st.floats(-50.0, 50.0)
poses = st.tuples(number, number, number).map(lambda p: np.array(p))


def is_same(a, b):
    dyaw = a[2] - b[2]
    close = np.allclose(a[:2], b[:2], atol=1e-9)
    return close and abs(np.arctan2(np.sin(dyaw), np.cos(dyaw))) < 1e-9


@given(poses, poses)
def test_compiled_pose_operations_equal_those_of_geometry(a, b):
    assert is_same(se2.compose_se2(a, b), compose2(a, b))
    assert is_same(se2.between_se2(a, b), between2(a, b))
    assert is_same(se2.inverse_se2(a), inverse2(a))


@given(poses)
def test_transform_points_equals_that_of_geometry(a):
    points = np.random.default_rng(0).normal(size=(7, 2))
    assert np.allclose(se2.transform_points(a, points), transform2(a, points))


def test_each_scan_is_transformed_by_its_own_pose():
    random = np.random.default_rng(0)
    poses = random.normal(size=(4, 3))
    counts = np.array([3, 0, 5, 1])
    points, normals = random.normal(size=(2, 9, 2))
    placed, turned = se2.transform_scans(poses, counts, points, normals)
    at = 0
    for pose, count in zip(poses, counts):
        rows = slice(at, at + count)
        heading = np.array([0.0, 0.0, pose[2]])
        assert placed[rows] == pytest.approx(transform2(pose, points[rows]))
        assert turned[rows] == pytest.approx(transform2(heading, normals[rows]))
        at += count


def test_fuse_adds_information_in_the_rotated_frame():
    cov = np.diag([0.04, 0.01, 0.001])
    information = np.diag([100.0, 0.0, 0.0])
    fused = se2.fuse(information, np.pi / 2, cov)
    # Turned by 90 deg, the map's x is minus the frame's y.
    assert np.allclose(fused, np.diag([0.04, 1.0 / (100.0 + 100.0), 0.001]))
