import numpy as np
import plan
import pytest

from tccm_ros.baselines.line_ransac import label_by_ransac
from tccm_ros.config import Config
from tccm_ros.slam.walls.line_fit import SEGMENT, fit_segment
from tccm_ros.slam.walls.lines import extract_lines, label_by_splitting

ORIGIN = np.zeros(2)


LABELLINGS = [label_by_splitting, label_by_ransac]


def config(**lines):
    made = Config()
    for name, value in lines.items():
        setattr(made.lines, name, value)
    return made


def scan(walls, pose, beams=361, sigma=0.005, seed=0, field=2 * np.pi):
    """Return the points of a scan in the laser's frame."""
    bearings = np.linspace(-field / 2, field / 2, beams, endpoint=False)
    ranges = plan.cast(walls, np.asarray(pose, float), bearings)
    ranges = ranges + np.random.default_rng(seed).normal(size=beams) * sigma
    seen = np.isfinite(ranges)
    rays = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    return rays[seen] * ranges[seen, None]


def lengths(lines):
    return np.hypot(*(lines.endpoints[:, 1] - lines.endpoints[:, 0]).T)


def numpy_fit(points):
    """Fit by singular value decomposition: the twin of the kernel's line."""
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre)[2][1]
    if normal @ centre < 0:
        normal = -normal
    return np.arctan2(normal[1], normal[0]), normal @ centre


@pytest.mark.parametrize("label", LABELLINGS)
def test_a_room_has_four_walls_where_they_are(label):
    beams = scan(plan.box(-2, -1.5, 3, 2.5), [0, 0, 0])
    lines = extract_lines(beams, ORIGIN, config(), label)
    assert len(lines) == 4
    truth = {0.0: 3.0, np.pi / 2: 2.5, np.pi: 2.0, -np.pi / 2: 1.5}
    for phi, rho in zip(lines.phi, lines.rho):
        near = min(truth, key=lambda a: abs(np.angle(np.exp(1j * (a - phi)))))
        assert abs(np.angle(np.exp(1j * (near - phi)))) < 0.01
        assert rho == pytest.approx(truth[near], abs=0.005)
    assert np.all(lengths(lines) > 3.5)
    assert lines.count.sum() > 0.95 * len(beams)


def test_the_fit_is_that_of_a_singular_value_decomposition():
    random = np.random.default_rng(3)
    for _ in range(20):
        t = random.uniform(-1, 2, size=30)
        points = np.stack([2.0 + 0.3 * t, t], axis=1) + random.normal(size=(30, 2)) * 0.01
        segment = np.zeros(1, SEGMENT)[0]
        fit_segment(points, ORIGIN, 0.01, segment)
        phi, rho = numpy_fit(points)
        assert segment["phi"] == pytest.approx(phi, abs=1e-9)
        assert segment["rho"] == pytest.approx(rho, abs=1e-9)


@pytest.mark.parametrize("offset", [-1.5, 1.5])
def test_covariance_with_its_correlation_passes_a_chi_square_test(offset):
    """Mean of (phi, rho) errors squared by the covariance is 2; a wrong sign gives far more."""
    random = np.random.default_rng(1)
    bearings = np.arctan2(offset + np.linspace(-0.5, 0.5, 25), 2.0)
    right, wrong = [], []
    for _ in range(800):
        ranges = 2.0 / np.cos(bearings) + random.normal(size=25) * 0.01
        points = np.stack([np.cos(bearings), np.sin(bearings)], axis=1) * ranges[:, None]
        segment = np.zeros(1, SEGMENT)[0]
        fit_segment(points, ORIGIN, 0.01, segment)
        error, cov = np.array([segment["phi"], segment["rho"] - 2.0]), segment["cov"]
        right.append(error @ np.linalg.solve(cov, error))
        wrong.append(error @ np.linalg.solve(cov * [[1, -1], [-1, 1]], error))
    # 800 samples of chi-square with 2 degrees: standard error of the mean 2 / sqrt(800) = 0.07;
    # the model is exact to first order only.
    assert np.mean(right) == pytest.approx(2.0, abs=0.3)
    assert np.mean(wrong) > 20.0


@pytest.mark.parametrize("label", LABELLINGS)
@pytest.mark.parametrize("beams", [40, 180, 4000])
def test_a_room_has_four_lines_at_any_angular_resolution(label, beams):
    lines = extract_lines(
        scan(plan.box(-2, -2, 2, 2), [0.3, 0.2, 0.4], beams), ORIGIN, config(), label
    )
    assert len(lines) == 4


@pytest.mark.parametrize("label", LABELLINGS)
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_too_few_points_are_no_line(label, count):
    points = np.stack([np.full(count, 2.0), np.linspace(-1, 1, count)], axis=1)
    assert len(extract_lines(points, ORIGIN, config(), label)) == 0


@pytest.mark.parametrize("label", LABELLINGS)
def test_one_wall_is_one_line_and_one_point_is_none(label):
    one = np.stack([np.full(50, 2.0), np.linspace(-1, 1, 50)], axis=1)
    lines = extract_lines(one, ORIGIN, config(), label)
    assert len(lines) == 1
    assert lines.count[0] == 50
    assert len(extract_lines(np.ones((50, 2)), ORIGIN, config(), label)) == 0


def test_a_wall_behind_the_robot_is_one_line_across_the_seam():
    beams = scan(np.array([[[-2.0, -1.5], [-2.0, 1.5]]]), [0, 0, 0], beams=720)
    lines = extract_lines(beams, ORIGIN, config())
    assert len(lines) == 1
    assert abs(lines.phi[0]) == pytest.approx(np.pi, abs=0.01)
    assert lengths(lines)[0] == pytest.approx(3.0, abs=0.05)


def test_phi_points_away_from_the_laser_even_past_the_base():
    """The laser at x = 1 sees a wall at x = 0.5 behind it: rho is negative seen from the base."""
    wall = np.stack([np.full(40, -0.5), np.linspace(-1, 1, 40)], axis=1)
    lines = extract_lines(wall, np.array([-1.0, 0.0]), config())
    assert lines.phi[0] == pytest.approx(0.0, abs=1e-9)
    assert lines.rho[0] == pytest.approx(-0.5)


@pytest.mark.parametrize("label", LABELLINGS)
def test_a_gap_ends_a_line(label):
    y = np.concatenate([np.linspace(-2, -0.6, 40), np.linspace(0.6, 2, 40)])
    lines = extract_lines(
        np.stack([np.full(80, 2.0), y], axis=1), ORIGIN, config(max_gap=0.5), label
    )
    assert len(lines) == 2


def test_a_line_shorter_than_the_minimum_length_is_dropped():
    short = np.stack([np.full(30, 1.0), np.linspace(-0.2, 0.2, 30)], axis=1)
    assert len(extract_lines(short, ORIGIN, config())) == 0
    assert len(extract_lines(short, ORIGIN, config(min_length=0.3))) == 1


def test_ransac_returns_the_same_lines_twice():
    beams = scan(plan.ring(), [0, 0, 0.3])
    one, two = (extract_lines(beams, ORIGIN, config(), label_by_ransac) for _ in range(2))
    assert np.array_equal(one.phi, two.phi)
    assert np.array_equal(one.endpoints, two.endpoints)
