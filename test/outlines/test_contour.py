"""Rings around cells: each full cell inside, each empty one outside, and no two sides cross."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from shapely import LinearRing, Polygon, contains_xy

from tccm_ros.outlines.contour import largest_polygon, trace
from tccm_ros.outlines.raster import EMPTY, SAMPLE
from tccm_ros.outlines.rings import crosses, signed_area

MASKS = arrays.arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))
SEEDS = st.integers(0, 2**32 - 1)


def rastered(mask):
    """A raster of samples with an empty rim; each sample is an edge cell of its own."""
    raster = np.full((mask.shape[0] + 2, mask.shape[1] + 2), EMPTY, np.int32)
    inner = raster[1:-1, 1:-1]
    inner[mask] = np.arange(mask.sum())
    return raster


def reaches(raster, seed):
    """Random reaches within each cell and a little beyond, float64 (E, 4)."""
    rng = np.random.default_rng(seed)
    cells = np.argwhere(raster >= 0)
    cells = cells[np.argsort(raster[raster >= 0])]
    spread = rng.uniform(-0.6, 0.6, (len(cells), 4))
    return cells[:, [0, 0, 1, 1]] + [0.0, 1.0, 0.0, 1.0] + spread


def rings_of(vertices, ends):
    return np.split(vertices, ends[:-1]) if len(ends) else []


@settings(deadline=None)
@given(MASKS, SEEDS)
def test_rings_separate_full_cells_from_empty_ones(mask, seed):
    raster = rastered(mask)
    vertices, ends = trace(raster, reaches(raster, seed))
    rings = rings_of(vertices, ends)
    a, b = np.indices(raster.shape) + 0.5
    inside = np.zeros(raster.shape, int)
    for ring in rings:
        assert LinearRing(ring).is_simple
        inside += np.where(contains_xy(Polygon(ring), a, b), np.sign(signed_area(ring)), 0).astype(
            int
        )
    np.testing.assert_array_equal(inside, raster != EMPTY)
    assert not crosses(vertices, ends)


@settings(deadline=None)
@given(MASKS, SEEDS, st.floats(0.0, 3.0))
def test_the_largest_polygon_is_valid_at_any_tolerance(mask, seed, tolerance):
    raster = rastered(mask)
    vertices, ends = trace(raster, reaches(raster, seed))
    corners, last, area = largest_polygon(vertices, ends, tolerance, 0.0)
    if not mask.any():
        assert len(corners) == 0
        return
    shell, *holes = rings_of(corners, last)
    polygon = Polygon(shell, holes)
    assert polygon.is_valid
    assert polygon.area == pytest.approx(area)
    assert polygon.exterior.is_ccw
    assert not any(ring.is_ccw for ring in polygon.interiors)
    assert {tuple(c) for c in corners} <= {tuple(v) for v in vertices}


def test_an_edge_lies_at_the_bounds_of_its_points():
    raster = np.full((5, 6), EMPTY, np.int32)
    raster[1:4, 1:5] = np.arange(12).reshape(3, 4)
    a, b = np.divmod(np.arange(12), 4) + np.array([[1.0], [1.0]])
    bounds = np.stack([a + 0.25, a + 0.875, b + 0.125, b + 0.75], axis=1)
    corners, _, _ = largest_polygon(*trace(raster, bounds), 0.0, 0.0)
    np.testing.assert_allclose(corners.min(axis=0), (1.25, 1.125))
    np.testing.assert_allclose(corners.max(axis=0), (3.875, 4.75))


def test_an_edge_without_bounds_lies_at_the_border_of_its_cell():
    raster = np.full((5, 6), EMPTY, np.int32)
    raster[1:4, 1:5] = SAMPLE
    corners, _, area = largest_polygon(*trace(raster, np.zeros((0, 4))), 0.0, 0.0)
    np.testing.assert_allclose(corners.min(axis=0), (1.0, 1.0))
    np.testing.assert_allclose(corners.max(axis=0), (4.0, 5.0))
    assert area == pytest.approx(12.0)
    assert len(corners) == 4


def test_small_holes_are_closed_and_large_ones_stay():
    raster = np.full((22, 22), EMPTY, np.int32)
    raster[1:21, 1:21] = SAMPLE
    raster[4, 4] = EMPTY
    raster[10:15, 10:15] = EMPTY
    corners, ends, _ = largest_polygon(*trace(raster, np.zeros((0, 4))), 0.5, 5.0 / 400)
    assert len(ends) == 2
    assert -signed_area(corners[ends[0] :]) == pytest.approx(25.0)
