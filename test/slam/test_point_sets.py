import numpy as np
import pytest

from tccm_ros.geometry import transform2
from tccm_ros.slam.point_sets import extent_near_median, place_scans


def test_scans_are_placed_one_after_the_other():
    random = np.random.default_rng(0)
    poses = random.normal(size=(4, 3))
    counts = np.array([3, 0, 5, 1])
    points, normals = random.normal(size=(2, 9, 2))
    placed, turned = place_scans(poses, counts, points, normals)
    at = 0
    for pose, count in zip(poses, counts):
        rows = slice(at, at + count)
        heading = np.array([0.0, 0.0, pose[2]])
        assert placed[rows] == pytest.approx(transform2(pose, points[rows]))
        assert turned[rows] == pytest.approx(transform2(heading, normals[rows]))
        at += count


@pytest.mark.parametrize("half", [1.0, 3.0, 100.0])
def test_only_points_far_from_the_median_are_left_out(half):
    points = np.random.default_rng(1).normal(size=(200, 2))
    near, low, high = extent_near_median(points, half)
    away = np.abs(points - np.median(points, axis=0)).max(axis=1)
    assert np.array_equal(points[near], points[away < half])
    assert np.array_equal(low, points[near].min(axis=0))
    assert np.array_equal(high, points[near].max(axis=0))
