"""What beams passed through: columns and cells, against points sampled along the beams."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tccm_rig import exactly

from tccm_ros.cuboids.clearing import index_cells, mark_passed
from tccm_ros.cuboids.cuboids import cell_keys
from tccm_ros.cuboids.free_intervals import BINS, WORDS, FreeIntervalTracer, trace_beams

BIN = 0.02  # m, height of a bin: the cell size of the map
HIT_MARGIN = 2  # bins around a hit that are not free
MARGIN = 0.010  # m, of a beam inside a cuboid: four sigmas of a range (2.5 mm)
MIN_HEIGHT = -1.5  # m, lower end of a column above the base
STOP_CELLS = 2.0  # cells before a beam's end: that of the hit and the previous one

place = st.floats(-0.9, 0.9).map(lambda v: round(v, 3))
beam = st.tuples(st.tuples(place, place, place), st.tuples(place, place, place))


def samples(origin, end, count=4000):
    t = (np.arange(count) + 0.5)[:, None] / count
    return np.array(origin) + t * (np.array(end) - np.array(origin))


def touches(origin, end, bottom, top, slack=1e-9):
    """Whether a segment meets a closed box, by slabs."""
    first, last = 0.0, 1.0
    for o, d, b, t in zip(origin, end - origin, bottom - slack, top + slack, strict=True):
        if abs(d) < 1e-12:
            if not b <= o <= t:
                return False
            continue
        enter, leave = sorted(((b - o) / d, (t - o) / d))
        first, last = max(first, enter), min(last, leave)
    return first <= last + slack


@exactly
@given(beam)
@example(((0.0, 0.5, 0.0), (0.5, 0.0, 0.5)))
@example(((0.0, 0.0, 0.38), (0.0, 0.0, 0.38)))
def test_free_intervals_equal_dense_sampling_of_the_beams(line):
    origin, end = (np.array([p]) for p in line)
    half, cell, width = 10, 0.1, 20
    seen, hit = np.zeros((width**2, WORDS), np.uint64), np.zeros((width**2, WORDS), np.uint64)
    trace_beams(origin, end, np.array([False]), cell, half, seen, hit)
    bins = np.unpackbits(seen.view(np.uint8), axis=1, count=BINS, bitorder="little")
    found = {(c // width - half, c % width - half, b) for c, b in np.argwhere(bins).tolist()}
    points = samples(origin[0], end[0])
    cells = np.floor(points[:, :2] / cell).astype(int)
    # Rounded as in the kernel: a height on the border of two bins belongs to one of them.
    bins = np.floor((points[:, 2] - MIN_HEIGHT) * (1.0 / BIN)).astype(int)
    truth = {(x, y, b) for (x, y), b in zip(cells.tolist(), bins.tolist(), strict=True)}
    assert truth <= found
    # Besides, only what the beam touches for less than a sample, at edges and corners.
    sizes, low = np.array([cell, cell, BIN]), np.array([0.0, 0.0, MIN_HEIGHT])
    for box in found - truth:
        bottom = low + np.array(box) * sizes
        assert touches(origin[0], end[0], bottom, bottom + sizes), box


def test_a_beam_is_free_up_to_its_hit_only():
    columns = FreeIntervalTracer(0.1, 1.0)
    columns.add(np.array([[0.05, 0.05, 0.5]]), np.array([[0.55, 0.05, 0.5]]), np.array([True]))
    rows = columns.intervals(0.0)
    assert rows[:, 0].tolist() == pytest.approx([0.05, 0.15, 0.25, 0.35, 0.45])
    assert (rows[:, 2] <= 0.5).all()
    assert (rows[:, 3] >= 0.5).all()
    assert len(columns.intervals(0.0)) == 0


def test_gaps_between_scan_lines_are_closed_but_not_across_a_hit():
    # Two lines at a distance of 6 cm in a column 0.75 m away: an angle of 0.08 rad.
    origins = np.array([[0.05, 0.05, 0.40], [0.05, 0.05, 0.46]])
    ends = np.array([[0.95, 0.05, 0.40], [0.95, 0.05, 0.46]])
    columns = FreeIntervalTracer(0.1, 1.0)
    columns.add(origins, ends, np.zeros(2, bool))
    closed = [r for r in columns.intervals(0.08) if abs(r[0] - 0.75) < 0.01]
    assert len(closed) == 1
    assert closed[0][3] - closed[0][2] == pytest.approx(0.08, abs=0.021)
    columns.add(origins, ends, np.zeros(2, bool))
    assert len([r for r in columns.intervals(0.0) if abs(r[0] - 0.75) < 0.01]) == 2
    columns.add(origins, ends, np.zeros(2, bool))
    columns.add(np.array([[0.05, 0.05, 0.43]]), np.array([[0.75, 0.05, 0.43]]), np.array([True]))
    kept = [r for r in columns.intervals(0.08) if abs(r[0] - 0.75) < 0.01]
    # The hit takes what is within two bins of it.
    assert all(r[3] <= 0.43 - HIT_MARGIN * BIN + 0.021 or r[2] >= 0.43 for r in kept)


spans = st.lists(
    st.tuples(st.integers(-4, 4), st.integers(-4, 4), st.integers(-20, 20), st.integers(3, 20)),
    min_size=1,
    max_size=20,
)


@exactly
@given(beam, spans, st.booleans())
def test_cuboids_passed_by_beams_equal_dense_sampling(line, boxes, is_hit):
    cell = 0.2
    rows = sorted({(x, y): (b / 20, (b + d) / 20) for x, y, b, d in boxes}.items())
    keys = cell_keys([k[0] for k, _ in rows], [k[1] for k, _ in rows])
    bounds = np.array([v for _, v in rows])
    order = np.argsort(keys, kind="stable")
    keys, bounds = keys[order], bounds[order]
    cells = [rows[i][0] for i in order]
    origin, end = (np.array([p]) for p in line)
    passed = np.zeros(len(keys), bool)
    mark_passed(origin, end, np.array([is_hit]), cell, index_cells(keys, bounds), passed)
    level = np.hypot(*(end[0, :2] - origin[0, :2])) / cell
    stop = max(0.0, (level - STOP_CELLS) / max(level, 1e-9)) if is_hit else 1.0
    points = samples(origin[0], end[0])[: int(4000 * stop)]
    at = np.floor(points[:, :2] / cell).astype(int)
    for i, (x, y) in enumerate(cells):
        here = points[(at == [x, y]).all(axis=1), 2]
        inside = (here > bounds[i, 0] + MARGIN) & (here < bounds[i, 1] - MARGIN)
        if inside.sum() > 1:
            assert passed[i]
        if passed[i] and len(here) > 2:
            # The interval of heights overlaps: nearly so, between two samples.
            assert here.max() > bounds[i, 0] + MARGIN - 0.002
            assert here.min() < bounds[i, 1] - MARGIN + 0.002
