"""Points of clouds have the pose of their own time; level scans are what was nearest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import PointCloud
from tccm_ros.sensors.level_projection import BEAMS, BEARING_STEP, LevelProjector, nearest_ranges
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
def test_the_rings_of_a_lidar_are_told_from_its_points(rings, step):
    elevations = np.radians((np.arange(rings) - rings / 2) * step)
    azimuths = np.radians(np.arange(0, 360, 1.0))
    rng = np.random.default_rng(0)
    ranges = rng.uniform(1, 5, (rings, 360))[..., None]
    e, a = np.meshgrid(elevations, azimuths, indexing="ij")
    xyz = ranges * np.dstack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    found = angle_between_rings(xyz.reshape(-1, 3).astype(np.float32), 0.05, 30.0)
    assert np.degrees(found) == pytest.approx(step, abs=0.11)


# -- level scans


def beam_of(bearing):
    return round((bearing + np.pi) / BEARING_STEP) % BEAMS


def test_a_level_scan_has_the_nearest_of_the_band_inf_beside_and_nan_behind():
    wall = [[2.0, 0.0, z] for z in (0.2, 0.5, 1.0)] + [[3.0, 0.0, 0.5]]
    floor = [[0.0, 1.0, 0.0]] * 3
    ranges = nearest_ranges(np.array(wall + floor), 0.1, 1.8)
    assert ranges[beam_of(0.0)] == pytest.approx(2.0)
    assert ranges[beam_of(np.pi / 2)] == np.inf
    assert np.isnan(ranges[beam_of(np.pi)])
    assert np.isnan(nearest_ranges(np.array([[1.0, 0.0, 1.0]]), 0.1, 1.8)).all()  # one alone


def test_the_noise_of_many_points_does_not_pull_a_wall_nearer():
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.normal(3.0, 0.01, 400), np.zeros(400), np.full(400, 1.0)])
    assert nearest_ranges(points, 0.1, 1.8)[beam_of(0.0)] == pytest.approx(3.0, abs=0.002)


def test_level_scans_are_made_of_the_sensor_that_is_configured():
    config = Config()
    event = posed_cloud([[2.0, 0.0, 0.5], [2.0, 0.0, 0.6]])
    assert LevelProjector(config).project(event) is None
    config.sensors.level_from = "points"
    scan = LevelProjector(config).project(event)
    assert scan.frame_id == "base_link"
    assert scan.ranges[beam_of(0.0)] == pytest.approx(2.0)
    config.sensors.level_from = "depth"
    assert LevelProjector(config).project(event) is None
