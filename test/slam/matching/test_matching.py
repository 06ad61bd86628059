import itertools

import numpy as np
import plan
import pytest
from scipy.linalg import eigh

from tccm_ros.config import Config
from tccm_ros.geometry import transform2
from tccm_ros.slam.matching.alignment import Prior, _drop_noise, align
from tccm_ros.slam.matching.correlation import correlate, known_likelihood, support
from tccm_ros.slam.matching.level_scan import make_level_scan, thin_with_normals
from tccm_ros.slam.matching.likelihood_grid import make_likelihood_grid, with_unknown
from tccm_ros.slam.matching.line_map import make_line_map

ACROSS = 0.04  # m across a surface
ALIKE = 0.9  # cosine between normals of one surface
ALONG = 0.15  # m along a surface
CELL = 0.05  # m, edge of a cell
MIN_INFORMATION = (1.0 / 0.3**2, 1.0 / 0.3**2)  # 1/m2, 1/rad2, added to that of noise
MIN_INFORMATION_RATIO = 3.0  # of information to that of noise in the normals
SPACING = 0.05  # m between points of the map with one orientation
UNKNOWN = 64  # of 255: a quarter, the likelihood of an unobserved cell

ROOM = np.concatenate([plan.box(-2, -2, 3, 2.5), plan.box(1.0, 1.5, 1.6, 2.5)])


def scan_at(pose, seed=0, sigma=0.005):
    run = plan.drive(ROOM, np.array([pose, pose]), seed=seed, sigma=sigma, mount=(0, 0, 0))
    return make_level_scan(run.scans[0], Config())


def room_map():
    """Scans from three places in one map, whose frame is the floor plan's."""
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.5, -0.5, -2.0]])
    scans = [scan_at(p, seed=k) for k, p in enumerate(poses)]
    lines = make_line_map(poses, scans)
    return lines, poses, scans


def brute_force(grid, points, centre, half, yaw_steps, step):
    """Score all poses of a window on the finest level, in plain numpy."""
    best, level = (-1.0, None), grid.levels[0]
    for a in range(-yaw_steps, yaw_steps + 1):
        yaw = centre[2] + a * step
        c, s = np.cos(yaw), np.sin(yaw)
        placed = points @ np.array([[c, s], [-s, c]]) + centre[:2] - grid.origin
        cells = np.floor(placed / CELL).astype(int)
        for dx, dy in itertools.product(range(-half, half + 1), repeat=2):
            x, y = cells[:, 0] + dx, cells[:, 1] + dy
            inside = (x >= 0) & (x < level.shape[0]) & (y >= 0) & (y < level.shape[1])
            values = np.full(len(points), float(grid.outside))
            values[inside] = level[x[inside], y[inside]]
            best = max(best, (values.mean() / 255.0, (a, dx, dy)))
    return best[0]


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.4, -0.3, 0.2), (2.0, 2.0, 1.0)])
@pytest.mark.parametrize("with_rays", [False, True])
def test_branch_and_bound_equals_exhaustive_search(centre, with_rays):
    lines, _, _ = room_map()
    rays = (np.zeros_like(lines.points), lines.points) if with_rays else None
    grid = make_likelihood_grid(lines.points, rays=rays)
    points = scan_at([0.2, 0.1, 0.1], seed=9).points[::4]
    centre = np.array(centre)
    found = correlate(grid, points, centre, (0.45, 0.2), angle_step=0.05)
    truth = brute_force(grid, points, centre, 9, 4, 0.05)
    assert found.score == pytest.approx(truth, abs=1e-12)


def test_a_pose_that_is_excluded_is_not_found():
    lines, _, _ = room_map()
    grid = make_likelihood_grid(lines.points)
    points = scan_at([0.2, 0.1, 0.1], seed=9).points
    best = correlate(grid, points, np.zeros(3), (0.5, 0.3))
    other = correlate(grid, points, np.zeros(3), (0.5, 0.3), exclude=(best.pose, 0.3, 0.2))
    away = other.pose - best.pose
    assert np.hypot(away[0], away[1]) > 0.3 or abs(away[2]) > 0.2
    assert other.score < best.score


def test_a_search_finds_nothing_where_no_pose_exceeds_the_minimum_score():
    lines, _, _ = room_map()
    grid = make_likelihood_grid(lines.points)
    points = scan_at([0.0, 0.0, 0.0]).points
    assert correlate(grid, points + 30.0, np.zeros(3), (0.3, 0.1), min_score=0.2).score == -1.0
    assert correlate(grid, np.zeros((0, 2)), np.zeros(3), (0.3, 0.1)).score == -1.0


def test_support_counts_points_on_walls_and_in_free_space():
    lines, poses, scans = room_map()
    rays = (np.repeat(poses[:1, :2], len(lines.points), axis=0), lines.points)
    grid = make_likelihood_grid(lines.points, rays=rays)
    near, free = support(grid, scans[0].points, poses[0])
    assert near > 0.95
    assert free < 0.02
    middle = scans[0].points * 0.4
    near, free = support(grid, middle, poses[0])
    assert near < 0.2
    assert free > 0.6


@pytest.mark.parametrize("shift", [0.0, 1.5, 30.0])
def test_unknown_cells_may_be_given_the_likelihood_of_known_ones(shift):
    """Then a score tells by its sign alone whether what is known is better than that."""
    lines, poses, scans = room_map()
    rays = (np.repeat(poses[:1, :2], len(lines.points), axis=0), lines.points)
    grid = make_likelihood_grid(lines.points, rays=rays)
    points = np.add(scans[0].points, [shift, 0.0])
    cells = np.floor((points - grid.origin) / CELL).astype(int)
    inside = np.all((cells >= 0) & (cells < grid.levels.shape[1:]), axis=1)
    values = np.full(len(points), UNKNOWN)
    values[inside] = grid.levels[0][tuple(cells[inside].T)]
    known = values != UNKNOWN
    expected = values[known].mean() / 255.0 if known.any() else 0.0
    assert known_likelihood(grid, points, np.zeros(3)) == pytest.approx(expected)
    neutral = with_unknown(grid, 0.6)
    assert neutral.outside == 153
    filled = np.where(known, values, 153).mean() / 255.0
    found = correlate(neutral, points, np.zeros(3), (0.0, 0.0), angle_step=1.0)
    assert found.score == pytest.approx(filled)
    if known.any():
        assert np.sign(found.score - 0.6) == np.sign(expected - 0.6)
    for coarse, fine in zip(neutral.levels[1:], neutral.levels):
        assert np.all(coarse >= fine)


@pytest.mark.parametrize("truth", [(0.2, 0.1, 0.1), (-0.5, 0.3, -0.6), (1.0, -1.0, 2.0)])
def test_alignment_finds_the_pose(truth):
    lines, _, _ = room_map()
    scan = scan_at(truth, seed=5)
    start = np.add(truth, [0.08, -0.06, 0.04])
    result = align(lines, scan.points, scan.normals, start, 0.01)
    error = result.pose - truth
    # 150 beams at 5 mm, and a map of three such scans.
    assert np.hypot(error[0], error[1]) < 0.006
    assert abs(error[2]) < 0.004
    assert result.inliers > 0.9


def test_along_a_corridor_alignment_has_no_information_and_keeps_the_prior():
    walls = np.array([[[-40.0, 1.0], [40.0, 1.0]], [[-40.0, -1.0], [40.0, -1.0]]])
    run = plan.drive(walls, np.array([[0.0, 0, 0], [0, 0, 0]]), mount=(0, 0, 0))
    scan = make_level_scan(run.scans[0], Config())
    lines = make_line_map(np.zeros((1, 3)), [scan])
    prior = np.array([0.3, 0.02, 0.01])
    weight = np.diag([100.0, 100.0, 100.0])
    result = align(lines, scan.points, scan.normals, prior, 0.02, Prior(prior, weight))
    assert result.pose[0] == pytest.approx(0.3, abs=0.08)
    assert abs(result.pose[1]) < 0.01
    values = np.linalg.eigvalsh(result.information[:2, :2])
    assert values[0] < 0.03 * values[1]


def test_normals_point_to_the_laser_and_corners_have_none():
    y = np.arange(-1.0, 1.0, 0.05)
    wall = np.stack([np.full(len(y), 2.0), y], axis=1)
    _, normals = thin_with_normals(wall, np.zeros(2), 0.01)
    assert np.allclose(normals, [-1.0, 0.0], atol=1e-9)
    legs = np.array([[1.0, 0.0], [1.5, 1.0], [0.5, 2.0]])
    assert np.all(thin_with_normals(legs, np.zeros(2), 0.01)[1] == 0.0)
    assert len(thin_with_normals(np.zeros((0, 2)), np.zeros(2), 0.01)[0]) == 0


def test_the_map_is_thinned_and_sorted_into_buckets():
    lines, _, _ = room_map()
    gaps = np.linalg.norm(lines.points[:, None] - lines.points[None], axis=2)
    alike = lines.normals @ lines.normals.T > 0.5
    np.fill_diagonal(alike, False)
    assert gaps[alike].min() >= SPACING
    assert lines.buckets.starts[..., 1].max() == len(lines.points)
    sizes = lines.buckets.starts[..., 1] - lines.buckets.starts[..., 0]
    assert sizes.sum() == len(lines.points)


def test_a_coarse_cell_holds_the_largest_of_the_cells_that_it_covers():
    """A score on a coarse level bounds the scores below it; at the far edges cells are held."""
    lines, _, _ = room_map()
    grid = make_likelihood_grid(lines.points, rays=(np.zeros_like(lines.points), lines.points))
    finest = grid.levels[0]
    for h, level in enumerate(grid.levels):
        size = 2**h
        held = np.pad(finest, (0, size - 1), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(held, (size, size))
        assert np.array_equal(level, windows.max(axis=(2, 3)))


def test_a_surface_is_confirmed_by_another_scan():
    """Against a brute force over all pairs of points of different scans."""
    _, poses, scans = room_map()
    placed = [transform2(pose, s.points) for pose, s in zip(poses, scans)]
    turned = [transform2(np.array([0.0, 0.0, p[2]]), s.normals) for p, s in zip(poses, scans)]
    lines = make_line_map(poses, scans)
    p, n = np.concatenate(placed), np.concatenate(turned)
    scan = np.repeat(np.arange(len(scans)), [len(s.points) for s in scans])
    for point, normal, confirmed in zip(lines.points, lines.normals, lines.confirmed):
        own = scan[np.argmin(np.abs(p - point).sum(axis=1))]
        away = np.hypot(*(p - point).T)
        alike = n @ normal > ALIKE
        across = np.abs(np.sum(n * (point - p), axis=1))
        same = np.where(alike, (away < ALONG) & (across < ACROSS), away < ACROSS)
        assert confirmed == bool((same & (scan != own)).any())
    assert 0.1 < lines.confirmed.mean() < 1.0


def test_the_points_of_a_single_scan_are_not_confirmed():
    scan = scan_at([0.0, 0.0, 0.0])
    assert not make_line_map(np.zeros((1, 3)), [scan]).confirmed.any()


def test_samples_of_a_surface_at_a_grazing_angle_get_its_normal():
    """They move with the robot: as positions, they would say that it stands."""
    bearings = np.radians(np.arange(2.0, 60.0, 0.5))
    wall = np.stack([1.0 / np.tan(bearings), np.ones(len(bearings))], axis=1)
    beams = wall + np.random.default_rng(0).normal(size=wall.shape) * 0.005
    points, normals = thin_with_normals(beams, np.zeros(2), np.radians(0.5))
    assert points[:, 0].max() > 20.0
    assert np.all(normals[:, 1] < -0.98)


def test_small_object_is_a_position_and_an_occluded_edge_is_left_out():
    step = np.radians(0.5)
    bearings = np.arange(-60, 61) * step
    ranges = 4.0 / np.cos(bearings)
    ranges[30] = 2.0  # a pole before the wall
    ranges[80] = 3.0  # a point between a screen at 1.5 m and the wall: a mixed pixel
    ranges[81:] = 1.5
    beams = ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    points, normals = thin_with_normals(beams, np.zeros(2), step)
    away = np.hypot(*points.T)
    pole = np.abs(away - 2.0) < 1e-9
    assert pole.sum() == 1
    assert not normals[pole].any()
    assert not np.any(np.abs(away - 3.0) < 1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_motions_of_which_noise_knows_as_much_are_taken_out(seed):
    """Against the generalised eigenvectors of scipy; what is left is unchanged along the others."""
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(2, 3, 3))
    noise, H = A @ A.T, 3.0 * B @ np.diag([30.0, 1.0, 0.1]) @ B.T
    b = random.normal(size=3)
    total = noise + np.diag([MIN_INFORMATION[0]] * 2 + [MIN_INFORMATION[1]])
    values, vectors = eigh(H, total)
    known = values >= MIN_INFORMATION_RATIO
    left, force = H.copy(), b.copy()
    _drop_noise(left, noise, force)
    expected = vectors.T @ H @ vectors * np.outer(known, known)
    assert vectors.T @ left @ vectors == pytest.approx(expected, abs=1e-6)
    assert vectors.T @ force == pytest.approx(known * (vectors.T @ b), abs=1e-6)
