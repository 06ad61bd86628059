"""Gaps between samples against a plain search, and what fills them."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from rasters import rastered

from tccm_ros.outlines.gaps import close_combs, fill_gaps, find_gaps
from tccm_ros.outlines.raster import EMPTY, SAMPLE

MARGIN = 6  # empty cells around the samples
STEPS = 32  # cells: steps of this many or more are no links

MASKS = arrays.arrays(np.bool_, st.tuples(st.integers(1, 40), st.integers(1, 40)))


def gaps_of(raster):
    """(a, b, step, axis) of neighbouring samples with a gap between them in a row or column."""
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
def test_gaps_equal_those_of_a_brute_force_search(mask):
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
