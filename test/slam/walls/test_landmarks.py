"""What walls add to the graph: the flatness of a line, and the directions of a building."""

import numpy as np
import pytest

from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.factors.building import Building, WallDirection
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.landmarks import MIN_WALLS, structure_factors
from tccm_ros.slam.walls.line_noise import _flatness_covariance
from tccm_ros.slam.walls.lines import Lines


def line_of(ends):
    """Direction of the normal and distance of the line through two points (2, 2)."""
    direction = ends[1] - ends[0]
    phi = np.arctan2(-direction[0], direction[1])
    return np.array([phi, np.array([np.cos(phi), np.sin(phi)]) @ ends[0]])


@pytest.mark.parametrize("middle", [(2.0, 0.0), (1.5, 2.5), (-1.0, 0.7)])
@pytest.mark.parametrize("length", [0.4, 2.0])
def test_a_wall_that_is_not_flat_shifts_and_rotates_its_line(middle, length):
    """By one sigma, and by sqrt(12) sigma over the length; derivatives by moving the ends."""
    sigma = 0.005
    half = 0.5 * length * np.array([np.sin(0.4), -np.cos(0.4)])
    ends = np.array([middle - half, middle + half])
    phi, rho = line_of(ends)
    lines = Lines(np.array([phi]), np.array([rho]), np.zeros((1, 2, 2)), ends[None], np.array([20]))
    normal = np.array([np.cos(phi), np.sin(phi)])
    moves = []
    for both in ((1.0, 1.0), (-np.sqrt(3.0), np.sqrt(3.0))):
        step = 1e-6 * np.array(both)[:, None] * normal
        moves.append((line_of(ends + step) - line_of(ends - step)) / 2e-6)
    expected = sigma**2 * np.array(moves).T @ np.array(moves)
    assert _flatness_covariance(lines, 0, sigma**2) == pytest.approx(expected, rel=1e-5)


def table_of(phi, lengths):
    none = np.zeros(0, np.int64)
    extent = np.column_stack([np.zeros(len(phi)), lengths])
    return WallTable(none, none, none, np.array(phi), np.ones(len(phi)), extent, np.zeros(len(phi)))


@pytest.mark.parametrize("count", [MIN_WALLS, MIN_WALLS + 1, 9])
def test_walls_of_a_building_are_parallel_or_at_right_angles(count):
    yaw = 0.3
    rng = np.random.default_rng(count)
    quarters = rng.integers(-1, 3, count)
    phi = wrap_angle(yaw + quarters * np.pi / 2 + rng.normal(0.0, 0.005, count))
    odd = [wrap_angle(yaw + 0.6)]
    building, *directions = structure_factors(table_of([*phi, *odd], [2.0] * count + [0.5]))
    assert isinstance(building, Building)
    assert np.sin(2.0 * (building.yaw - yaw)) == pytest.approx(0.0, abs=0.02)
    assert len(directions) == count, "not the one that runs across"
    for factor, direction in zip(directions, phi):
        assert isinstance(factor, WallDirection)
        assert wrap_angle(building.yaw + factor.angle - direction) == pytest.approx(0.0, abs=0.02)
        assert np.sin(2.0 * factor.angle) == pytest.approx(0.0, abs=1e-9)


def test_few_walls_or_walls_in_all_directions_are_no_building():
    assert structure_factors(table_of([0.0, np.pi / 2], [2.0, 2.0])) == []
    assert structure_factors(table_of([0.0, 0.2, 0.5, 0.8, 1.1, 1.3], [2.0] * 6)) == []
