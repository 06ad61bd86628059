"""Footprints of objects over views: joined from all sides, less what was looked through."""

from dataclasses import replace

import numpy as np
import pytest
from object_boxes import objects_of
from shapely import Polygon

from tccm_ros.config import Config
from tccm_ros.geometry import inverse, spatial, transform
from tccm_ros.records import SensorKind, ViewIntervals
from tccm_ros.surfaces.objects.object_footprints import joined_footprint, without_noise
from tccm_ros.surfaces.objects.object_tracks import track_objects
from tccm_ros.surfaces.views.views import empty_view, with_intervals, with_objects
from tccm_ros.tabletop.footprints import convex_hull

CONFIG = Config()
EYE = np.array([0.0, 0.0, 1.0])
HEIGHT = 0.8


def rectangle(x_low, x_high, y_low, y_high):
    return np.array([[x_low, y_low], [x_high, y_low], [x_high, y_high], [x_low, y_high]])


def view_of(free=(), sensor=SensorKind.LASER):
    """Return a view from `EYE` that looked through columns (x, y) up to 1.5 m from a height."""
    rows = np.array([(x, y, low, 1.5) for x, y, low in free], np.float32).reshape(-1, 4)
    view = with_intervals(empty_view(1, 0, CONFIG), ViewIntervals(1, "base", rows))
    return replace(view, viewpoint=EYE, sensor=sensor)


def joined(older, newest, free=(), others=()):
    view = view_of([(x, y, 0.5) for x, y in free])
    return Polygon(joined_footprint([older], newest, others, HEIGHT, view, np.eye(4), 0.02))


def test_sides_that_two_views_measured_are_one_footprint():
    front, back = rectangle(2.0, 2.1, -0.1, 0.1), rectangle(2.2, 2.3, -0.1, 0.1)
    whole = Polygon(rectangle(2.0, 2.3, -0.1, 0.1))
    assert joined(back, front).equals(whole)
    assert joined(front, back).equals(whole), "in front, but no beam passed there"


def test_older_outlines_are_carved_where_seen_through_and_kept_behind():
    front = rectangle(2.0, 2.1, -0.1, 0.1)
    beside, behind = rectangle(2.0, 2.1, 0.1, 0.4), rectangle(2.1, 2.4, -0.1, 0.1)
    every = [(x, y) for x in np.arange(1.75, 2.7, 0.1) for y in np.arange(-0.45, 0.6, 0.1)]
    assert joined(beside, front).area == pytest.approx(0.05)
    assert joined(beside, front, every).area == pytest.approx(0.02, abs=1e-3)
    assert joined(behind, front, every).area == pytest.approx(0.08)


def test_two_objects_that_an_older_view_measured_as_one_are_parted():
    both, left, right = (rectangle(2.0, 2.1, *y) for y in ((-0.2, 0.2), (-0.2, -0.05), (0.05, 0.2)))
    inside = np.asarray(Polygon(right).buffer(0.01, join_style="mitre").exterior.coords)
    assert joined(both, left).area == pytest.approx(0.04)
    assert joined(both, left, others=[inside]).bounds[3] < 0.06


@pytest.mark.parametrize("sensor", [SensorKind.LASER, SensorKind.DEPTH_IMAGE])
def test_the_near_side_of_noisy_points_is_at_the_true_side(sensor):
    rng, distance = np.random.default_rng(0), 2.0
    beam = np.hypot(distance, EYE[2] - HEIGHT)
    a, b, c = CONFIG.sensors.depth_sigma
    sigma = 0.008 if sensor is SensorKind.LASER else a + b * (beam - c) ** 2
    before, after = [], []
    for _ in range(200):
        front = np.column_stack([rng.normal(distance, sigma, 30), rng.uniform(-0.1, 0.1, 30)])
        hull = convex_hull(np.concatenate([front, rectangle(2.05, 2.2, -0.1, 0.1)]))
        found = without_noise(hull, HEIGHT, view_of(sensor=sensor), np.eye(4), CONFIG)
        before.append(hull[:, 0].min() - distance)
        after.append(found[:, 0].min() - distance)
        assert Polygon(hull).buffer(1e-9).contains(Polygon(found))
    assert np.mean(before) < -1.8 * sigma
    assert abs(np.mean(after)) < 0.3 * sigma


def test_footprint_thinner_than_noise_or_of_unknown_sensor_is_kept():
    thin = rectangle(2.0, 2.004, -0.1, 0.1)
    found = Polygon(without_noise(thin, HEIGHT, view_of(), np.eye(4), CONFIG))
    assert found.bounds == pytest.approx((2.002, -0.1, 2.004, 0.1), abs=1e-4)
    oblique = rectangle(-0.2, 0.2, -0.001, 0.001) @ np.array([[0.6, 0.8], [-0.8, 0.6]]) + [2, 0]
    kept = Polygon(without_noise(oblique, HEIGHT, view_of(), np.eye(4), CONFIG))
    assert 0.4 * Polygon(oblique).area < kept.area < Polygon(oblique).area
    unknown = empty_view(1, 0, CONFIG)
    assert without_noise(thin, HEIGHT, unknown, np.eye(4), CONFIG) is thin


def top_after(second_top, free=()):
    """Return the top of an object of 0.9 m that the second view measured up to a height."""
    views = []
    for stamp, top, columns in ((1, 0.9, ()), (2, second_top, free)):
        row = (2.0, 0.0, 0.5 * (0.7 + top), 0.3, 0.3, top - 0.7, 0.0)
        rows = np.array(columns, np.float32).reshape(-1, 4)
        view = with_objects(empty_view(stamp, 0, CONFIG), objects_of(stamp, [row]))
        views.append(with_intervals(view, ViewIntervals(stamp, "base", rows)))
    (track,) = track_objects(views, np.stack([np.eye(4)] * 2), CONFIG).tracks
    return track.high


def test_unseen_top_stays_and_one_seen_through_does_not():
    above = [
        (x, y, 0.75, 1.5) for x in np.arange(1.85, 2.2, 0.1) for y in np.arange(-0.15, 0.2, 0.1)
    ]
    assert top_after(0.72) == pytest.approx(0.9)
    assert top_after(0.72, above) == pytest.approx(0.72)
    assert top_after(1.0, above) == pytest.approx(1.0)


def test_an_object_that_views_from_four_sides_measured_in_part_has_its_box():
    true, views, poses = Polygon(rectangle(1.9, 2.1, -0.15, 0.15)), [], []
    parts = [(1.9, 1.95, -0.15, 0.15), (1.9, 2.1, 0.1, 0.15), (2.05, 2.1, -0.15, 0.15)]
    for k, (x0, x1, y0, y1) in enumerate(parts):
        T = spatial(np.array([2.0, 0.0, 0.0]) + 2.0 * np.array([-1, 1, 1])[k] * np.eye(3)[k % 2])
        middle = transform(inverse(T), np.array([[(x0 + x1) / 2, (y0 + y1) / 2, HEIGHT]]))[0]
        row = (*middle, x1 - x0, y1 - y0, 0.1, 0.0)
        views.append(with_objects(empty_view(k, 0, CONFIG), objects_of(k, [row])))
        poses.append(T)
    (track,) = track_objects(views, np.stack(poses), CONFIG).tracks
    assert track.footprint.symmetric_difference(true).area < 1e-9
    assert not track.shape.is_round
