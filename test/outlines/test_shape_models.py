"""The model of an outline is the simplest that its samples support."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point, Polygon, affinity, box

from tccm_ros.outlines.shape_models import OutlineSamples, StraightModel, choose_model
from tccm_ros.records import SurfaceShape

SPACING = 0.03  # m, between samples of an outline, and length of a piece of an edge


def sampled(outline, sigma=0.012, hidden=None, rng=None):
    """Return samples of an outline, each moved across by its noise; none seen where hidden."""
    ring = shapely.geometry.polygon.orient(outline, 1.0).exterior
    count = int(ring.length / SPACING)
    at = (np.arange(count) + 0.5) / count * ring.length
    points = shapely.get_coordinates(shapely.line_interpolate_point(ring, at))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(ring, (at + 1e-4) % ring.length))
    along = (ahead - points) / np.hypot(*(ahead - points).T)[:, None]
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    if rng is not None:
        # The error of a scan line is one over some samples.
        errors = np.repeat(rng.normal(0.0, 0.7 * sigma, count // 3 + 1), 3)[:count]
        points = points + errors[:, None] * outward
    seen = np.ones(count, bool)
    if hidden is not None:
        seen = ~shapely.contains_xy(hidden, points[:, 0], points[:, 1])
    return OutlineSamples(
        points, outward, np.full(count, sigma), np.full(count, 0.02), seen, np.zeros((0, 2))
    )


def chosen(outline, yaw=0.0, **kwargs):
    samples = sampled(outline, **kwargs)
    ragged = Polygon(samples.points)
    return choose_model(samples, ragged, np.array([yaw]), np.zeros(0))


@settings(max_examples=20, deadline=None)
@given(st.floats(0.4, 2.0), st.floats(0.3, 1.0), st.floats(-1.5, 1.5), st.integers(0, 1000))
def test_a_rectangle_is_one(length, width, yaw, seed):
    true = affinity.rotate(box(0, 0, length, width), yaw, (0, 0), use_radians=True)
    model = chosen(true, yaw, rng=np.random.default_rng(seed))
    assert model.shape is SurfaceShape.RECTANGLE
    found = model.polygon()
    assert len(found.exterior.coords) == 5
    assert found.intersection(true).area / found.union(true).area > 0.9


def test_an_l_is_one():
    true = Polygon([(0, 0), (2, 0), (2, 0.6), (0.6, 0.6), (0.6, 1.5), (0, 1.5)])
    model = chosen(true, rng=np.random.default_rng(1))
    assert model.shape is SurfaceShape.L
    found = model.polygon()
    assert found.intersection(true).area / found.union(true).area > 0.95


@pytest.mark.parametrize("seed", range(8))
def test_a_ragged_l_is_one(seed):
    """Objects before it hide the last 0 to 20 cm of two fifths of its border."""
    true = Polygon([(0, 0), (2.4, 0), (2.4, 0.6), (0.6, 0.6), (0.6, 1.2), (0, 1.2)])
    samples, rng = sampled(true, rng=np.random.default_rng(seed)), np.random.default_rng(seed)
    pieces = np.arange(len(samples.points)) // 6
    hidden = rng.uniform(0.0, 0.2, pieces[-1] + 1)
    hidden[rng.uniform(size=len(hidden)) < 0.6] = 0.0
    points = samples.points - hidden[pieces][:, None] * samples.outward
    samples = samples._replace(points=points, seen=hidden[pieces] == 0.0)
    measured = max(shapely.get_parts(Polygon(points).buffer(0)), key=shapely.area)
    model = choose_model(samples, measured, np.array([0.0]), np.zeros(0))
    assert model.shape is SurfaceShape.L
    found = model.polygon()
    assert found.intersection(true).area / found.union(true).area >= 0.9


def test_a_circle_is_one():
    model = chosen(Point(1, 2).buffer(0.5), rng=np.random.default_rng(2))
    assert model.shape is SurfaceShape.CIRCLE
    assert model.radii == pytest.approx([0.5, 0.5], abs=0.01)


def test_an_ellipse_is_one():
    true = affinity.scale(Point(0, 0).buffer(1.0), 0.9, 0.5)
    model = chosen(true, rng=np.random.default_rng(2))
    assert model.shape is SurfaceShape.ELLIPSE


def test_a_trapezium_is_a_polygon():
    true = Polygon([(0, 0), (1.6, 0), (1.2, 0.8), (0.3, 0.8)])
    model = chosen(true, rng=np.random.default_rng(4))
    assert model.shape is SurfaceShape.POLYGON
    assert isinstance(model, StraightModel)
    found = model.polygon()
    assert found.intersection(true).area / found.union(true).area > 0.95


NOTCH = box(0.5, 0.3, 2.0, 2.0)


def test_a_hidden_notch_makes_no_l():
    """What nobody looked past does not make the rectangle wrong; what was looked past does."""
    outline = box(0, 0, 1.2, 0.6) - NOTCH
    hidden = chosen(outline, hidden=NOTCH.buffer(0.02), rng=np.random.default_rng(5))
    seen = chosen(outline, rng=np.random.default_rng(5))
    assert hidden.shape is SurfaceShape.RECTANGLE
    assert seen.shape is SurfaceShape.L


def test_model_does_not_cover_observed_free_space():
    outline = box(0, 0, 1.2, 0.6) - NOTCH
    samples = sampled(outline, hidden=NOTCH.buffer(0.02))
    x, y = np.meshgrid(np.arange(0.6, 1.2, 0.06), np.arange(0.4, 0.6, 0.06))
    through = samples._replace(through=np.column_stack([x.ravel(), y.ravel()]))
    model = choose_model(through, outline, np.array([0.0]), np.zeros(0))
    assert model.shape is SurfaceShape.L


def test_ends_of_oblique_scan_lines_make_no_polygon():
    """Two lines cross a narrow ledge: their ends face no end of the ledge, which no view saw."""
    ledge = box(0.0, 0.0, 0.9, 0.2)
    covered = Polygon([(0.0, 0.0), (0.5, 0.0), (0.9, 0.2), (0.4, 0.2)])
    samples = sampled(covered, hidden=ledge.buffer(0.1), sigma=0.03)
    model = choose_model(samples, covered, np.array([0.0]), np.zeros(0))
    assert model.shape is SurfaceShape.RECTANGLE
    assert model.polygon().intersection(ledge).area / model.polygon().union(ledge).area > 0.95


def test_the_direction_of_a_wall_needs_no_estimation():
    """Both directions fit as well; that of the wall is no parameter."""
    samples = sampled(box(0.0, 0.0, 0.9, 0.2))
    yaws = np.array([0.01]), np.array([-0.01])
    for own, wall in (yaws, yaws[::-1]):
        model = choose_model(samples, Polygon(samples.points), own, wall)
        assert np.arctan2(*model.normals[0, ::-1]) == pytest.approx(float(wall[0]))
        assert (model.along_wall, model.parameters) == (True, 4)


def test_corners_are_where_edges_meet():
    true = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.0, 0.5]])
    normals = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    model = StraightModel(SurfaceShape.RECTANGLE, normals, np.array([0, 1, 0.5, 0.0]), True)
    assert model.corners() == pytest.approx(true)
