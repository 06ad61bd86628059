"""Center cores and the published detector."""

import numpy as np
import pytest
from plane_rig import part_map, room, scan, sheet, table

from tccm_ros.baselines.center_cores import center_cores, find_core_plane
from tccm_ros.config import Config

CONFIG = Config()


def test_center_core_is_the_long_axis_of_the_points():
    rng = np.random.default_rng(0)
    axis = np.array([0.1, -0.1, 1.0]) / np.linalg.norm([0.1, -0.1, 1.0])
    at = rng.uniform(-0.05, 0.05, 200)
    points = np.array([0.51, 0.31, 0.8]) + at[:, None] * axis
    cores = center_cores(part_map(points))
    assert len(cores) == 1
    assert cores.axis[0] @ axis == pytest.approx(1.0, abs=1e-5)
    assert cores.length[0] == pytest.approx(np.std(at), rel=1e-2)
    np.testing.assert_allclose(cores.center[0], points.mean(axis=0), atol=1e-4)
    low, high = cores.ends()[0]
    np.testing.assert_allclose(high - low, 4 * np.std(at) * axis, atol=1e-3)


def test_cuboids_of_few_points_have_no_core():
    cores = center_cores(part_map(np.array([[0.5, 0.5, 0.5], [0.505, 0.5, 0.5]])))
    assert len(cores) == 0
    assert find_core_plane(cores, CONFIG) is None


@pytest.mark.parametrize("trials", [10, 50])
def test_the_plane_of_a_table_without_noise_is_found(trials):
    points, _ = scan(table(), 0.0, 0)
    points = points[points[:, 0] > 0.52]
    plane = find_core_plane(center_cores(part_map(points)), CONFIG, trials, seed=1)
    assert plane is not None
    assert abs(plane.normal[2]) == pytest.approx(1.0, abs=1e-6)
    assert abs(plane.offset) == pytest.approx(0.7, abs=1e-4)
    assert plane.quality > 0.15


def test_quality_is_that_of_equation_8():
    rng = np.random.default_rng(2)
    points = sheet(rng, 20_000, (0.4, -0.4), (1.2, 0.4), (0.3, 0.1, 1.0), 0.8)
    cuboids = part_map(points)
    plane = find_core_plane(center_cores(cuboids), CONFIG, 50, seed=0)
    values = np.linalg.eigvalsh(np.cov(points.T))
    # All cores belong, and no noise: l3 is at its floor of 0.1 mm quantisation.
    assert len(plane.cores) > 0.99 * len(cuboids)
    assert plane.quality == pytest.approx(values[2] * values[1] / 1e-9, rel=0.15)


def test_the_same_seed_gives_the_same_plane():
    points, _ = scan(room() + table(), 0.0025, 0)
    cores = center_cores(part_map(points))
    a, b = (find_core_plane(cores, CONFIG, seed=3) for _ in range(2))
    assert a.normal.tobytes() == b.normal.tobytes()
    np.testing.assert_array_equal(a.cores, b.cores)
