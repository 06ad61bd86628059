"""Vertical planes: the rim's equation against plain sums over points, and what it is good for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_rig import EYE, least_squares, part_map

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, CuboidArrays
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.planes import find_planes
from tccm_ros.planes.arrays import plane_map
from tccm_ros.planes.vertical_patches import NO_RIM, bins_along, pool_patches
from tccm_ros.planes.vertical_planes import (
    add_patch,
    fit_vertical,
    rim_moments,
    solve,
    through_median,
)

CAP_DEPTH = 150  # ticks: 15 mm, the height noise of a horizontal surface to both sides
RIM_DEPTH = 40  # ticks: 4 mm, by which a horizontal surface varies from cell to cell

CONFIG = Config()
X, Y, Z = np.eye(3)


def moments_of(points):
    products = [(points[:, i] * points[:, j]).sum() for i in range(3) for j in range(i, 3)]
    return np.array([len(points), *points.sum(axis=0), *products])


def plane_at(yaw, tilt, distance, noise=1e-6):
    normal = np.array([np.cos(yaw) * np.cos(tilt), np.sin(yaw) * np.cos(tilt), np.sin(tilt)])
    return normal, (*normal.tolist(), distance, noise)


def board(rng, n, yaw=0.0, distance=0.61, sigma=0.0025, width=0.9, height=(0.1, 1.2), rows=40):
    """Return points on a vertical board in rows, with noise along its normal."""
    normal, _ = plane_at(yaw, 0.0, distance)
    along = rng.uniform(-width / 2, width / 2, n)
    z = rng.choice(np.linspace(*height, rows), n)
    e = rng.normal(0.0, sigma, n) if sigma else np.zeros(n)
    return (distance + e)[:, None] * normal + along[:, None] * np.cross(Z, normal) + z[:, None] * Z


def shelf_top(rng, n, yaw=0.0, distance=0.61, depth=0.3, sigma=0.001, width=0.9, z=1.2):
    """Return points on the horizontal top behind a board."""
    normal, _ = plane_at(yaw, 0.0, distance)
    along, behind = rng.uniform(-width / 2, width / 2, n), rng.uniform(0.0, depth, n)
    z = z + rng.normal(0.0, sigma, n) if sigma else np.full(n, z)
    points = (distance + behind)[:, None] * normal + along[:, None] * np.cross(Z, normal)
    return points + z[:, None] * Z


def moved(cuboids):
    """Return a map as the kernels read it, about the laser."""
    caps, origin = cuboids.caps, np.rint(EYE * TICKS_PER_M)
    return plane_map(CuboidArrays(*cuboids.arrays), caps.of, caps.moments, origin)


def built_map(points):
    """Return the cuboids of points with their caps, as a part map has them."""
    builder = PartMapBuilder(CONFIG)
    builder.add_points(points)
    return builder.close(0, 0, 1).cuboids()


@given(st.integers(0, 10_000), st.floats(-3.0, 3.0), st.floats(-0.2, 0.2), st.floats(-1.0, 1.0))
@settings(deadline=None, max_examples=40)
def test_rim_moments_are_sums_over_points(seed, yaw, tilt, z_rim):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (30, 3))
    normal, plane = plane_at(yaw, tilt, 0.4)
    ux, uy = -np.sin(yaw), np.cos(yaw)
    w = z_rim - points[:, 2]
    s, e = points @ (ux, uy, 0.0), points @ normal - 0.4
    expected = [w.sum(), w @ s, w @ points[:, 2], w @ e, w @ w]
    result = rim_moments(moments_of(points), plane, ux, uy, z_rim)
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9)


@given(st.integers(0, 10_000), st.floats(-3.0, 3.0), st.floats(-0.2, 0.2))
@settings(deadline=None, max_examples=40)
def test_the_normal_equations_are_those_of_least_squares(seed, yaw, tilt):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (60, 3))
    normal, plane = plane_at(yaw, tilt, 0.4)
    ux, uy = -np.sin(yaw), np.cos(yaw)
    N = np.zeros((3, 4))
    for part in np.array_split(points, 4):
        add_patch(N, moments_of(part), plane, ux, uy, 2.0)
    rows = np.column_stack([np.ones(60), points @ (ux, uy, 0.0), points[:, 2]])
    expected = np.linalg.lstsq(rows, points @ normal - 0.4, rcond=None)[0]
    np.testing.assert_allclose(solve(N), expected, rtol=1e-7, atol=1e-9)


def test_patches_hold_both_sides_of_the_border_between_cells():
    # The board stands at x = 0.600, the wall between two cells: noise puts half before it.
    rng = np.random.default_rng(0)
    cuboids = part_map(board(rng, 4000, distance=0.6))
    arrays = moved(cuboids)
    members = np.arange(len(cuboids), dtype=np.int32)
    pooled, rim = pool_patches(arrays, members, (1.0, 0.0, 0.0, 0.6, 6e-6))
    np.testing.assert_allclose(pooled.sum(axis=0), arrays.M.sum(axis=0), rtol=1e-9)
    large = pooled[:, 0] > 40
    off = abs(pooled[large, 1] / pooled[large, 0] - 0.6)
    # Half a Gaussian would be 0.8 sigma = 2 mm off.
    assert (off < 5 * 0.0025 / np.sqrt(pooled[large, 0])).all()
    assert (rim[rim != NO_RIM] > 11_900).all()


@pytest.mark.parametrize("seed", range(4))
def test_patches_without_their_rims_are_sums_over_points_below(seed):
    # A board in one row of cells: a step is a column, and a rim is its highest cuboid.
    rng = np.random.default_rng(seed)
    points = board(rng, 2000, distance=0.61, sigma=0.001, rows=400)
    cuboids = built_map(points)
    members = np.arange(len(cuboids), dtype=np.int32)
    pooled, rim = pool_patches(moved(cuboids), members, (1.0, 0.0, 0.0, 0.61, 1e-6))
    assert (rim == NO_RIM).all()
    heights = np.rint(points[:, 2] * TICKS_PER_M)
    column = np.floor(np.rint(points[:, 1] * TICKS_PER_M) / 200).astype(int)
    min_top = np.median([heights[column == c].max() for c in np.unique(column)]) - RIM_DEPTH
    count, total = 0, 0.0
    for c in np.unique(column):
        z = heights[column == c]
        below = (z < z.max() - CAP_DEPTH) | (z.max() < min_top)
        count, total = count + below.sum(), total + (z[below] * TICK - EYE[2]).sum()
    assert pooled[:, 0].sum() == count
    assert pooled[:, 3].sum() == pytest.approx(total, abs=1e-6)


@given(st.integers(0, 10_000), st.integers(1, 60))
@settings(deadline=None, max_examples=40)
def test_the_guess_goes_through_the_median_patch(seed, patches):
    rng = np.random.default_rng(seed)
    off, weight = rng.uniform(-0.02, 0.02, patches), rng.integers(1, 30, patches)
    pooled = np.stack(
        [w * moments_of(np.array([[0.6 + e, 0.1, 0.5]])) for e, w in zip(off, weight, strict=True)]
    )
    plane = through_median(pooled, (1.0, 0.0, 0.0, 0.6, 1e-6))
    # The median is between two patches where the weights halve there.
    ranked = np.sort(np.repeat(off, weight))
    middle = ranked[(len(ranked) - 1) // 2], ranked[len(ranked) // 2]
    assert middle[0] - 1e-9 <= plane[3] - 0.6 <= middle[1] + 1e-9


def test_steps_along_a_plane_do_not_depend_on_noise():
    rng = np.random.default_rng(1)
    cuboids = part_map(board(rng, 3000, yaw=0.35))
    members = np.arange(len(cuboids), dtype=np.int32)
    _, plane = plane_at(0.35, 0.0, 0.61)
    bins, count = bins_along(cuboids.ix, cuboids.iy, members, plane)
    along = cuboids.ix * -np.sin(0.35) + cuboids.iy * np.cos(0.35)
    np.testing.assert_array_equal(bins, np.floor(along - along.min() + 0.5))
    assert count == bins.max() + 1


@pytest.mark.parametrize("sigma", [0.0025, 0.005])
def test_with_caps_a_shelf_is_as_exact_as_a_fit_to_its_points(sigma):
    rng = np.random.default_rng(6)
    ours, fitted = [], []
    for _ in range(40):
        front, top = board(rng, 4000, 0.35, sigma=sigma), shelf_top(rng, 1500, 0.35)
        normal, _ = plane_at(0.35, 0.0, 0.61)
        middle = front.mean(axis=0)
        fits = find_planes(built_map(np.concatenate([front, top])), CONFIG, EYE)
        fit = max(fits, key=lambda f: abs(f.normal @ normal))
        for errors, (n, d) in ((ours, (fit.normal, fit.offset)), (fitted, least_squares(front))):
            errors.append(np.sign(n @ normal) * (d - n @ middle) - (0.61 - normal @ middle))
    # Means of 40 tests are within 4 of their own deviations; deviations within a fifth.
    assert abs(np.mean(ours)) < 4.0 * np.std(fitted) / np.sqrt(40)
    assert np.std(ours) < 1.2 * np.std(fitted)


def test_a_board_seen_by_one_line_is_no_plane():
    rng = np.random.default_rng(8)
    line = board(rng, 300, sigma=0.0025, height=(0.7, 0.7), rows=1)
    assert len(find_planes(built_map(line), CONFIG, EYE)) == 0


def test_a_board_that_steps_back_at_its_foot_is_not_refused():
    # 2,100 points of a front, and 500 that lie 10 mm behind it below: the guess is between them.
    rng = np.random.default_rng(7)
    front = board(rng, 2100, sigma=0.0035, height=(0.65, 1.19), rows=20)
    foot = board(rng, 500, distance=0.62, sigma=0.0035, height=(0.4, 0.6), rows=8)
    cuboids = built_map(np.concatenate([front, foot]))
    members = np.arange(len(cuboids), dtype=np.int32)
    total = np.zeros(10)
    plane = fit_vertical(moved(cuboids), members, (1.0, 0.0, 0.0, 0.615, 1e-5), total)
    assert plane[3] + plane[2] * (EYE[2] - 0.92) == pytest.approx(0.61, abs=5e-4)
    assert total[0] > 1500


@pytest.mark.parametrize("yaw", [0.0, 0.35])
@pytest.mark.parametrize("distance", [0.600, 0.613])
def test_without_caps_the_top_behind_a_board_does_not_bias_its_plane(yaw, distance):
    rng = np.random.default_rng(3)
    pulled, ours = [], []
    for _ in range(8):
        front, top = board(rng, 4000, yaw, distance), shelf_top(rng, 1500, yaw, distance)
        normal, _ = plane_at(yaw, 0.0, distance)
        fits = find_planes(part_map(np.concatenate([front, top])), CONFIG, EYE)
        fit = max(fits, key=lambda f: abs(f.normal @ normal))
        middle = front.mean(axis=0)
        sign = np.sign(fit.normal @ normal)
        ours.append(sign * (fit.offset - fit.normal @ middle) - (distance - normal @ middle))
        # What a fit gives that takes in a strip of the top, as the front's cells do.
        near = top[top @ normal - distance < 0.01]
        n, d = least_squares(np.concatenate([front, near]))
        sign = np.sign(n @ normal)
        pulled.append(sign * (d - n @ middle) - (distance - normal @ middle))
    # Least squares on the front has 0.04 mm; eight means of ours stay within three of theirs.
    assert abs(np.mean(ours)) < 1e-4
    assert np.std(ours) < 1e-4
    assert abs(np.mean(pulled)) > 2 * abs(np.mean(ours))


def test_without_noise_a_shelf_is_exact():
    rng = np.random.default_rng(4)
    points = np.concatenate([board(rng, 4000, sigma=0.0), shelf_top(rng, 1500, sigma=0.0)])
    fits = find_planes(part_map(points), CONFIG, EYE)
    front = max(fits, key=lambda f: abs(f.normal[0]))
    assert abs(abs(front.offset) - 0.61) < 5e-5
    assert abs(front.normal[2]) < 2e-4


def test_a_fit_without_rims_is_weighted_least_squares():
    rng = np.random.default_rng(5)
    points = board(rng, 5000)
    cuboids = part_map(points)
    members = np.arange(len(cuboids), dtype=np.int32)
    total = np.zeros(10)
    plane = fit_vertical(moved(cuboids), members, (1.0, 0.0, 0.0, 0.611, 1e-5), total)
    # One standard deviation of min_top squares is 0.035 mm.
    assert plane[3] + plane[2] * EYE[2] == pytest.approx(0.61, abs=1.5e-4)
    assert plane[4] == pytest.approx(0.0025**2, rel=0.15)
    assert 0.6 * len(points) < total[0] <= len(points)
