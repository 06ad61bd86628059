"""Sides of the rectangle that has the moments of an area, against sums over a fine grid."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import MultiPolygon, box
from shapely.affinity import rotate

from tccm_ros.surfaces.polygons import equal_sides


@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(-180.0, 180.0))
def test_a_rectangle_has_its_own_sides(a, b, yaw):
    assert equal_sides(rotate(box(2.0, -1.0, 2.0 + a, b - 1.0), yaw)) == pytest.approx(
        sorted((a, b)), abs=1e-6
    )


@pytest.mark.parametrize(
    "area",
    [
        box(0, 0, 1, 0.6).difference(box(0.3, 0.2, 0.5, 0.4)),
        box(0, 0, 1, 0.6).difference(box(0.5, 0.3, 1, 0.6)),
        MultiPolygon([box(0, 0, 0.4, 0.4), box(0.6, 0.1, 1.0, 0.5)]),
    ],
)
def test_any_area_has_the_sides_that_its_moments_give(area):
    step = 0.002
    xy = np.stack(np.meshgrid(*(np.arange(step / 2, 1.0, step),) * 2), axis=-1).reshape(-1, 2)
    inside = xy[shapely.contains_xy(area, *xy.T)]
    variances = np.linalg.eigvalsh(np.cov(inside.T))
    assert equal_sides(area) == pytest.approx(np.sqrt(12.0 * variances), abs=2e-3)
