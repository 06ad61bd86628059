"""Level scans: the nearest vertical surface of each bearing, against a brute-force twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import CameraInfo, DepthImage, PointCloud
from tccm_ros.sensors.depth_image import PosedImage
from tccm_ros.sensors.level_projection import LevelProjector, nearest_ranges
from tccm_ros.sensors.point_cloud import PosedCloud

BEAMS = 720  # of half a degree
BEARING_STEP = np.radians(0.5)  # of common level lasers
MAX_RANGE = 30.0  # m
MIN_EXTENT = 0.1  # m, height of a vertical surface: more than the edge of a table top
MIN_POINTS = 2  # of a range: a single one may be a flying pixel
MIN_RANGE = 0.05  # m
SLAB = 0.06  # m, width of a range bin
SLAB_PER_RANGE_SQUARED = 0.012  # 1/m, its growth: six times the noise of a depth camera
NEAR = np.sqrt(SLAB / SLAB_PER_RANGE_SQUARED)  # m, where both are equal

LOW, HIGH = 0.1, 1.8


def beam_of(bearing):
    return round((bearing + np.pi) / BEARING_STEP) % BEAMS


def slab_twin(r):
    if r < NEAR:
        return int(r / SLAB)
    return int(NEAR / SLAB + (1 / NEAR - 1 / r) / SLAB_PER_RANGE_SQUARED)


def ranges_twin(points):
    ranges = np.full(BEAMS, np.nan)
    beams = np.floor((np.arctan2(points[:, 1], points[:, 0]) + np.pi) / BEARING_STEP + 0.5) % BEAMS
    distances = np.hypot(points[:, 0], points[:, 1])
    for beam in np.unique(beams.astype(int)):
        mine = beams == beam
        inside = mine & (points[:, 2] >= LOW) & (points[:, 2] <= HIGH)
        inside &= (distances > MIN_RANGE) & (distances < MAX_RANGE)
        ranges[beam] = np.nan if inside.any() else np.inf
        slabs = np.array([slab_twin(r) for r in distances])
        for k in range(max(slabs) + 1):
            pair = inside & ((slabs == k) | (slabs == k + 1))
            heights = points[pair, 2].astype(np.float32)
            if pair.sum() >= MIN_POINTS and np.ptp(heights) >= MIN_EXTENT:
                ranges[beam] = distances[pair].mean()
                break
    return ranges


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.3, 3.0, 20.0]))
def test_the_ranges_are_those_of_the_twin(seed, size):
    rng = np.random.default_rng(seed)
    bearings = rng.choice([-np.pi, -1.0, 0.0, 2.0], 60)
    ranges = rng.uniform(0.0, size, 60)
    x, y = ranges * np.cos(bearings), ranges * np.sin(bearings)
    points = np.column_stack([x, y, rng.uniform(-0.2, 2.0, 60)])
    np.testing.assert_allclose(nearest_ranges(points, LOW, HIGH), ranges_twin(points), rtol=1e-9)


def test_level_scan_has_nearest_ranges_inf_if_free_and_nan_if_unseen():
    wall = [[2.0, 0.0, z] for z in (0.2, 0.5, 1.0)] + [[3.0, 0.0, 0.5]]
    floor = [[0.0, 1.0, 0.0]] * 3
    ranges = nearest_ranges(np.array(wall + floor), LOW, HIGH)
    assert ranges[beam_of(0.0)] == pytest.approx(2.0)
    assert ranges[beam_of(np.pi / 2)] == np.inf
    assert np.isnan(ranges[beam_of(np.pi)])
    assert np.isnan(nearest_ranges(np.array([[1.0, 0.0, 1.0]]), LOW, HIGH)).all()  # one alone


def test_the_noise_of_many_points_does_not_pull_a_wall_nearer():
    rng = np.random.default_rng(3)
    heights = np.linspace(0.5, 1.0, 400)
    points = np.column_stack([rng.normal(3.0, 0.01, 400), np.zeros(400), heights])
    assert nearest_ranges(points, LOW, HIGH)[beam_of(0.0)] == pytest.approx(3.0, abs=0.002)


def test_a_table_top_has_no_range_and_the_wall_behind_it_has():
    top = [[x, 0.0, 0.75] for x in np.arange(0.8, 1.6, 0.01)]
    wall = [[2.5, 0.0, z] for z in np.arange(0.8, 1.6, 0.05)]
    assert np.isnan(nearest_ranges(np.array(top), LOW, HIGH)[beam_of(0.0)])
    assert nearest_ranges(np.array(top + wall), LOW, HIGH)[beam_of(0.0)] == pytest.approx(2.5)


def posed_cloud(points):
    eye = np.eye(4)[None].copy()
    cloud = PointCloud(0, "lidar", np.asarray(points, np.float32), None)
    return PosedCloud(cloud, np.array([0]), eye, eye, role="points")


def test_level_scans_are_made_of_the_sensor_that_is_configured():
    config = Config()
    event = posed_cloud([[2.0, 0.0, 0.5], [2.0, 0.0, 0.6], [2.0, 0.0, 0.7]])
    assert LevelProjector(config).project(event) is None
    config.sensors.level_from = "points"
    scan = LevelProjector(config).project(event)
    assert scan.frame_id == "base_link"
    assert scan.ranges[beam_of(0.0)] == pytest.approx(2.0)
    config.sensors.level_from = "depth"
    assert LevelProjector(config).project(event) is None


def kitchen_scan(pitch):
    """Return the level scan of a camera 1.2 m high before a worktop and a wall 2.4 m away."""
    width, height, focal = 160, 120, 130.0
    K = np.array([[focal, 0, 79.5], [0, focal, 59.5], [0, 0, 1.0]])
    camera = CameraInfo(0, "eye", width, height, "", np.zeros(0), K, np.eye(3, 4))
    optical = pose_from_rpy([0, 0, 0, -np.pi / 2, 0, -np.pi / 2])
    T = pose_from_rpy([0, 0, 1.2, 0, pitch, 0]) @ optical
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.stack([(u - 79.5) / focal, (v - 59.5) / focal, np.ones(u.shape)], axis=-1)
    way = rays @ T[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = np.where(way[..., 0] > 0, 2.4 / way[..., 0], np.inf)
        top = np.where(way[..., 2] < 0, -0.4 / way[..., 2], np.inf)
        on_top = top * way[..., 0] > 1.2  # the worktop, 0.8 m high, begins 1.2 m ahead
        front = np.where(way[..., 0] > 0, 1.2 / way[..., 0], np.inf)
        on_front = front * way[..., 2] < -0.4
    depth = np.minimum(wall, np.where(on_top, top, np.inf))
    depth = np.minimum(depth, np.where(on_front, front, np.inf))
    floor = np.where(way[..., 2] < 0, -1.2 / way[..., 2], np.inf)
    depth = np.minimum(depth, floor).astype(np.float32)
    config = Config()
    config.sensors.level_from = "depth"
    eye = np.eye(4)[None].copy()
    posed = PosedImage(
        DepthImage(0, "eye", depth, camera), np.array([0]), eye, T[None].copy(), role="depth"
    )
    return LevelProjector(config).project(posed).ranges


@pytest.mark.parametrize("pitch", np.radians([0, 10, 15, 20, 25, 30, 40]))
def test_level_scan_is_independent_of_head_tilt(pitch):
    """Whatever edge of the view cuts the worktop: ranges are of its front or of the wall."""
    ranges = kitchen_scan(pitch)
    bearings = -np.pi + np.arange(BEAMS) * BEARING_STEP
    ahead = ranges * np.cos(bearings)
    ahead = ahead[np.isfinite(ahead)]
    assert len(ahead) > 20
    assert (np.minimum(np.abs(ahead - 1.2), np.abs(ahead - 2.4)) < 0.05).all()
