"""The plane detector against least squares on the raw points, which it never sees."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_rig import EYE, cuboid_of, least_squares, part_map, room, scan, sheet, table

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, TICKS_PER_M, CuboidArrays
from tccm_ros.cuboids.moments import moments_about, plane_of, residuals_of, tangents
from tccm_ros.planes import find_planes

CONFIG = Config()


def moments_of(points):
    products = [(points[:, i] * points[:, j]).sum() for i in range(3) for j in range(i, 3)]
    return np.array([len(points), *points.sum(axis=0), *products])


def offset_of(fit, normal, point):
    """Distance of a fitted plane from a point of the true one, along the true normal."""
    return (fit.offset - fit.normal @ point) * np.sign(fit.normal @ normal)


def test_moments_of_all_cuboids_are_those_of_their_points():
    rng = np.random.default_rng(0)
    points = rng.uniform((-3, -3, 0), (3, 3, 2), (2000, 3))
    cuboids = part_map(points)
    origin = np.array([1000.0, -2000.0, 15000.0])
    M = moments_about(CuboidArrays(*cuboids.arrays), origin)
    exact = np.rint(points * TICKS_PER_M) - origin
    np.testing.assert_allclose(M.sum(axis=0), moments_of(exact * TICK), rtol=1e-11, atol=1e-8)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000), st.floats(1e-5, 0.02), st.floats(0.05, 2.0), st.floats(0.05, 2.0))
def test_plane_of_moments_is_the_plane_of_the_points(seed, thickness, length, width):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = rng.normal(size=(50, 3)) * (length, width, thickness) @ axes + rng.uniform(-2, 2, 3)
    nx, ny, nz, d, l1, l2, l3 = plane_of(moments_of(points))
    values, vectors = np.linalg.eigh(np.cov(points.T, bias=True))
    np.testing.assert_allclose([l3, l2, l1], values, rtol=1e-6, atol=1e-12)
    if values[0] < 0.3 * values[1]:
        assert abs(vectors[:, 0] @ (nx, ny, nz)) == pytest.approx(1.0, abs=1e-9)
        one, two = residuals_of(moments_of(points), nx, ny, nz, d)
        assert one == pytest.approx(0.0, abs=1e-9)
        assert two / len(points) == pytest.approx(values[0], rel=1e-5, abs=1e-13)


@pytest.mark.parametrize("tilt", [0, 20, 45, 60, 80])
@pytest.mark.parametrize("yaw", [0, 33])
def test_planes_of_any_tilt_are_as_exact_as_least_squares(tilt, yaw):
    t, y = np.deg2rad(tilt), np.deg2rad(yaw)
    normal = np.array([-np.sin(t) * np.cos(y), -np.sin(t) * np.sin(y), np.cos(t)])
    u, v = tangents(normal)
    rng = np.random.default_rng(tilt + yaw)
    centre = np.array([1.5, 0.2, 0.8])
    at = rng.uniform(-0.4, 0.4, (6000, 2))
    points = centre + at[:, :1] * u + at[:, 1:] * v + rng.normal(0, 0.0025, (6000, 1)) * normal
    fits = find_planes(part_map(points), CONFIG, EYE)
    assert len(fits) == 1
    fit = fits[0]
    true_normal, true_offset = least_squares(points)
    assert fit.support > 0.99 * len(points)
    # Sigma of the mean is 0.03 mm; cuboids cut and quantised differ from it by a fraction.
    assert abs(offset_of(fit, normal, centre)) < 1.5e-4
    assert (
        abs(offset_of(fit, normal, centre) - offset_at(true_normal, true_offset, normal, centre))
        < 5e-5
    )
    assert np.degrees(np.arccos(min(1.0, abs(fit.normal @ normal)))) < 0.05
    assert fit.rms == pytest.approx(0.0025, rel=0.05)
    assert fit.kind == ("horizontal" if tilt == 0 else "any")


def offset_at(n, d, normal, point):
    return (d - n @ point) * np.sign(n @ normal)


@pytest.mark.parametrize(("sigma", "limit"), [(0.0, 5e-5), (0.0025, 2.5e-4), (0.005, 5e-4)])
def test_edge_cells_do_not_bias_the_plane_of_a_table(sigma, limit):
    # The front face of the board is seen too, in the same cells as the edge.
    patches = room() + table()
    top = next(i for i, p in enumerate(patches) if p.name == "table.top")
    for seed in range(3):
        points, label = scan(patches, sigma, seed)
        fits = find_planes(part_map(points), CONFIG, EYE)
        middle = points[label == top].mean(axis=0)
        errors = [
            offset_of(f, (0, 0, 1), middle) - (0.7 - middle[2]) for f in fits if f.normal[2] > 0.99
        ]
        assert min(map(abs, errors)) < limit


def test_covariance_matches_the_errors_of_many_fits():
    rng = np.random.default_rng(5)
    squares = []
    normal = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    for _ in range(60):
        points = sheet(rng, 3000, (0.4, -0.5), (1.2, 0.5), normal, 0.7, 0.004)
        fit = find_planes(part_map(points), CONFIG, EYE)[0]
        u, v = fit.tangents
        error = np.array(
            [
                -(v @ normal),
                u @ normal,
                fit.offset - fit.normal @ fit.centroid + offset_error(fit, normal),
            ]
        )
        squares.append(error @ np.linalg.solve(fit.covariance, error))
    # Chi-square with 3 degrees of freedom: mean 3, standard deviation of 60 averages 0.32.
    assert 2.0 < np.mean(squares) < 4.0


def offset_error(fit, normal):
    return 0.7 - normal @ fit.centroid


@pytest.mark.parametrize("step", [0.05, 0.03])
def test_surfaces_at_a_few_centimetres_distance_stay_two_planes(step):
    rng = np.random.default_rng(1)
    below = sheet(rng, 9000, (0.5, -0.6), (1.3, 0.6), offset=0.85, sigma=0.002)
    is_above = (abs(below[:, 0] - 0.9) < 0.2) & (abs(below[:, 1] - 0.1) < 0.25)
    below[is_above, 2] += step
    fits = find_planes(part_map(below), CONFIG, EYE)
    assert len(fits) == 2
    heights = [f.offset / f.normal[2] for f in fits]
    assert heights[0] == pytest.approx(0.85, abs=3e-4)
    assert heights[1] == pytest.approx(0.85 + step, abs=6e-4)


def test_separate_tables_of_one_height_stay_two_planes():
    patches = room() + table(y=(-0.7, -0.05)) + table(y=(0.05, 0.7), name="other")
    points, _ = scan(patches, 0.002, 3)
    fits = find_planes(part_map(points), CONFIG, EYE)
    tables = [f for f in fits if f.kind == "horizontal" and abs(f.offset - 0.7) < 0.01]
    assert len(tables) == 2
    assert sorted(np.sign(f.centroid[1]) for f in tables) == [-1, 1]


def test_normals_of_floor_and_walls_point_to_the_laser():
    points, _ = scan(room(), 0.002, 4)
    fits = find_planes(part_map(points), CONFIG, EYE)
    wall = next(f for f in fits if f.kind == "any")
    np.testing.assert_allclose(wall.normal, (-1, 0, 0), atol=2e-3)
    assert wall.offset == pytest.approx(-2.6, abs=2e-3)
    floor = next(f for f in fits if f.kind == "horizontal")
    np.testing.assert_allclose(floor.normal, (0, 0, 1), atol=2e-3)


def test_labels_are_those_of_the_cuboids_on_each_plane():
    patches = room() + table()
    points, label = scan(patches, 0.0025, 2)
    cuboids = part_map(points)
    fits = find_planes(cuboids, CONFIG, EYE)
    top = next(i for i, p in enumerate(patches) if p.name == "table.top")
    at = fits.labels[cuboid_of(points[label == top], cuboids)]
    index = np.bincount(at[at >= 0]).argmax()
    assert (at == index).mean() > 0.98
    assert fits[index].kind == "horizontal"
    assert fits.labels.dtype == np.int32
    for fit in fits:
        assert cuboids.count[fit.members].sum() == fit.support


def test_the_same_map_gives_the_same_bytes():
    points, _ = scan(room() + table(yaw=0.3), 0.003, 7)
    first, second = (find_planes(part_map(points), CONFIG, EYE) for _ in range(2))
    assert first.labels.tobytes() == second.labels.tobytes()
    for a, b in zip(first, second, strict=True):
        assert (
            a.normal.tobytes() + a.boundary.tobytes() == b.normal.tobytes() + b.boundary.tobytes()
        )
        assert (a.offset, a.support, a.rms) == (b.offset, b.support, b.rms)


def test_an_empty_map_has_no_planes():
    one = part_map(np.array([[1.0, 0.0, 0.5]]))
    assert len(find_planes(one, CONFIG, EYE)) == 0
    none = one.select(np.array([False]))
    assert len(find_planes(none, CONFIG, EYE)) == 0
    few = part_map(np.random.default_rng(0).uniform(0, 1, (40, 3)))
    assert len(find_planes(few, CONFIG, EYE)) == 0
