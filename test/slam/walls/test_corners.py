"""Corners: where they are seen, and what they add to the graph."""

import gtsam
import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.slam.chain import yaw_offset_for
from tccm_ros.slam.factors.corners import CornerObservation, WallThroughCorner
from tccm_ros.slam.factors.keys import corner_key, keyframe_key, wall_key
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.slam.walls.association import WallTable, associate_walls
from tccm_ros.slam.walls.corners import Corner, corner_factors, find_corners, uses_corners
from tccm_ros.slam.walls.landmarks import wall_factors
from tccm_ros.slam.walls.lines import extract_lines

ROOM = plan.box(-2.0, -1.5, 3.0, 2.5)
POSES = np.array([[0.0, 0.0, 0.0], [0.5, 0.3, 0.4], [0.9, 0.2, -0.7], [1.4, 0.8, 1.9]])
TRUE_CORNERS = np.array([[-2.0, -1.5], [3.0, -1.5], [3.0, 2.5], [-2.0, 2.5]])


def lines_at(pose, sigma=0.005):
    bearings = np.linspace(-np.pi, np.pi, 721, endpoint=False)
    ranges = plan.cast(ROOM, pose, bearings)
    ranges = ranges + np.random.default_rng(0).normal(size=len(ranges)) * sigma
    beams = np.column_stack([np.cos(bearings), np.sin(bearings)]) * ranges[:, None]
    return extract_lines(beams, np.zeros(2), Config())


def in_map(pose, point):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s], [s, c]]) @ point + pose[:2]


def test_corners_are_seen_where_the_walls_meet():
    lines = [lines_at(pose) for pose in POSES]
    corners = find_corners(associate_walls(POSES, lines, Config()), lines, 3)
    assert len(corners) == 4
    nearest = []
    for corner in corners:
        seen = np.array([in_map(POSES[k], p) for k, p in zip(corner.keyframes, corner.points)])
        gaps = np.linalg.norm(TRUE_CORNERS - seen.mean(axis=0), axis=1)
        nearest.append(int(gaps.argmin()))
        # The last beam on a wall falls short of the corner, by 3 cm at 3.5 m if it is met squarely.
        assert np.linalg.norm(seen - TRUE_CORNERS[nearest[-1]], axis=1).mean() < 0.05
    assert sorted(nearest) == [0, 1, 2, 3]


def test_corners_few_keyframes_saw_are_left_out():
    lines = [lines_at(pose) for pose in POSES]
    table = associate_walls(POSES, lines, Config())
    assert find_corners(table, lines, len(POSES) + 1) == []


@pytest.mark.parametrize(("angle_rad", "meets"), [(0.05, False), (0.4, False), (0.6, True)])
def test_walls_that_are_nearly_parallel_have_no_corner(angle_rad, meets):
    """Their common point is badly determined: by 1 / sin(angle) of the error of a line."""
    along = np.linspace(-2.0, 0.0, 60)
    beyond = np.linspace(0.02, 2.0, 60)
    beams = np.concatenate(
        [
            np.column_stack([along, np.full(60, 2.0)]),
            np.column_stack([np.cos(angle_rad) * beyond, 2.0 + np.sin(angle_rad) * beyond]),
        ]
    )
    config = Config.model_validate({"lines": {"min_length": 0.5}})
    lines = extract_lines(beams, np.zeros(2), config, label=halves)
    assert len(lines) == 2
    table = associate_walls(np.zeros((3, 3)), [lines] * 3, config)
    assert bool(find_corners(table, [lines] * 3, 3)) is meets


def halves(points, config):
    """Label beams: the first half is one line, the second another."""
    return (np.arange(len(points)) >= len(points) // 2).astype(np.int64)


def two_keyframes(with_corner):
    """Return where a keyframe is that sees one wall well, the other not, and their corner.

    Its odometry is 0.5 m wrong along the wall that it sees, and says so.
    """
    truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    ahead, side = (0.0, 4.0), (np.pi / 2, 1.5)  # x = 4 and y = 1.5
    sharp, none = np.diag([0.002**2, 0.005**2]), np.diag([1.0, 100.0])
    keys = [keyframe_key(k, yaw_offset_for(np.array([0.0, np.pi / 2]))) for k in range(2)]
    wrong = truth[1] + [0.5, 0.0, 0.0]
    factors = [
        PriorPose(keys[0], truth[0], np.eye(3) * 1e-8),
        BetweenKeyframes(keys[0], keys[1], wrong, np.diag([1.0, 1.0, 0.1])),
        Planar(keys[1], wrong),
    ]
    for k, cov_ahead in ((0, sharp), (1, none)):
        x = truth[k, 0]
        rows = ((0, ahead[0], ahead[1] - x, cov_ahead), (1, *side, sharp))
        factors += [WallObservation(keys[k], wall_key(w), a, r, cov) for w, a, r, cov in rows]
    table = WallTable(
        *np.zeros((3, 0), np.int64), np.array([ahead[0], side[0]]), np.array([4.0, 1.5]),
        np.zeros((2, 2)), np.zeros(2), np.arange(2),
    )  # fmt: skip
    if with_corner:
        points = [np.array([4.0, 1.5]) - pose[:2] for pose in truth]
        factors += corner_factors([Corner(0, 1, [0, 1], points)], table, keys, Config())
    solution = PoseGraph(factors, {keys[0]: truth[0], keys[1]: wrong}).optimise()
    return solution.planar_poses([keys[1]])[0], truth[1]


def test_a_corner_locates_a_keyframe_along_the_wall_that_it_sees():
    without, truth = two_keyframes(with_corner=False)
    assert without[0] - truth[0] == pytest.approx(0.5, abs=0.01), "odometry alone"
    found, _ = two_keyframes(with_corner=True)
    # Odometry of 1 m against a corner of 3 cm leaves 0.5 m * (0.042 / 1)^2.
    assert np.abs(found - truth).max() < 0.005


def test_corners_locate_a_robot_between_walls_that_are_not_flat():
    """Lines that may be half a metre off say little: with corners alone 8 cm are left of 2 m."""
    config = Config()
    config.matching.enabled = config.loops.enabled = False
    config.walls.flatness = 0.5
    config.odometry.sigma_per_m = config.odometry.sigma_rad_per_m = 0.3
    route = plan.route([(-1, -0.5), (2, -0.5), (2, 1.5), (-1, 1.5), (-1, -0.5)])
    left = []
    for seed in range(4):
        run = plan.drive(ROOM, route, seed=seed, drift=0.02, scale=1.05, beams=361)
        slam = WallSlam(config)
        for scan in run.scans:
            slam.add_scan(scan)
        left.append(plan.errors(run.truth, slam.solve().poses)[0])
    # Without any corner it is 0.13 m, with corners seen 10 cm off more.
    assert np.mean(left) < 0.10


def test_a_wall_goes_through_the_corner_that_it_ends_in():
    """A wall whose line says little, half a metre off; its corner is seen to 3 cm."""
    key = keyframe_key(0, yaw_offset_for(np.array([0.0, np.pi / 2])))
    sharp, vague = np.diag([0.002**2, 0.005**2]), np.diag([0.002**2, 1.0])
    factors = [
        PriorPose(key, np.zeros(3), np.eye(3) * 1e-8),
        WallObservation(key, wall_key(0), 0.0, 4.5, vague),
        WallObservation(key, wall_key(1), np.pi / 2, 1.5, sharp),
    ]
    table = WallTable(
        *np.zeros((3, 0), np.int64), np.array([0.0, np.pi / 2]), np.array([4.5, 1.5]),
        np.zeros((2, 2)), np.zeros(2), np.arange(2),
    )  # fmt: skip
    seen = [np.array([4.0, 1.5])]
    corners = corner_factors([Corner(0, 1, [0], seen)], table, [key], Config())
    solution = PoseGraph([*factors, *corners], {key: np.zeros(3)}).optimise()
    # A line of 1 m against a corner of 3.2 cm: half a millimetre is left of the 0.5 m.
    assert -solution.plane(wall_key(0))[3] == pytest.approx(4.0, abs=0.002)


def test_walls_that_meet_are_where_their_endpoints_are():
    """As in M-space: what is known of either wall is known of the endpoint of both."""
    config = Config()
    config.walls.corners = "endpoint"
    lines = [lines_at(pose) for pose in POSES]
    table = associate_walls(POSES, lines, config)
    corners = find_corners(table, lines, 3)
    keys = [keyframe_key(k, yaw_offset_for(x.phi)) for k, x in enumerate(lines)]
    factors = [PriorPose(keys[0], POSES[0], np.eye(3) * 1e-8)]
    factors += [Planar(key, pose) for key, pose in zip(keys[1:], POSES[1:])]
    factors += wall_factors(table, lines, keys, config)
    factors += corner_factors(corners, table, keys, config)
    solution = PoseGraph(factors, dict(zip(keys, POSES))).optimise()
    for corner in corners:
        point = solution.pose(corner_key(corner.a, corner.b))[:3, 3]
        for w in (corner.a, corner.b):
            plane = solution.plane(wall_key(w))
            assert plane[:3] @ point + plane[3] == pytest.approx(0.0, abs=1e-4)


def test_a_wall_has_one_endpoint_at_each_end():
    """Of two corners at one end the inner one is left to the other wall."""
    config, half_pi = Config(), np.pi / 2
    config.walls.corners = "endpoint"
    # y = 1 from x = -2 to 2; x = 1.5 and x = 2 meet it.
    table = WallTable(
        *np.zeros((3, 0), np.int64), np.array([half_pi, 0.0, 0.0]), np.array([1.0, 1.5, 2.0]),
        np.array([[-2.0, 2.0], [0.0, 1.0], [0.0, 1.0]]), np.zeros(3), np.arange(3),
    )  # fmt: skip
    seen = [np.array([1.5, 1.0])], [np.array([2.0, 1.0])]
    corners = [Corner(0, 1, [0], seen[0]), Corner(0, 2, [0], seen[1])]
    factors = corner_factors(corners, table, [keyframe_key(0)], config)
    through = [f for f in factors if isinstance(f, WallThroughCorner)]
    # A wall's axis points along its tangent: that of y = 1 to -x.
    ends = {(f.wall.number, f.corner) for f in through}
    assert ends == {(0, corner_key(0, 2)), (1, corner_key(0, 1)), (2, corner_key(0, 2))}


@pytest.mark.parametrize("yaw", [0.0, 0.9, -2.2])
def test_a_corner_is_known_equally_well_in_every_direction(yaw):
    """Twice the error of a corner that is d off is (d / sigma)^2."""
    sigma, distance = 0.03, 0.02
    key = keyframe_key(0, yaw_offset_for(np.array([0.0, np.pi / 2])))
    pose = np.array([0.4, -0.3, yaw])
    factor = CornerObservation(key, corner_key(0, 1), np.array([2.0, 0.7]), sigma)
    graph = gtsam.NonlinearFactorGraph()
    factor.add_to(graph)
    for bearing in np.linspace(0.0, np.pi, 7):
        step = distance * np.array([np.cos(bearing), np.sin(bearing)])
        values = gtsam.Values()
        values.insert(key.symbol, key.to_value(spatial(pose)))
        place = spatial(np.array([*in_map(pose, factor.point) + step, yaw]))
        values.insert(factor.corner.symbol, gtsam.Pose3(place))
        assert 2.0 * graph.error(values) == pytest.approx((distance / sigma) ** 2, rel=1e-3)


@pytest.mark.parametrize(
    ("corners", "matching", "walls", "expected"),
    [
        ("auto", True, True, False),
        ("auto", False, True, True),
        ("point", True, True, True),
        ("point", True, False, False),
        ("endpoint", True, True, True),
        ("none", False, True, False),
    ],
)
def test_corners_are_landmarks_where_matching_has_not_used_their_beams(
    corners, matching, walls, expected
):
    config = Config()
    config.walls.corners, config.walls.enabled = corners, walls
    config.matching.enabled = matching
    assert uses_corners(config) is expected


@pytest.mark.parametrize(("corners", "expected"), [("auto", False), ("point", True)])
def test_the_graph_has_corners_by_the_setting(corners, expected, monkeypatch):
    config, added = Config(), []
    config.walls.corners = corners
    add = PoseGraph.add
    monkeypatch.setattr(PoseGraph, "add", lambda g, f: (added.extend(f), add(g, f))[1])
    slam = WallSlam(config)
    for posed in plan.drive(ROOM, plan.route([(0, 0), (1.5, 0), (1.5, 1.5)]), beams=361).scans:
        slam.add_scan(posed)
    solution = slam.solve()
    assert any(isinstance(factor, CornerObservation) for factor in added) is expected
    assert any(wall.corners for wall in solution.walls)
