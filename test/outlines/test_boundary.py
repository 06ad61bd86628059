"""Outlines against the true shapes."""

import numpy as np
import pytest
from plane_rig import EYE, Patch, part_map, room, scan, sheet, table
from shapely import Polygon, box

from tccm_ros.config import Config
from tccm_ros.cuboids.moments import tangents
from tccm_ros.planes import find_planes

CONFIG = Config()


def overlap(fit, truth):
    """Intersection over union, seen from above."""
    shape = Polygon(fit.boundary[:, :2], [h[:, :2] for h in fit.holes])
    return shape.intersection(truth).area / shape.union(truth).area


def winding(ring, normal):
    u, v = tangents(normal)
    return Polygon(ring @ np.stack([u, v], axis=1)).exterior.is_ccw


def test_a_table_seen_in_one_cycle_has_its_true_outline():
    points, _ = scan(room() + table(), 0.0025, 0)
    fits = find_planes(part_map(points), CONFIG, EYE)
    top = max((f for f in fits if abs(f.offset - 0.7) < 0.01), key=lambda f: f.support)
    assert overlap(top, box(0.5, -0.6, 1.3, 0.6)) > 0.94
    assert top.area == pytest.approx(0.96, rel=0.05)
    assert np.abs(top.boundary @ top.normal - top.offset).max() < 1e-9
    assert winding(top.boundary, top.normal)


def test_a_far_sparse_surface_is_one_outline():
    # 1.8 m away the distance of scan lines is 12 cm, that of beams 2 cm.
    points, _ = scan([*room(4.0), *table((1.5, 2.3), (-0.7, 0.7), 0.75, 0.3)], 0.0025, 0)
    fits = find_planes(part_map(points), CONFIG, EYE)
    tops = [f for f in fits if abs(f.offset - 0.75) < 0.01]
    assert len(tops) == 1
    R = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    corners = np.array([[0, -0.7], [0.8, -0.7], [0.8, 0.7], [0, 0.7]]) @ R.T + (1.5, 0)
    assert overlap(tops[0], Polygon(corners)) > 0.8


def test_an_l_shaped_surface_keeps_its_shape():
    rng = np.random.default_rng(0)
    points = sheet(rng, 20_000, (0.4, -0.8), (1.6, 0.8), offset=0.9, sigma=0.002)
    points = points[(points[:, 0] < 0.9) | (points[:, 1] > 0.2)]
    fit = find_planes(part_map(points), CONFIG, EYE)[0]
    truth = box(0.4, -0.8, 1.6, 0.8).difference(box(0.9, -0.8, 1.6, 0.2))
    assert overlap(fit, truth) > 0.97
    assert fit.area == pytest.approx(truth.area, rel=0.02)


def test_a_hole_in_a_surface_stays_open():
    rng = np.random.default_rng(0)
    points = sheet(rng, 20_000, (0.4, -0.6), (1.4, 0.6), offset=0.8, sigma=0.002)
    points = points[np.hypot(points[:, 0] - 0.9, points[:, 1]) > 0.15]
    fit = find_planes(part_map(points), CONFIG, EYE)[0]
    assert len(fit.holes) == 1
    hole = Polygon(fit.holes[0][:, :2])
    assert hole.area == pytest.approx(np.pi * 0.15**2, rel=0.1)
    assert not winding(fit.holes[0], fit.normal)
    assert fit.area == pytest.approx(1.2 - np.pi * 0.15**2, rel=0.02)


def test_a_window_in_a_wall_is_a_hole():
    wall = Patch("wall", (1.5, -1.0, 0.0), (0, 2.0, 0), (0, 0, 2.0))
    fan = np.deg2rad(np.linspace(-50, 50, 400))
    nod = np.deg2rad(np.linspace(-40, 60, 300))
    b, t = np.meshgrid(fan, nod)
    rays = np.stack([np.cos(b) * np.cos(t), np.sin(b), -np.cos(b) * np.sin(t)], -1).reshape(-1, 3)
    points, _ = scan([wall], 0.003, 0, directions=rays)
    window = (abs(points[:, 1] - 0.3) < 0.25) & (abs(points[:, 2] - 1.1) < 0.3)
    fit = find_planes(part_map(points[~window]), CONFIG, EYE)[0]
    assert fit.kind == "any"
    assert fit.normal[0] < -0.99
    assert len(fit.holes) == 1
    assert fit.area == pytest.approx(4.0 - 0.3, rel=0.03)
    assert winding(fit.boundary, fit.normal)
    assert np.abs(fit.boundary @ fit.normal - fit.offset).max() < 1e-9
    assert np.ptp(fit.boundary[:, 2]) == pytest.approx(2.0, abs=0.04)


def test_a_slope_is_outlined_in_its_own_plane():
    rng = np.random.default_rng(0)
    normal = np.array([-np.sin(0.7), 0, np.cos(0.7)])
    points = sheet(rng, 20_000, (0.5, -0.5), (1.2, 0.5), normal, 0.1, 0.002)
    fit = find_planes(part_map(points), CONFIG, EYE)[0]
    assert fit.area == pytest.approx(0.7 / np.cos(0.7), rel=0.03)
