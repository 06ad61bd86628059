"""Conversion of messages for the control loop of approach_node."""

import numpy as np

from tccm_ros.nodes.approach.base_inputs import cube_middles

CUBE_M = 0.05


def test_the_middle_of_a_cube_is_that_of_all_cells_in_it():
    """Cells of 2 cm at all places of cubes, also on their sides, as float32 in the message."""
    cells = np.arange(-100_000, 100_000) * 0.01
    cubes = np.floor(cells / CUBE_M + 1e-9)
    xy = np.column_stack([cells, cells]).astype(np.float32).astype(np.float64)
    middles = cube_middles(xy)
    assert np.allclose(middles, (cubes[:, None] + 0.5) * CUBE_M, atol=1e-6)
