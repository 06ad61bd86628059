"""Which cells are at an edge, and how far a surface goes on beyond them."""

import numpy as np
from rasters import rastered

from tccm_ros.outlines.edge_cells import extend_edges, find_edges
from tccm_ros.outlines.raster import EMPTY, SAMPLE

MARGIN = 6  # empty cells around the samples


def test_edges_are_the_samples_beside_an_empty_cell():
    mask = np.zeros((9, 9), bool)
    mask[2:7, 2:7] = True
    raster = rastered(mask)
    edges = find_edges(raster)
    assert len(edges) == 16
    assert (raster[MARGIN + 3 : MARGIN + 6, MARGIN + 3 : MARGIN + 6] == SAMPLE).all()
    for number, (a, b) in enumerate(edges):
        assert raster[a, b] == number


def test_sparse_samples_extend_by_half_a_spacing_but_not_out_of_the_raster():
    raster = rastered(np.ones((1, 1), bool))
    edges = find_edges(raster)
    at = MARGIN + 0.5
    for spacing, wide in ((1.0, 1), (4.0, 5), (30.0, 2 * MARGIN - 1)):
        drawn, bounds = raster.copy(), np.full((1, 4), at)
        usual = np.full(100, spacing)
        extend_edges(drawn, edges, bounds, usual, np.ones(100))
        assert (drawn != EMPTY).sum() == wide
        assert (drawn[:, MARGIN] != EMPTY).sum() == wide
        assert not (drawn[0] != EMPTY).any()
