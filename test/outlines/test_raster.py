"""Which cells of a raster are samples."""

import numpy as np

from tccm_ros.outlines.raster import EMPTY, FILLED, SAMPLE, draw_runs


def test_a_run_marks_its_cells_once():
    raster = np.full((4, 8), EMPTY, np.int32)
    runs = np.array([[11, 21, 23], [11, 22, 24], [12, 25, 25]], np.int32)
    assert draw_runs(raster, runs, 10, 20) == 5
    assert sorted(map(tuple, np.argwhere(raster == SAMPLE).tolist())) == [
        (1, 1), (1, 2), (1, 3), (1, 4), (2, 5),
    ]  # fmt: skip
    assert FILLED not in raster
