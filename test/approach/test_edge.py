"""The measured edge, on scan lines of a known top with known noise."""

import numpy as np
import pytest
from approach_world import circle, rectangle

from tccm_ros.approach.edge import measured_edge
from tccm_ros.approach.target import Target
from tccm_ros.geometry import transform2

ROUND = Target(np.asarray(circle(0.5).exterior.coords)[:-1], np.zeros(3), 0.7, is_round=True)
TABLE = Target(np.asarray(rectangle(1.4, 0.8).exterior.coords)[:-1], np.zeros(3), 0.7)


def scan_lines(is_on, pitch, rng, noise=0.003, yaw=0.0):
    """Return points on lines across the x axis of a frame turned by yaw, where a top is."""
    x = np.arange(-1.0, 1.0, pitch) + rng.uniform(0, pitch)
    y = np.arange(-1.0, 1.0, 0.008)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = transform2(np.array([0.0, 0.0, yaw]), points)
    return points[is_on(points)] + rng.normal(0, noise, (int(is_on(points).sum()), 2))


@pytest.mark.parametrize("pitch", [0.005, 0.01, 0.02, 0.03])
@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.0), (-0.04, 0.02, 0.05)])
def test_a_straight_edge_is_found_to_half_the_distance_of_scan_lines(pitch, motion):
    rng = np.random.default_rng(1)
    motion = np.array(motion)
    true = TABLE.moved(motion)
    points = np.concatenate([scan_lines(lambda p: contains(true, p), pitch, rng) for _ in range(3)])
    side = -1.0  # the edge at x = -0.7
    found = measured_edge(points, TABLE, np.array([-0.7, 0.0]), np.array([side, 0.0]))
    normal = transform2(np.array([0, 0, motion[2]]), np.array([[side, 0.0]]))[0]
    corner = transform2(motion, np.array([[-0.7, 0.0]]))[0]
    assert abs((found.point - corner) @ normal) < 0.5 * pitch + 0.003
    assert np.degrees(np.arccos(found.normal @ normal)) < 1.0


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.03, -0.04)])
def test_a_round_edge_is_faced_from_anywhere(shift):
    rng = np.random.default_rng(2)
    true = ROUND.moved(np.array([*shift, 0.0]))
    points = np.concatenate([scan_lines(lambda p: contains(true, p), 0.01, rng) for _ in range(3)])
    found = measured_edge(points, ROUND, np.array([-0.5, 0.0]), np.array([-1.0, 0.0]))
    assert np.allclose(found.middle, shift, atol=0.01)
    place = np.array([-1.0, 0.3])
    point, normal = found.facing(place)
    assert np.hypot(*(point - shift)) == pytest.approx(0.5, abs=0.01)
    towards = (place - shift) / np.hypot(*(place - shift))
    assert normal @ towards == pytest.approx(1.0, abs=1e-3)


def test_object_before_a_part_of_the_edge_does_not_move_it():
    rng = np.random.default_rng(3)
    points = scan_lines(lambda p: contains(TABLE, p), 0.01, rng)
    is_hidden = (points[:, 0] < -0.55) & (np.abs(points[:, 1]) < 0.08)
    found = measured_edge(points[~is_hidden], TABLE, np.array([-0.7, 0.0]), np.array([-1.0, 0.0]))
    assert found.point[0] == pytest.approx(-0.7, abs=0.008)


def test_too_little_is_no_edge():
    few = np.random.default_rng(4).uniform(-0.7, -0.6, (8, 2))
    assert measured_edge(few, TABLE, np.array([-0.7, 0.0]), np.array([-1.0, 0.0])) is None


def contains(target, points):
    import shapely

    return shapely.contains_xy(target.polygon, *points.T)
