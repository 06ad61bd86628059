"""Sides of surfaces and the relative poses of views from them; the truth is the room itself."""

from dataclasses import replace

import numpy as np
import pytest
from room import Board, Room, Screen

from tccm_ros.config import Config
from tccm_ros.geometry import between2, planar, spatial, transform, transform2
from tccm_ros.slam.factors.keys import view_key
from tccm_ros.slam.solution import Solution
from tccm_ros.surfaces.merging.carving import carve
from tccm_ros.surfaces.registration.registration import Registration, side_factors, variance_factor
from tccm_ros.surfaces.registration.side_matching import match_sides
from tccm_ros.surfaces.registration.sides import Sides, find_sides
from tccm_ros.surfaces.surface_map import SurfaceMap

OPEN_SIGMA = 0.3  # m, rad: the prior, and so the sigma of what no side determines

CONFIG = Config()
TABLES = [Board(1.6, 0.1, 0.8, 1.2, 0.74, 0.2), Board(1.4, 1.5, 0.6, 0.6, 0.5, -0.1)]
POSES = np.array([[0.0, 0.0, 0.0], [0.3, -0.9, 0.45], [1.5, 3.6, -1.5]])


def views_of(room, poses, noise=0.004):
    surface_map = SurfaceMap(CONFIG)
    for k, pose in enumerate(poses):
        for record in room.look(pose, 10 * k + 10, rows=90, columns=240, noise=noise, seed=k):
            surface_map.add(record)
    return surface_map.views


def known(poses, sigma_xy=0.02, sigma_yaw=0.01):
    count = len(poses)
    cov = np.diag([1e-4, 1e-4, sigma_yaw**2, sigma_xy**2, sigma_xy**2, 1e-4])
    none = np.zeros(0, np.int64)
    return Solution(
        [], [], [], none, np.zeros((0, 3)), spatial(np.array(poses)), np.tile(cov, (count, 1, 1)),
        np.zeros(count, np.int64), np.zeros((0, 3, 3)),
    )  # fmt: skip


def distance_to_border(board, point):
    local = spatial(np.array([board.x, board.y, board.yaw]))
    x, y = transform(np.linalg.inv(local), [[*point, 0.0]])[0, :2]
    return min(abs(abs(x) - 0.5 * board.width), abs(abs(y) - 0.5 * board.depth))


def test_sides_lie_on_the_borders_of_boards():
    views = views_of(Room(TABLES), POSES)
    errors, sigmas = [], []
    for view, pose in zip(views, POSES):
        sides = find_sides(view, CONFIG.views.clear_margin)
        for middle, height, sigma in zip(sides.middle, sides.height, sides.sigma):
            board = min([*TABLES, Room([]).floor], key=lambda b: abs(b.z - height))
            assert abs(board.z - height) < 0.02
            errors.append(distance_to_border(board, transform2(pose, middle[None])[0]))
            sigmas.append(sigma)
    assert len(errors) >= 10
    assert np.mean(np.square(np.array(errors) / sigmas)) < 3.0


@pytest.mark.parametrize(
    ("screens", "faces"),
    [
        ([], {(1, 0), (-1, 0), (0, 1), (0, -1)}),
        ([Screen(0.8, -0.1, 0.8, 1.5, 1.9)], {(1, 0), (-1, 0), (0, -1)}),
    ],
)
def test_the_edge_of_an_occlusion_is_no_side(screens, faces):
    board = Board(1.8, 0.0, 0.8, 2.0, 0.74)
    (view,) = views_of(Room([board], screens), POSES[:1])
    sides = find_sides(view, CONFIG.views.clear_margin)
    assert {tuple(face) for face in np.rint(sides.outward).tolist()} == faces
    for middle, sigma in zip(sides.middle, sides.sigma):
        # Even errors between two scan lines are at most 1.7 standard deviations.
        assert distance_to_border(board, middle) < 2.0 * sigma


@pytest.mark.parametrize("missing", [0.03, 0.06, 0.09])
def test_an_end_before_pixels_that_are_missing_is_no_sharp_side(missing):
    """A camera gives no depth near the edges of a board: rays that passed show where it ends."""
    board = Board(1.8, 0.0, 0.8, 1.0, 0.74)
    surface_map = SurfaceMap(CONFIG)
    cloud, intervals = Room([board]).look(POSES[0], 10, rows=90, columns=240, noise=0.002)
    is_kept = np.abs(cloud.points[:, 1]) < 0.5 - missing
    is_kept |= cloud.points[:, 2] < 0.5
    surface_map.add(replace(cloud, points=cloud.points[is_kept], surface=cloud.surface[is_kept]))
    surface_map.add(intervals)
    (view,) = surface_map.views
    sides = find_sides(view, CONFIG.views.clear_margin)
    ends = np.abs(sides.outward[:, 1]) > 0.9
    assert ends.sum() == 2
    errors = [distance_to_border(board, middle) for middle in sides.middle[ends]]
    assert (np.array(errors) < 2.0 * sides.sigma[ends]).all()


def box_sides(pose, size=(1.2, 0.8), sigma=0.003, height=0.7, rng=None):
    """Return the four sides of a box at the map's origin, seen from `pose`."""
    outward = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    middle = 0.5 * outward * size
    if rng is not None:
        middle = middle + outward * rng.normal(0.0, sigma, (4, 1))
    back = between2(np.asarray(pose), np.zeros(3))
    rotated = transform2(np.array([0.0, 0.0, back[2]]), outward)
    length = np.array([size[1], size[0], size[1], size[0]])
    return Sides(
        np.arange(4), transform2(back, middle), rotated, length, np.full(4, height),
        np.full(4, sigma),
    )  # fmt: skip


START = np.diag([0.05, 0.05, 0.03]) ** 2


def in_own_frame(pose, error):
    R = np.eye(3)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R[:2, :2] = [[c, -s], [s, c]]
    return R.T @ error


def test_errors_of_matches_agree_with_their_covariances():
    first, second = np.array([-1.5, 0.2, 0.1]), np.array([-0.2, 1.9, -1.2])
    truth = between2(first, second)
    squares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        start = truth + rng.normal(0.0, np.sqrt(np.diag(START)))
        match = match_sides(
            box_sides(first, rng=rng), box_sides(second, rng=rng), start, START, 0.02
        )
        if match is None:
            continue  # a start further off than three deviations, now and then
        error = in_own_frame(truth, match.pose - truth)
        squares.append(error @ np.linalg.solve(match.cov, error))
    # Three degrees of freedom; yaws are as uncertain as distances allow.
    assert len(squares) >= 55
    assert 0.5 < np.mean(squares) < 4.5


def test_parallel_sides_do_not_determine_the_position_along_them():
    keep = np.array([True, False, True, False])
    pose = np.array([-1.5, 0.2, 0.0])
    sides = box_sides(pose).chosen(keep)
    match = match_sides(sides, sides, np.zeros(3), 0.1 * START, 0.02)
    assert match is not None
    assert np.sqrt(match.cov[0, 0]) < 0.01
    assert np.sqrt(match.cov[1, 1]) > 0.9 * OPEN_SIGMA


def test_a_match_of_equal_boards_in_a_row_is_refused_as_ambiguous():
    pose = np.array([-1.5, 0.0, 0.0])
    board, shift = box_sides(pose, (0.06, 0.8)), np.array([0.12, 0.0])
    parts = [board.moved(board.middle + k * shift, board.height) for k in range(5)]
    comb = Sides(*(np.concatenate([getattr(p, name) for p in parts]) for name in Sides.__slots__))
    loose = np.diag([0.1, 0.1, 0.03]) ** 2
    assert match_sides(comb, comb, np.array([0.06, 0.0, 0.0]), loose, 0.02) is None


@pytest.mark.parametrize("height", [0.7, 0.8])
def test_boards_at_other_heights_are_not_matched(height):
    pose = np.array([-1.5, 0.2, 0.1])
    match = match_sides(box_sides(pose), box_sides(pose, height=height), np.zeros(3), START, 0.02)
    assert (match is None) == (height > 0.75)


def test_matches_reduce_the_error_of_views_by_centimetres():
    """Fused with the prior by their covariances, matches reduce the error."""
    views = views_of(Room(TABLES), POSES)
    off = POSES + np.array([[0.0, 0.0, 0.0], [0.02, -0.03, 0.01], [-0.03, 0.02, -0.01]])
    factors = side_factors(views, carve(views, spatial(off), CONFIG), known(off), CONFIG)
    assert factors
    prior = 2.0 * np.diag([0.02, 0.02, 0.01]) ** 2
    befores, afters = [], []
    keys = [view_key(view.stamp_ns) for view in views]
    for factor in factors:
        i, j = (keys.index(key) for key in (factor.i, factor.j))
        truth = between2(POSES[i], POSES[j])
        measured = in_own_frame(truth, planar(factor.T_i_j) - truth)
        before = in_own_frame(truth, between2(off[i], off[j]) - truth)
        cov = factor.cov[np.ix_([3, 4, 2], [3, 4, 2])]
        assert measured @ np.linalg.solve(cov, measured) < 14.2  # 99.7 % of three degrees
        after = before + prior @ np.linalg.solve(prior + cov, measured - before)
        befores.append(np.hypot(*before[:2]))
        afters.append(np.hypot(*after[:2]))
    assert np.mean(afters) < 0.8 * np.mean(befores)


def test_a_table_that_was_moved_does_not_constrain_views():
    moved = Room([Board(1.9, 0.6, 0.8, 1.2, 0.74, 0.2)])
    first, second = views_of(Room(TABLES[:1]), POSES[:1]), views_of(moved, POSES[:1])
    views = [first[0], replace(second[0], stamp_ns=99)]
    poses = np.array([POSES[0], POSES[0]])
    factors = Registration(CONFIG).side_factors(views, known(poses))
    assert factors == []


def test_registration_of_the_same_views_gives_the_same_factors():
    views = views_of(Room(TABLES), POSES)
    a, b = (Registration(CONFIG).side_factors(views, known(POSES)) for _ in range(2))
    assert len(a) == len(b)
    for x, y in zip(a, b):
        np.testing.assert_array_equal(x.cov, y.cov)


@pytest.mark.parametrize("factor", [0.001, 0.1, 1.0])
def test_the_variance_factor_of_poses_is_found_from_matches(factor):
    rng = np.random.default_rng(8)
    count = 200
    matches = np.eye(3) * rng.uniform(0.01, 0.05, (count, 1, 1)) ** 2
    starts = np.tile(np.diag([0.1, 0.1, 0.1]) ** 2, (count, 1, 1))
    moved = [rng.multivariate_normal(np.zeros(3), m + factor * s) for m, s in zip(matches, starts)]
    found = variance_factor(np.array(moved), matches, starts)
    assert found == pytest.approx(factor, rel=0.5, abs=0.01)


def test_matches_of_exact_poses_do_not_move_them():
    """Sides that are off by their noise: the poses known so far are exact, and stay."""
    rng = np.random.default_rng(3)
    count = 30
    matches = np.tile(np.diag([0.03, 0.03, 0.02]) ** 2, (count, 1, 1))
    starts = np.tile(np.diag([0.06, 0.06, 0.04]) ** 2, (count, 1, 1))
    moved = rng.multivariate_normal(np.zeros(3), matches[0], count)
    assert variance_factor(moved, matches, starts) < 0.05
    # One match is too few to say so.
    assert variance_factor(moved[:1], matches[:1], starts[:1]) == 1.0


def test_planes_move_no_view_in_x_y_and_yaw():
    """Heights that are 3 mm off are shared out; what no plane tells stays bit for bit."""
    views, poses = views_of(Room(TABLES), POSES), np.array(POSES)
    T = spatial(poses)
    T[1, 2, 3] += 0.003
    solution = replace(known(poses), T_map_views=T)
    registration = Registration(CONFIG)
    registration.side_factors(views, solution)
    found = registration.with_adjusted_planes(solution)
    assert planar(found.T_map_views) == pytest.approx(poses, abs=1e-4)
    z = found.T_map_views[:, 2, 3]
    assert abs(z[1] - z[0]) < 0.0015
    assert (found.cov_views[:, 5, 5] < 1e-4).all()
