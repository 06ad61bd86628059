"""What views know of edges: where points end, and whether a view looked past the surface."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from room import Board, Room
from shapely import box
from surface_maps import build

from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.geometry import inverse, spatial, transform2
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.outlines.edge_position import EdgeSamples
from tccm_ros.records import SensorKind, ViewIntervals
from tccm_ros.surfaces.edges.edge_samples import Edge, EdgePoints, EdgeSampler
from tccm_ros.surfaces.merging.merged_surface import fit_surface

BEYOND = (0.10, 0.15)  # m beyond an outline: the edge of a column, and 1.5 times that
FRONT_FRACTION = 0.7  # of the last samples at a near edge are on the front
INDEPENDENT = 8.0  # effective samples of one view at most: its pose error is common to all
INSIDE = 0.12  # m inside of an edge: further points are not its last ones
OUTSIDE = 0.05  # m outside of an edge
PROBE = 0.04  # m, between the points that are tested for free space
SPACING = 0.03  # m, between samples of an outline, and length of a piece of an edge

TABLE = Board(1.6, 0.0, 0.8, 1.2, 0.74)
T = spatial(np.zeros((1, 3)))


@pytest.fixture(scope="module")
def sampler():
    surface_map = SurfaceSlam(Config()).map
    for record in Room([TABLE]).look((0.0, 0.0, 0.0), 10):
        surface_map.add(record)
    mapped = build([(Room([TABLE]), (0.0, 0.0, 0.0), 10)])
    of_table = next(m for m, s in zip(mapped.members, mapped.surfaces) if s.label != "floor")
    views = surface_map.views
    return EdgeSampler(fit_surface(of_table, views, T, Config()), views, T, Config())


def test_an_edge_has_its_surface_on_the_left():
    edge = Edge(np.array([0.0, 0.0]), np.array([2.0, 0.0]))
    assert edge.length == 2.0
    assert edge.outward == pytest.approx([0.0, -1.0])


def test_the_outline_is_sampled_all_round_and_seen_beyond(sampler):
    samples = sampler.outline_samples()
    away = samples.points - [TABLE.x, TABLE.y]
    assert ((samples.outward * away).sum(axis=1) > 0.0).mean() > 0.95
    assert samples.seen.mean() > 0.7
    assert np.hypot(*samples.outward.T) == pytest.approx(np.ones(len(samples.points)))


def test_an_outline_is_seen_where_rays_passed_beyond_it(sampler):
    """Rays passed 5 cm beyond the left side, and 5 cm before it, in the shadow of an object."""
    eye = np.array([0.0, 0.0, 1.4])
    y = np.arange(-0.35, 0.36, 0.02)
    samples = sampler.outline_samples()
    left = samples.points[:, 1] > 0.55
    for across, expected in ((0.05, True), (-0.4, False)):
        at = np.column_stack([TABLE.x + y, np.full(len(y), 0.6 + across), np.full(len(y), 0.74)])
        floor = eye + (at - eye) * (1.35 / 0.66)
        hits = np.column_stack([floor, floor[:, 2]]).astype(np.float32)
        views = [replace(view, hits=hits, viewpoint=eye, patches=()) for view in sampler.views]
        seen = replace(sampler, views=views).outline_samples().seen
        assert (seen[left].mean() > 0.8) == expected
        assert seen[left].any() == expected


def test_the_last_points_are_within_a_gap_of_a_side(sampler):
    """The left side of the table, seen along it: beams end one gap before it at most."""
    edge = Edge(np.array([2.0, 0.6]), np.array([1.2, 0.6]))
    samples = sampler.edge_samples(edge)
    assert len(samples.at) > 5
    assert samples.ends.mean() > 0.7
    within = (samples.last <= 1e-3) & (samples.last >= -samples.gap - 0.03)
    assert within.mean() > 0.8


def test_views_observe_space_beside_a_table_and_not_far_away(sampler):
    assert sampler.looks_over(Edge(np.array([2.0, 0.6]), np.array([1.2, 0.6])))
    assert not sampler.looks_over(Edge(np.array([-9.0, 0.6]), np.array([-9.8, 0.6])))


def sampler_at(view, into=lambda points: np.ones(len(points))):
    """A sampler of one view that looked through nothing, and into all columns beyond."""
    found = EdgeSampler(None, [], spatial(np.array([[*view, 0.3]])), Config())
    looks_past = lambda view, points, outward: (np.zeros(len(points)), into(points))  # noqa: E731
    object.__setattr__(found, "_looks_past", looks_past)
    return found


def member_of(spacing):
    return SimpleNamespace(view=0, patch=SimpleNamespace(spacing=spacing))


@given(st.floats(0.4, np.pi - 0.4), st.integers(0, 2**32 - 1))
def test_scan_lines_that_cross_an_edge_end_within_a_beam_of_it(angle, seed):
    """Lines each 0.1 m over a surface that ends at y = 0, with beams each 2 cm, seen from far."""
    rng = np.random.default_rng(seed)
    edge = Edge(np.array([1.0, 0.0]), np.array([0.0, 0.0]))
    along, aside = (
        np.array([np.cos(angle), np.sin(angle)]),
        np.array([-np.sin(angle), np.cos(angle)]),
    )
    lines = np.arange(-20, 20)[:, None, None] * 0.1 * aside
    beams = (np.arange(-100, 100) + rng.random((40, 1)))[..., None] * 0.02 * along
    points = (lines + beams).reshape(-1, 2) + rng.normal(0.0, 0.001, (8000, 2))
    points = points[
        (points[:, 1] < 0.0) & (points[:, 1] > -0.5) & (np.abs(points[:, 0] - 0.5) < 0.5)
    ]
    cloud = np.column_stack([points, np.full(len(points), 0.7)])
    found = sampler_at((0.5, -2.0))._line_ends(edge, member_of(0.1), cloud, along)
    at, last, gap = found[:, :3].T
    assert len(at) >= 0.5 * np.sin(angle) / 0.1
    assert gap == pytest.approx(0.02 * np.sin(angle), abs=0.004)
    assert ((last <= 0.0) & (last >= -gap - 0.006)).mean() >= 0.6
    assert ((at > SPACING) & (at < 1.0 - SPACING)).all()


def test_sample_distances_at_the_end_of_a_view_are_ignored():
    """Columns beyond the edge were looked into along its first half alone."""
    flat = np.linspace(0.02, 0.98, 60)
    xs = np.linspace(0.9, 0.999, 6)
    cloud = np.stack([np.tile(xs, 60), np.repeat(flat, 6) - 0.5, np.full(360, 0.7)], axis=1)
    sampler = sampler_at((0.0, 0.0), lambda points: points[:, 1] < 0.0)
    edge = Edge(np.array([1.0, -0.5]), np.array([1.0, 0.5]))
    rows = sampler._pieces(edge, member_of(0.02), cloud, None)
    assert (rows[rows[:, 0] < 0.45, 2] > 0.01).all()
    assert (rows[rows[:, 0] > 0.55, 2] == 0.0).all()


@given(st.integers(0, 2**32 - 1))
def test_each_piece_of_an_edge_has_its_outermost_point(seed):
    """Position, gap and front of each, piece by piece, for a view from any side."""
    rng = np.random.default_rng(seed)
    edge = Edge(*rng.uniform(-1.0, 1.0, (2, 2)))
    spacing, view = rng.uniform(0.01, 0.05), rng.uniform(-3.0, 3.0, 2)
    cloud = np.column_stack([rng.uniform(-1.5, 1.5, (2500, 2)), np.full(2500, 0.7)])
    pieces: dict[int, list[tuple[float, float]]] = {}
    for x, y, _ in cloud:
        at, across = ([x, y] - edge.start) @ edge.along, ([x, y] - edge.start) @ edge.outward
        inside = -INSIDE < across < OUTSIDE
        if inside and SPACING < at < edge.length - SPACING:
            pieces.setdefault(int(at // SPACING), []).append((across, at))
    rows = [sorted(pieces[k], reverse=True) for k in sorted(pieces)]
    beams = [row[0][0] - row[1][0] for row in rows if len(row) > 1]
    found = sampler_at(view)._pieces(edge, member_of(spacing), cloud, None)
    if sum(map(len, rows)) < 3:
        assert found is None
        return
    beam = np.median(beams) if beams else 0.0
    assert len(found) == len(rows)
    for row, expected in zip(found, rows):
        across, at = expected[0]
        ray = edge.start + at * edge.along - view
        cosine = ray @ edge.outward / np.hypot(*ray)
        gap = spacing * abs(cosine) + beam * np.sqrt(1.0 - cosine**2)
        weight = min(1.0, INDEPENDENT / len(rows))
        front = FRONT_FRACTION * max(-cosine, 0.0)
        assert row == pytest.approx([at, across, gap, front, 0.0, weight], abs=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_edge_is_observed_if_half_of_the_space_beyond_was_seen(seed):
    """Places evenly along the edge, and beyond it; columns stand in a view at a pose of its own."""
    rng = np.random.default_rng(seed)
    edge, pose = Edge(*rng.uniform(-1.0, 1.0, (2, 2))), np.array([0.4, -0.7, 1.1])
    cells = np.stack(np.meshgrid(*[np.arange(-30, 30)] * 2), axis=-1).reshape(-1, 2)
    cells = cells[rng.random(len(cells)) < rng.uniform(0.2, 0.8)]
    rows = np.column_stack([(cells + 0.5) * 0.1, np.zeros(len(cells)), np.ones(len(cells))])
    free = FreeColumns.of(ViewIntervals(1, "base", rows.astype(np.float32)), 0.1)
    sampler = SimpleNamespace(
        surface=SimpleNamespace(lift=lambda xy: np.column_stack([xy, np.full(len(xy), 0.7)])),
        views=[SimpleNamespace(free=free)],
        _inverses={0: inverse(spatial(pose[None])[0])},
    )
    known = set(map(tuple, cells.tolist()))
    back = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    over = 0
    count = int(edge.length / PROBE) + 2
    for k in range(count):
        fraction = k / (count - 1)
        place = edge.start * (1.0 - fraction) + edge.end * fraction + BEYOND[1] * edge.outward
        assert transform2(pose, ((place - pose[:2]) @ back)[None])[0] == pytest.approx(place)
        over += tuple(np.floor((place - pose[:2]) @ back / 0.1).astype(int).tolist()) in known
    assert EdgeSampler.looks_over(sampler, edge) == (over >= 0.5 * count)


def far_edge(x):
    """The far edge of the table as if it were at x, m."""
    return Edge(np.array([x, -0.5]), np.array([x, 0.5]))


def test_an_edge_was_seen_where_a_view_measured_up_to_it_and_looked_past(sampler):
    """Beyond an edge 15 cm short of the table's, the table goes on: nothing was looked through."""

    def left_edge(y):
        return Edge(np.array([1.95, y]), np.array([1.3, y]))

    assert sampler.points_before(left_edge(0.6)).seen_fraction() > 0.9
    assert sampler.points_before(left_edge(0.6)).reached_fraction(0.05) > 0.9
    for wrong in (0.45, 0.75):
        assert sampler.points_before(left_edge(wrong)).seen_fraction() == 0.0
    assert sampler.points_before(left_edge(0.75)).reached_fraction(0.05) == 0.0


@pytest.mark.filterwarnings("error")
def test_edge_without_points_beside_it_has_no_reached_part(sampler):
    beside = Edge(np.array([6.95, 0.0]), np.array([6.3, 0.0]))
    assert sampler.points_before(beside).reached_fraction(0.05) == 0.0


def test_last_samples_in_line_leave_no_doubt_and_ragged_ones_do():
    gaps = np.full(40, 0.02)

    def ragged(last):
        found = EdgeSamples(np.arange(40.0), last, gaps, 0.0 * gaps, gaps > 0.0, gaps)
        return EdgePoints(found, 0, np.zeros(0, np.int64), np.zeros(0)).ragged_sigma()

    rng = np.random.default_rng(0)
    assert ragged(-rng.uniform(0.0, 0.02, 40) + rng.normal(0.0, 0.003, 40)) < 0.003
    # A shadow across the edge: last points go back by 20 cm from one end of it to the other.
    assert ragged(np.linspace(-0.2, 0.0, 40)) == pytest.approx(1.4826 * 0.05, rel=0.1)


@pytest.mark.parametrize(("yaws", "expected"), [((0.0,), 0.005), ((0.0, np.pi), 0.0)])
def test_range_errors_of_one_sensor_do_not_average_out(yaws, expected):
    """An offset of 5 mm along level rays: views from opposite sides move an edge both ways."""
    poses = spatial(np.array([(2.0 - 2.0 * np.cos(yaw), 0.0, yaw) for yaw in yaws]))
    eye, kind = np.array([0.0, 0.0, 0.5]), SensorKind.LASER
    views = [SimpleNamespace(viewpoint=eye, sensor=kind) for _ in yaws]
    surface = SimpleNamespace(
        views=set(range(len(yaws))), lift=lambda xy: np.column_stack([xy, np.full(len(xy), 0.5)])
    )
    found = EdgeSampler(surface, views, poses, Config()).shared_sigma(far_edge(2.0))
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("low", "high", "goes_on"),
    [
        (0.05, 0.4, True),  # over objects on the surface
        (1.0, 2.0, False),  # over a cabinet beside it
        (-0.4, -0.05, False),  # below it
        (-0.1, 0.4, False),  # through it
    ],
)
def test_a_surface_may_go_on_where_views_looked_over_it_as_over_objects(low, high, goes_on):
    free = SimpleNamespace(contains=lambda at, margin: (at[:, 2] > low) & (at[:, 2] < high))
    surface = SimpleNamespace(height=0.0, lift=lambda xy: np.column_stack([xy, np.zeros(len(xy))]))
    view = SimpleNamespace(free=free, max_range=10.0)
    sampler = EdgeSampler(surface, [view], np.eye(4)[None], Config())
    assert sampler.may_go_on(box(1.0, 0.0, 1.5, 0.5)) == goes_on
