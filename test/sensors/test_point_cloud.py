"""Points of clouds have the pose of their own time; voxels keep one each."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import PointCloud
from tccm_ros.sensors.point_cloud import (
    PosedCloud,
    angle_between_rings,
    first_in_voxels,
    measure_cloud,
)

MS = 1_000_000


STILL = (np.eye(4),)


def posed_cloud(points, since_ns=None, stamps_ns=(0,), poses=STILL):
    cloud = PointCloud(0, "lidar", np.asarray(points, np.float32), since_ns)
    base = np.array(poses)
    eye = np.broadcast_to(np.eye(4), base.shape).copy()
    return PosedCloud(cloud, np.array(stamps_ns), base, eye, role="points")


def test_each_point_is_placed_where_the_sensor_was_at_its_time():
    poses = [pose_from_rpy([0.1 * k, 0, 1, 0, 0, 0.002 * k]) for k in range(11)]
    stamps = [k * 10 * MS for k in range(11)]
    rng = np.random.default_rng(1)
    points = rng.uniform(1.0, 3.0, (40, 3))
    since = rng.permutation(np.arange(40) * 2 * MS)
    placed = measure_cloud(posed_cloud(points, since, stamps, poses), Config())
    for point, stamp in zip(placed.points, placed.stamps_ns, strict=True):
        k = stamp / (10 * MS)
        T = pose_from_rpy([0.1 * k, 0, 1, 0, 0, 0.002 * k])
        p = points[np.flatnonzero(since == stamp)[0]].astype(np.float32)
        np.testing.assert_allclose(point, T[:3, :3] @ p + T[:3, 3], atol=1e-5)


def test_points_that_are_none_are_left_out():
    points = [[np.nan, 0, 0], [0, 0, 0], [1, 1, 1], [np.inf, 0, 0], [99, 0, 0]]
    assert measure_cloud(posed_cloud(points), Config()).points.tolist() == [[1, 1, 1]]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 300))
def test_one_point_stays_in_each_voxel(seed, n):
    points = np.random.default_rng(seed).uniform(-0.1, 0.1, (n, 3))
    _, first = np.unique(np.floor(points / 0.02), axis=0, return_index=True)
    assert first_in_voxels(points, 0.02).tolist() == sorted(first)


@pytest.mark.parametrize(("rings", "step"), [(16, 2.0), (64, 0.4)])
def test_rings_of_a_lidar_are_found_from_its_points(rings, step):
    elevations = np.radians((np.arange(rings) - rings / 2) * step)
    azimuths = np.radians(np.arange(0, 360, 1.0))
    rng = np.random.default_rng(0)
    ranges = rng.uniform(1, 5, (rings, 360))[..., None]
    e, a = np.meshgrid(elevations, azimuths, indexing="ij")
    xyz = ranges * np.dstack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    found = angle_between_rings(xyz.reshape(-1, 3).astype(np.float32), 0.05, 30.0)
    assert np.degrees(found) == pytest.approx(step, abs=0.11)
