"""The limits on how steep planes are mean what they say: angles, and how far a plane rises."""

import math

import pytest

from tccm_ros.cuboids.inclination import (
    CROSSES_CELLS_ONCE,
    FITTED_AS_VERTICAL,
    OUTLINED_BY_COLUMNS,
)


@pytest.mark.parametrize(
    ("limit", "slope_deg"),
    [(FITTED_AS_VERTICAL, 78.0), (OUTLINED_BY_COLUMNS, 70.0), (CROSSES_CELLS_ONCE, 37.0)],
)
def test_limits_are_the_angles_that_they_are_explained_by(limit, slope_deg):
    """The vertical component of a unit normal is the cosine of the slope."""
    assert math.degrees(math.acos(limit)) == pytest.approx(slope_deg, abs=1.0)


def test_plane_that_crosses_cells_once_rises_less_than_a_cell_per_cell():
    assert math.tan(math.acos(CROSSES_CELLS_ONCE)) < 1.0
