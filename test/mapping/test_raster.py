"""Gaps between samples against a plain search, and what fills them."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tccm_ros.mapping.linking import STEPS
from tccm_ros.mapping.outlines.raster import (
    EMPTY,
    FILLED,
    MARGIN,
    SAMPLE,
    close_combs,
    draw_runs,
    extend_edges,
    fill_gaps,
    find_edges,
    find_gaps,
)

MASKS = arrays.arrays(np.bool_, st.tuples(st.integers(1, 40), st.integers(1, 40)))


def rastered(mask):
    return np.pad(np.where(mask, SAMPLE, EMPTY).astype(np.int32), MARGIN, constant_values=EMPTY)


def gaps_of(raster):
    """(a, b, step, axis) of neighbouring samples in a row or column, more than one cell apart."""
    found = set()
    for axis in (0, 1):
        for line, cells in enumerate(raster.T if axis == 0 else raster):
            at = np.flatnonzero(cells == SAMPLE)
            for before, here in pairwise(at):
                if 1 < here - before < STEPS:
                    a, b = (here, line) if axis == 0 else (line, here)
                    found.add((int(a), int(b), int(here - before), axis))
    return found


@settings(deadline=None)
@given(MASKS)
def test_gaps_are_those_of_a_plain_search(mask):
    raster = rastered(mask)
    gaps, usual_a, usual_b = find_gaps(raster, int(mask.sum()))
    assert {tuple(g) for g in gaps.tolist()} == gaps_of(raster)
    assert len(gaps) == len(gaps_of(raster))
    assert (usual_a >= 1.0).all()
    assert (usual_b >= 1.0).all()


@settings(deadline=None)
@given(MASKS)
def test_filling_keeps_samples_and_fills_only_between_them(mask):
    raster = rastered(mask)
    before = raster.copy()
    gaps, usual_a, usual_b = find_gaps(raster, int(mask.sum()))
    fill_gaps(raster, gaps, usual_a, usual_b)
    close_combs(raster, usual_a.max(), usual_b.max())
    np.testing.assert_array_equal(raster[before == SAMPLE], SAMPLE)
    full = raster != EMPTY
    rows, columns = np.nonzero(before == SAMPLE)
    if len(rows):
        inside = np.zeros_like(full)
        inside[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
        assert not (full & ~inside).any()
    else:
        assert not full.any()


def test_even_samples_are_filled_and_a_longer_gap_stays_open():
    mask = np.zeros((70, 60), bool)
    mask[::4, ::4] = True
    mask[30:46] = False
    raster = rastered(mask)
    gaps, usual_a, usual_b = find_gaps(raster, int(mask.sum()))
    fill_gaps(raster, gaps, usual_a, usual_b)
    close_combs(raster, usual_a.max(), usual_b.max())
    full = raster[MARGIN:-MARGIN, MARGIN:-MARGIN] != EMPTY
    assert full[:29, :57].all()
    assert full[48:69, :57].all()
    assert not full[29:48].any()


def test_edges_are_the_samples_beside_an_empty_cell():
    mask = np.zeros((9, 9), bool)
    mask[2:7, 2:7] = True
    raster = rastered(mask)
    edges = find_edges(raster)
    assert len(edges) == 16
    assert (raster[MARGIN + 3 : MARGIN + 6, MARGIN + 3 : MARGIN + 6] == SAMPLE).all()
    for number, (a, b) in enumerate(edges):
        assert raster[a, b] == number


def test_sparse_samples_reach_half_a_spacing_further_but_not_out_of_the_raster():
    raster = rastered(np.ones((1, 1), bool))
    edges = find_edges(raster)
    at = MARGIN + 0.5
    for spacing, wide in ((1.0, 1), (4.0, 5), (30.0, 2 * MARGIN - 1)):
        drawn, reach = raster.copy(), np.full((1, 4), at)
        usual = np.full(100, spacing)
        extend_edges(drawn, edges, reach, usual, np.ones(100))
        assert (drawn != EMPTY).sum() == wide
        assert (drawn[:, MARGIN] != EMPTY).sum() == wide
        assert not (drawn[0] != EMPTY).any()


def test_a_run_marks_its_cells_once():
    raster = np.full((4, 8), EMPTY, np.int32)
    runs = np.array([[11, 21, 23], [11, 22, 24], [12, 25, 25]], np.int32)
    assert draw_runs(raster, runs, 10, 20) == 5
    assert sorted(map(tuple, np.argwhere(raster == SAMPLE).tolist())) == [
        (1, 1), (1, 2), (1, 3), (1, 4), (2, 5),
    ]  # fmt: skip
    assert FILLED not in raster
