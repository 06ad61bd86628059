"""cycles.npz: coarsening against a brute force, reading back, and damaged files."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.errors import MapError, OutputError
from tccm_ros.results.cycles_file import CycleHistory, coarsen, load_cycles, save_cycles

MAX_MERGE_GAP_CM = 2  # cm, vertical gap that is merged

INTERVALS = st.lists(
    st.tuples(st.integers(-2, 2), st.integers(-2, 2), st.integers(-40, 40), st.integers(1, 15)),
    max_size=40,
)


def cuboids(rows, cell_size=0.02):
    ix, iy, bottom, top = (np.array(c, np.int32) for c in (zip(*rows) if rows else ([],) * 4))
    n = len(ix)
    return Cuboids(
        cell_size, ix, iy, bottom, top, np.ones(n), np.zeros((n, 3)), np.zeros((n, 6)),
        np.zeros(n, np.int32), np.arange(n + 1),
    )  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(INTERVALS)
def test_coarsening_is_the_union_of_intervals_with_small_gaps_closed(rows):
    columns = np.array([(x, y, b, b + d) for x, y, b, d in rows], np.int64).reshape(-1, 4).T
    covered: dict = {}
    for x, y, b, d in rows:
        covered.setdefault((x, y), set()).update(range(b, b + d))
    expected = []
    for (x, y), units in sorted(covered.items()):
        heights = sorted(units)
        start = heights[0]
        for low, high in zip(heights, [*heights[1:], None]):
            if high is None or high - (low + 1) > MAX_MERGE_GAP_CM:
                expected.append((x, y, start, low + 1))
                start = high
    assert coarsen(*columns).T.tolist() == [list(e) for e in expected]


@pytest.mark.parametrize(("gap_cm", "count"), [(2, 1), (3, 2)])
def test_gaps_of_more_than_two_centimetres_stay(gap_cm, count):
    intervals = np.array([(0, 0, 0, 10), (0, 0, 10 + gap_cm, 30)], np.int64)
    assert coarsen(*intervals.T).shape == (4, count)


def test_a_coarse_cuboid_contains_the_cuboids_that_it_is_made_of():
    history = CycleHistory(window=10)
    history.add(0, 5, cuboids([(-1, 2, -101, 99), (5, 3, 6900, 7001)]))
    parts = history.parts(np.eye(4)[None])
    assert parts.cell_size == pytest.approx(0.06)
    assert parts.ix.tolist() == [-1, 1]
    assert parts.iy.tolist() == [0, 1]
    assert parts.bottom.tolist() == [-2, 69]
    assert parts.top.tolist() == [1, 71]


def test_a_file_is_read_back_exactly_and_written_with_the_same_bytes(tmp_path):
    history = CycleHistory(window=3)
    for cycle in range(3):
        history.add(cycle, 100 * cycle, cuboids([(i, cycle, 100, 7000) for i in range(20)]))
    parts = history.parts(np.tile(np.eye(4), (3, 1, 1)))
    save_cycles(tmp_path / "a.npz", parts)
    save_cycles(tmp_path / "b.npz", parts)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = load_cycles(tmp_path / "a.npz")
    for name in parts.__dataclass_fields__:
        assert np.array_equal(getattr(again, name), getattr(parts, name)), name


def test_cells_grow_until_the_cuboids_fit_the_limit(tmp_path, monkeypatch):
    monkeypatch.setattr("tccm_ros.results.cycles_file.MAX_CUBOIDS", 50)
    history = CycleHistory(window=3)
    history.add(0, 0, cuboids([(3 * x, 3 * y, 0, 300) for x in range(20) for y in range(20)]))
    parts = history.parts(np.eye(4)[None])
    assert len(parts.ix) == 25
    assert parts.cell_size == pytest.approx(0.24)


def test_a_file_without_cycles_is_read_back(tmp_path):
    save_cycles(tmp_path / "c.npz", CycleHistory(window=10).parts(np.zeros((0, 4, 4))))
    assert len(load_cycles(tmp_path / "c.npz")) == 0


@pytest.mark.parametrize("damage", ["missing", "truncated", "text", "short"])
def test_a_damaged_file_is_a_map_error_that_names_it(tmp_path, damage):
    path = tmp_path / "cycles.npz"
    history = CycleHistory(window=3)
    history.add(0, 0, cuboids([(i, 0, 100, 7000) for i in range(20)]))
    parts = history.parts(np.eye(4)[None])
    save_cycles(path, parts)
    if damage == "missing":
        path.unlink()
    elif damage == "truncated":
        path.write_bytes(path.read_bytes()[:-200])
    elif damage == "text":
        path.write_text("not an archive")
    else:
        with np.load(path) as arrays:
            kept = {k: arrays[k] for k in arrays.files}
        kept["top"] = kept["top"][:-1]
        np.savez_compressed(path, **kept)
    with pytest.raises(MapError, match=r"cycles\.npz: (no such file|damaged)"):
        load_cycles(path)


def test_a_path_that_cannot_be_written_is_an_output_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        save_cycles(tmp_path / "file" / "c.npz", CycleHistory(window=1).parts(np.zeros((0, 4, 4))))


def test_a_cycle_without_cuboids_has_the_pose_of_the_cycle_before():
    history = CycleHistory(window=3)
    for cycle, rows in enumerate([[], [(0, 0, 0, 300)], [], [(1, 1, 0, 300)], []]):
        history.add(cycle, cycle, cuboids(rows))
    frames = np.arange(5.0)[:, None, None] * np.ones((4, 4))
    assert history.parts(frames).T_map_odom[:, 0, 0].tolist() == [1, 1, 1, 3, 3]
