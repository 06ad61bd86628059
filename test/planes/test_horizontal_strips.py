"""Horizontal strips: a ledge before a wall under few lines of a cycle, and vertical objects."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tccm_ros.planes.horizontal_strips import (
    RUN,
    find_runs,
    find_vertical_runs,
    horizontal_strips,
    link_runs,
)

GATE = 3.0  # sigmas: 99.7 % of all measurements
MAJORITY = 0.5  # of the whole
MAX_BEAMS = 3.5  # steps of beams between neighbours of a run: two lost beams
MAX_LINES = 2  # between linked runs: one line may be missing
MAX_OFFSET = 0.015  # m: points straight above each other are closer, linked runs are not
MAX_RISE = 0.0015  # m, from end to end of a run, beyond its noise
MIN_BEAMS = 6  # of a run, so that its slope is significant
MIN_LENGTH = 0.30  # m, of a strip: shorter ones are tops of objects
SPLIT_FRACTION = 0.7  # of the squared residuals of one line: two lines that leave less split a run
TOLERANCE = 0.006  # m, of a point from the mean height of its run: three sigmas at a grazing angle

EYE = np.array([0.0, 0.0, 1.39])
BEAM, STEP = math.radians(0.25), math.radians(0.45)
WALL = 2.5


def simulated_cycle(yaw, sigma, seed, boxes, wall=True):
    """Return points (N, 3) and lines (N,) of a tilt cycle over boxes (x, y, z spans) before a wall.

    The scene is rotated by `yaw` about the laser. Points of the wall are left out: they are known
    to be vertical.
    """
    rng = np.random.default_rng(seed)
    bearings = np.arange(-0.6, 0.6, BEAM)
    points, lines = [], []
    for line, tilt in enumerate(np.arange(-0.05, 0.35, STEP)):
        tilts = tilt + STEP * (bearings - bearings[0]) / (2.0 * math.pi)
        ray = np.stack(
            [np.cos(bearings) * np.cos(tilts), np.sin(bearings), -np.cos(bearings) * np.sin(tilts)]
        )
        x, y = (math.cos(yaw) * ray[0] + math.sin(yaw) * ray[1],
                math.cos(yaw) * ray[1] - math.sin(yaw) * ray[0])  # fmt: skip
        rotated = np.stack([x, y, ray[2]])
        far = WALL / x if wall else np.full(len(x), np.inf)
        for box in boxes:
            with np.errstate(divide="ignore"):
                ends = (np.array(box) - EYE[:, None])[:, :, None] / rotated[:, None, :]
            enter, leave = ends.min(axis=1).max(axis=0), ends.max(axis=1).min(axis=0)
            far = np.where((enter <= leave) & (enter > 0.0), np.minimum(far, enter), far)
        seen = np.isfinite(far)
        far = far + rng.normal(0.0, sigma, len(far))
        points.append(EYE + (ray * far).T[seen])
        lines.append(np.full(int(seen.sum()), line))
    points, lines = np.concatenate(points), np.concatenate(lines)
    before = np.abs(points[:, 0] * math.cos(yaw) + points[:, 1] * math.sin(yaw) - WALL) >= 0.02
    return points[before], lines[before]


def strips_of(points, lines, surface=None):
    nothing = np.full(len(points), -1, np.int64)
    return horizontal_strips(points, lines, nothing if surface is None else surface, EYE)


LEDGE = ((WALL - 0.2, WALL), (-0.5, 0.5), (1.0, 1.05))


@pytest.mark.parametrize(
    "heading",
    [
        90.0,
        pytest.param(
            175.0,
            marks=pytest.mark.xfail(
                strict=True,
                reason="lines are cut at 180 deg in odom; without the cut the sofa of the flat has "
                "0.43 m2 in its first view (0.23 m2; the seat has 1.26 m2), and no label",
            ),
        ),
    ],
)
def test_strips_do_not_depend_on_the_heading_in_odom(heading):
    points, lines = simulated_cycle(0.1, 0.0025, 1, [LEDGE])
    c, s = math.cos(math.radians(heading)), math.sin(math.radians(heading))
    turned = EYE + (points - EYE) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(strips_of(turned, lines), strips_of(points, lines))


@pytest.mark.parametrize("yaw", [0.0, 0.1, 0.3, -0.45])
@pytest.mark.parametrize("sigma", [0.0025, 0.006])
def test_a_ledge_under_few_lines_is_one_strip_at_its_height(yaw, sigma):
    points, lines = simulated_cycle(yaw, sigma, 1, [LEDGE])
    strip = strips_of(points, lines)
    on_top = np.abs(points[:, 2] - 1.05) < 1e-9 + 3.0 * sigma * 0.2
    chosen = strip >= 0
    assert set(strip[chosen].tolist()) == {0}
    assert len(np.unique(lines[chosen])) <= 6
    assert np.count_nonzero(chosen & on_top) > 0.7 * np.count_nonzero(on_top)
    # The mean of n heights, each sigma times the slope of the beam; a few of the front's rim.
    assert points[chosen, 2].mean() == pytest.approx(1.05, abs=0.002)


@pytest.mark.parametrize("known", [0.3, 0.6])
def test_a_run_that_lies_on_a_plane_in_part_lies_on_it_as_a_whole(known):
    points, lines = simulated_cycle(0.1, 0.0025, 1, [LEDGE])
    strip = strips_of(points, lines)
    along = points @ [-math.sin(0.1), math.cos(0.1), 0.0]
    surface = np.where((strip >= 0) & (along < known - 0.5), 7, -1)
    completed = strips_of(points, lines, surface)
    np.testing.assert_array_equal(completed[surface >= 0], 7)
    for line in np.unique(lines[surface >= 0]):
        its = (lines == line) & (strip >= 0)
        assert np.all(completed[its] == 7)


def test_a_line_without_points_above_or_below_it_is_a_strip_by_itself():
    points, lines = simulated_cycle(0.1, 0.0025, 1, [LEDGE])
    strip = strips_of(points, lines)
    longest = np.bincount(lines[strip >= 0]).argmax()
    alone = (lines == longest) & (strip >= 0)
    assert set(strips_of(points[alone], lines[alone]).tolist()) == {0}
    half = alone & (points @ [-math.sin(0.1), math.cos(0.1), 0.0] < -0.25)  # a quarter of a metre
    assert set(strips_of(points[half], lines[half]).tolist()) == {-1}


@pytest.mark.parametrize(
    ("bend", "count", "expected"), [(0.0, 40, 0), (0.12, 40, -1), (0.0, 8, -1)]
)
def test_a_single_line_is_a_strip_only_if_straight_and_long(bend, count, expected):
    y = np.linspace(-0.3, 0.3, count)
    points = np.column_stack([2.0 + bend * np.abs(y) / 0.3, y, np.full(count, 1.0)])
    assert set(strips_of(points, np.zeros(count, np.int64)).tolist()) == {expected}


def test_a_line_on_the_front_of_a_box_is_no_strip():
    front = ((1.5, 1.6), (-0.4, 0.4), (0.0, 1.2))
    points, lines = simulated_cycle(0.0, 0.0025, 1, [front], wall=False)
    points, lines = points[points[:, 0] < 1.52], lines[points[:, 0] < 1.52]
    assert len(points) > 500
    assert not (strips_of(points, lines) >= 0).any()


@pytest.mark.parametrize("seed", range(16))
def test_vertical_objects_before_a_wall_have_no_strips(seed):
    rng = np.random.default_rng(seed)
    boxes = []
    for _ in range(6):  # too high to see onto, and each of another depth
        x, y = rng.uniform(1.5, 2.4), rng.uniform(-0.8, 0.8)
        boxes.append(((x, x + 0.1), (y, y + rng.uniform(0.1, 0.5)), (0.0, 1.8)))
    yaw = rng.uniform(-0.4, 0.4)
    points, lines = simulated_cycle(yaw, 0.006, seed, boxes)
    strip = strips_of(points, lines)
    assert not (strip >= 0).any()


@pytest.mark.parametrize(("width", "expected"), [(0.15, {-1}), (0.5, {-1, 0})])
def test_narrow_objects_of_one_height_on_neighbouring_lines_are_no_strip(width, expected):
    # One line runs over each top at a distance of 0.22 m: wide objects would be one strip.
    y = (-0.5 * width, 0.5 * width)
    boxes = [((1.82, 1.87), y, (1.0, 1.25)), ((2.03, 2.09), y, (1.0, 1.25))]
    points, lines = simulated_cycle(0.0, 0.0025, 0, boxes, wall=False)
    strip = strips_of(points, lines)
    assert set(strip.tolist()) == expected
    if 0 in expected:
        assert np.ptp(points[strip == 0, 0]) > MAX_OFFSET
        assert len(np.unique(lines[strip == 0])) == 2


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=15)
def test_the_order_of_points_does_not_matter(seed):
    points, lines = simulated_cycle(0.2, 0.006, seed, [LEDGE])
    order = np.random.default_rng(seed).permutation(len(points))
    straight = strips_of(points, lines)
    np.testing.assert_array_equal(strips_of(points[order], lines[order]), straight[order])


@given(st.integers(0, 10_000), st.floats(0.0, 0.006), st.floats(-0.4, 0.4))
@settings(deadline=None, max_examples=20)
def test_runs_are_straight_horizontal_and_of_one_line(seed, sigma, yaw):
    points, lines = simulated_cycle(yaw, sigma, seed, [LEDGE])
    seen = points - EYE
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    order = np.lexsort((azimuth, lines))
    seen, azimuth, lines = seen[order], azimuth[order], lines[order].astype(np.int64)
    of_point, runs = find_runs(lines, seen, azimuth, BEAM)
    assert set(of_point.tolist()) <= set(range(-1, len(runs)))
    for k, run in enumerate(runs):
        own = np.flatnonzero(of_point == k)
        z, a = seen[own, 2], azimuth[own]
        assert len(own) == run["points"] >= MIN_BEAMS
        assert set(lines[own].tolist()) == {run["line"]}
        assert (run["first"], run["last"]) == (a[0], a[-1])
        assert run["height"] == pytest.approx(z.mean(), abs=1e-9)
        half = len(own) // 2
        np.testing.assert_allclose(run["begin"], seen[own[:half], :2].mean(axis=0), atol=1e-9)
        np.testing.assert_allclose(run["end"], seen[own[-half:], :2].mean(axis=0), atol=1e-9)
        slope, middle = np.polyfit(a, z, 1)
        noise = math.sqrt(np.square(z - slope * a - middle).sum() / (len(own) - 2))
        rise = abs(slope) * math.sqrt(12.0) * a.std()
        assert rise <= MAX_RISE + GATE * noise * math.sqrt(12.0 / len(own)) + 1e-9
        assert run["height_sigma"] == pytest.approx(noise / math.sqrt(len(own)), abs=1e-7)


def test_no_points_have_no_strips():
    nothing = strips_of(np.zeros((0, 3)), np.zeros(0, np.int64))
    assert nothing.shape == (0,)
    runs = find_runs(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), BEAM)[1]
    assert runs.shape == (0,)
    assert runs.dtype == RUN


def sorted_cycle(seed, sigma=0.004):
    """Return lines, points from the laser and azimuths of a cluttered scene, sorted."""
    rng = np.random.default_rng(seed)
    boxes = [LEDGE]
    for _ in range(4):
        x, y, z = rng.uniform(1.3, 2.2), rng.uniform(-0.8, 0.6), rng.uniform(0.4, 1.3)
        boxes.append(((x, x + 0.2), (y, y + 0.3), (z - 0.3, z)))
    points, lines = simulated_cycle(rng.uniform(-0.3, 0.3), sigma, seed, boxes)
    seen = points - EYE
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    order = np.lexsort((azimuth, lines))
    return lines[order].astype(np.int64), seen[order], azimuth[order]


def expected_runs(lines, seen, azimuth):
    """The runs of find_runs in plain Python: neighbours of one height, cut where they bend."""
    of_point, found = np.full(len(lines), -1), 0
    start = 0
    while start < len(lines):
        members, k = [], start
        last = start
        while k < len(lines) and lines[k] == lines[start]:
            if azimuth[k] - azimuth[last] > MAX_BEAMS * BEAM:
                break
            height = np.mean(seen[members, 2]) if members else seen[k, 2]
            if abs(seen[k, 2] - height) <= TOLERANCE:
                members.append(k)
                last = k
            k += 1
        parts = [members]
        while parts:
            part = parts.pop()
            if len(part) < MIN_BEAMS:
                continue
            a, z = azimuth[part], seen[part, 2]
            squares = squared_rest(a, z)
            noise = math.sqrt(squares / (len(part) - 2))
            rise = abs(np.polyfit(a, z, 1)[0]) * math.sqrt(12.0) * a.std()
            if rise <= MAX_RISE + GATE * noise * math.sqrt(12.0 / len(part)):
                of_point[part] = found
                found += 1
                continue
            rests = [squared_rest(a[:c], z[:c]) + squared_rest(a[c:], z[c:])
                     for c in range(3, len(part) - 2)]  # fmt: skip
            if rests and min(rests) < SPLIT_FRACTION * squares:
                cut = 3 + int(np.argmin(rests))
                parts += [part[cut:], part[:cut]]
        start = last + 1
    return of_point


def squared_rest(a, z):
    return float(np.square(z - np.polyval(np.polyfit(a, z, 1), a)).sum())


@pytest.mark.parametrize("seed", range(4))
def test_runs_equal_those_of_plain_python(seed):
    lines, seen, azimuth = sorted_cycle(seed)
    of_point, runs = find_runs(lines, seen, azimuth, BEAM)
    assert len(runs) > 10
    np.testing.assert_array_equal(of_point, expected_runs(lines, seen, azimuth))


@pytest.mark.parametrize("seed", range(4))
def test_vertical_runs_equal_those_found_by_interpolation(seed):
    lines, seen, azimuth = sorted_cycle(seed)
    of_point, runs = find_runs(lines, seen, azimuth, BEAM)
    distance = np.hypot(seen[:, 0], seen[:, 1])
    expected = np.zeros(len(runs), bool)
    for r, run in enumerate(runs):
        own = of_point == r
        for line in (run["line"] - 1, run["line"] + 1):
            there = (lines == line) & (azimuth >= run["first"]) & (azimuth <= run["last"])
            away = distance[there] - np.interp(azimuth[there], azimuth[own], distance[own])
            rises = np.abs(seen[there, 2] - run["height"]) > 2.0 * MAX_RISE
            same = np.count_nonzero(rises & (np.abs(away) <= MAX_OFFSET))
            expected[r] |= same >= MAJORITY * ((run["last"] - run["first"]) / BEAM + 1.0)
    assert expected.any()
    assert not expected.all()
    is_vertical = find_vertical_runs(lines, seen, azimuth, BEAM, of_point, runs)
    np.testing.assert_array_equal(is_vertical, expected)


@pytest.mark.parametrize("seed", range(4))
def test_linked_runs_equal_a_test_of_all_pairs(seed):
    lines, seen, azimuth = sorted_cycle(seed)
    of_point, runs = find_runs(lines, seen, azimuth, BEAM)
    is_vertical = find_vertical_runs(lines, seen, azimuth, BEAM, of_point, runs)
    pairs = [
        (a, b) for b in range(len(runs)) for a in range(b) if may_link(runs, is_vertical, a, b)
    ]
    graph = coo_array((np.ones(len(pairs)), np.array(pairs).reshape(-1, 2).T), [len(runs)] * 2)
    _, expected = connected_components(graph, directed=False)
    roots = link_runs(runs, is_vertical, BEAM)
    assert len(pairs) > 2
    same = roots[:, None] == roots[None]
    np.testing.assert_array_equal(same, expected[:, None] == expected[None])


def may_link(runs, is_vertical, a, b):
    one, other = runs[a], runs[b]
    overlap = min(one["last"], other["last"]) - max(one["first"], other["first"])
    noise = math.hypot(one["height_sigma"], other["height_sigma"])
    length = [float(np.hypot(*(run["end"] - run["begin"]))) for run in (one, other)]
    short, long = (other, one) if length[1] <= length[0] else (one, other)
    along = (long["end"] - long["begin"]) / max(length)
    offset = 0.5 * (short["begin"] + short["end"]) - long["begin"]
    distance = abs(along[0] * offset[1] - along[1] * offset[0])
    return (
        0 < abs(one["line"] - other["line"]) <= MAX_LINES
        and not (is_vertical[a] and is_vertical[b])
        and overlap >= -MAX_BEAMS * BEAM
        and abs(one["height"] - other["height"]) <= MAX_RISE + GATE * noise
        and MAX_OFFSET <= distance <= min(MIN_LENGTH, 2.0 * min(length))
    )


@pytest.mark.parametrize(("below", "expected"), [(6, False), (7, True)])
def test_half_of_the_beams_of_a_run_are_not_rounded(below, expected):
    """A run over 11.6 steps has 12.6 beams: six straight below are less than half, seven more."""
    step = math.radians(0.5)
    own = np.array([*range(11), 11.6]) * step
    azimuth = np.concatenate([own, own[1 : 1 + below] + 0.1 * step])
    lines = np.repeat([0, 1], [len(own), below])
    z = np.repeat([-0.4, -0.5], [len(own), below])
    seen = np.column_stack([2.0 * np.cos(azimuth), 2.0 * np.sin(azimuth), z])
    of_point, runs = find_runs(lines, seen, azimuth, step)
    assert runs[0]["points"] == len(own)
    assert find_vertical_runs(lines, seen, azimuth, step, of_point, runs)[0] == expected
