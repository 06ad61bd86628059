"""The integration map: pieces of unchanged part maps, against sets of unit steps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from interval_oracle import composites, part_cuboids, pieces
from tccm_rig import as_dict, config, exactly, filled, part_of, snapshot, void_part

from tccm_ros.cuboids.cuboids import key_cells
from tccm_ros.cuboids.integration_map import IntegrationMap

CELL, DEPTH = 20, 30
SMALL = {"cell_size": 0.002, "cuboid_depth": 0.003}

heights = st.one_of(st.integers(-3, 3).map(lambda k: k * DEPTH), st.integers(-90, 90))
places = st.sampled_from([0, 1, 19, 20, -1])
clouds = st.lists(st.tuples(places, places, heights), max_size=12)


def pieces_of(map_):
    """Return the pieces of a map in the oracle's form."""
    ix, iy = key_cells(map_.keys)
    first = {part.cycle: first_of_cell(part) for part in map_.parts}
    result = {}
    for x, y, (bottom, top, cycle, index) in zip(
        ix.tolist(), iy.tolist(), map_.pieces.tolist(), strict=True
    ):
        piece = (bottom, top, cycle, index - first[cycle][x, y])
        result.setdefault((x, y), []).append(piece)
    return result


def first_of_cell(part):
    """Return {(ix, iy): index of the cell's lowest cuboid}."""
    ix, iy = (c.tolist() for c in key_cells(part.keys))
    return {cell: index for index, cell in reversed(list(enumerate(zip(ix, iy, strict=True))))}


def check(map_, sources):
    """Compare a map with the oracle; sources are (cycle, points, voids), oldest first."""
    parts = [(cycle, part_cuboids(points, CELL, DEPTH), voids) for cycle, points, voids in sources]
    expected = pieces(parts)
    assert pieces_of(map_) == expected
    truth = composites(expected, parts)
    c = map_.cuboids()
    assert [[*row] for row in zip(c.ix, c.iy, c.bottom, c.top, strict=True)] == [
        row[:4] for row in truth
    ]
    for i, row in enumerate(truth):
        found = [c.count[i], *c.s[i], *c.S[i]]
        # Weights are float64 ratios: some units in the last place of the largest moment.
        np.testing.assert_allclose(found, [float(m) for m in row[4]], rtol=1e-12, atol=1e-9)
        assert c.cycles[c.cycle_offsets[i] : c.cycle_offsets[i + 1]].tolist() == row[5]


@exactly
@given(st.lists(clouds, max_size=7), st.integers(1, 4))
def test_map_of_random_part_maps_equals_brute_force(cycles, window):
    settings = config(window_cycles=window, **SMALL)
    map_ = IntegrationMap(settings)
    for cycle, points in enumerate(cycles):
        map_.add(part_of(points, cycle, settings))
        kept = [(k, cycles[k], {}) for k in range(max(0, cycle - window + 1), cycle + 1)]
        assert map_.cycles == [k for k, _, _ in kept]
        check(map_, kept)


steps = st.lists(
    st.one_of(
        st.tuples(st.just("add"), clouds),
        st.tuples(st.just("remove"), st.integers(0, 9)),
        st.tuples(st.just("see through"), st.tuples(heights, st.integers(1, 60))),
    ),
    max_size=14,
)


@exactly
@given(steps, st.randoms(use_true_random=False))
def test_any_sequence_of_changes_equals_a_rebuild_bit_for_bit(sequence, random):
    settings = config(window_cycles=5, **SMALL)
    map_, sources = IntegrationMap(settings), []
    cycle = 0
    voids = {}
    for what, value in sequence:
        if what == "remove":
            if sources:
                gone = sources.pop(value % len(sources))
                assert map_.remove(gone[0]).cycle == gone[0]
            continue
        if what == "see through":
            voids = {(0, 0): [(value[0], value[0] + value[1])]}
            continue
        part = part_of(value, cycle, settings)
        map_.add(void_part(part, voids) if voids else part)
        sources.append((cycle, value, voids))
        sources = [s for s in sources if s[0] > cycle - 5]
        cycle, voids = cycle + 1, {}
        shuffled = []
        for number, points, seen in sources:
            points = random.sample(points, len(points))
            other = part_of(points, number, settings)
            shuffled.append(void_part(other, seen) if seen else other)
        assert snapshot(map_) == snapshot(filled(settings, shuffled))
    check(map_, sources)


# -- the paper's cases, by name -----------------------------------------------------------------


def column(*cuboids):
    """Return one cell's pieces after adding cuboids (bottom, top), one per cycle, in order."""
    settings = config(window_cycles=10, cell_size=0.002, cuboid_depth=0.0001)
    map_ = IntegrationMap(settings)
    for cycle, (bottom, top) in enumerate(cuboids):
        points = [(0, 0, z) for z in range(bottom + 1, top + 1)]
        map_.add(part_of(points, cycle, settings))
    return map_


def spans(map_):
    return [tuple(p) for p in map_.pieces[:, :3].tolist()]


class TestPreliminaryDeformation:
    """III.C.1: a newer part map shortens the older ones (lower right of Fig. 3)."""

    def test_a_newer_cuboid_replaces_the_top_of_an_older_one(self):
        assert spans(column((0, 50), (30, 80))) == [(0, 30, 0), (30, 80, 1)]

    def test_a_newer_cuboid_replaces_the_bottom_of_an_older_one(self):
        assert spans(column((30, 80), (0, 50))) == [(0, 50, 1), (50, 80, 0)]

    def test_a_newer_cuboid_replaces_an_older_one_within_it(self):
        assert spans(column((30, 50), (0, 80))) == [(0, 80, 1)]

    def test_a_newer_cuboid_replaces_an_equal_one(self):
        assert spans(column((30, 50), (30, 50))) == [(30, 50, 1)]

    def test_a_newer_cuboid_that_touches_an_older_one_is_joined_to_it(self):
        map_ = column((0, 30), (30, 60))
        assert spans(map_) == [(0, 30, 0), (30, 60, 1)]
        assert len(map_.cuboids()) == 1

    def test_a_newer_cuboid_replaces_parts_of_several_older_ones(self):
        assert spans(column((0, 10), (20, 30), (40, 50), (5, 45))) == [
            (0, 5, 0), (5, 45, 3), (45, 50, 2),
        ]  # fmt: skip

    def test_each_of_three_nested_cycles_keeps_its_unreplaced_cuboids(self):
        assert spans(column((0, 90), (20, 70), (40, 50))) == [
            (0, 20, 0), (20, 40, 1), (40, 50, 2), (50, 70, 1), (70, 90, 0),
        ]  # fmt: skip

    def test_part_maps_are_not_changed_by_newer_ones(self):
        map_ = column((0, 90), (20, 70))
        assert map_.part(0).bounds.tolist() == [[0, 90]]
        assert map_.part(0).moments[0, 0] == 90


class TestSubtractionPatterns:
    """III.C.1, patterns 1 to 3 of Fig. 3: taking out a part map cuts the composite cuboid."""

    def test_removing_the_upper_part_of_a_composite_leaves_the_lower(self):
        map_ = column((40, 90), (0, 40))
        map_.remove(0)
        assert spans(map_) == [(0, 40, 1)]

    def test_removing_the_lower_part_of_a_composite_leaves_the_upper(self):
        map_ = column((0, 40), (40, 90))
        map_.remove(0)
        assert spans(map_) == [(40, 90, 1)]

    def test_removing_the_middle_of_a_composite_divides_it(self):
        map_ = column((40, 60), (0, 40), (60, 90))
        assert len(map_.cuboids()) == 1
        map_.remove(0)
        assert spans(map_) == [(0, 40, 1), (60, 90, 2)]
        assert len(map_.cuboids()) == 2

    def test_removing_an_old_part_map_loses_nothing_newer(self):
        # The excessive subtraction that the deformation is there to prevent.
        map_ = column((0, 90), (30, 60))
        map_.remove(0)
        assert spans(map_) == [(30, 60, 1)]


class TestDivisions:
    """IV.B, the two divisions of Fig. 5."""

    def test_a_cuboid_that_a_newer_one_cut_counts_by_the_length_that_is_left(self):
        # The division ratio follows the lengths; together the pieces weigh what is left visible.
        map_ = column((0, 90), (30, 60))
        assert spans(map_) == [(0, 30, 0), (30, 60, 1), (60, 90, 0)]
        c = map_.cuboids()
        assert len(c) == 1
        assert c.count[0] == pytest.approx(90 * 60 / 90 + 30, rel=1e-15)

    def test_the_halves_of_a_divided_composite_have_their_own_moments(self):
        # Each of the divided cuboids gets the moments of the pieces that are left in it.
        map_ = column((40, 60), (0, 40), (60, 90))
        map_.remove(0)
        c = map_.cuboids()
        assert c.count.tolist() == [40.0, 30.0]
        assert c.mean()[:, 2].tolist() == pytest.approx([20.5e-4, 75.5e-4])

    def test_a_cuboid_that_was_replaced_as_a_whole_counts_for_nothing(self):
        assert column((30, 50), (0, 80)).cuboids().count.tolist() == [80.0]


class TestMsnlist:
    """III.B: each cuboid names the part maps it is made of, in order."""

    def test_a_composite_names_its_part_maps_in_order_and_once(self):
        c = column((0, 90), (80, 120), (30, 60)).cuboids()
        assert c.cycles.tolist() == [0, 1, 2]
        assert c.cycle_offsets.tolist() == [0, 3]

    def test_a_long_window_names_each_of_its_part_maps(self):
        """More cycles than a machine word has bits: each has two slices of one pile."""
        settings = config(window_cycles=150, cell_size=0.002, cuboid_depth=0.0001)
        order = np.random.default_rng(0).permutation(300).reshape(150, 2)
        map_ = IntegrationMap(settings)
        for cycle, slices in enumerate(order.tolist()):
            points = [(0, 0, z) for k in slices for z in range(10 * k + 1, 10 * k + 11)]
            map_.add(part_of(points, cycle, settings))
        c = map_.cuboids()
        assert len(c) == 1
        assert c.cycles.tolist() == list(range(150))

    def test_separate_cuboids_name_their_own_part_maps(self):
        c = column((0, 10), (20, 30)).cuboids()
        assert c.cycles.tolist() == [0, 1]
        assert c.cycle_offsets.tolist() == [0, 1, 2]


# -- the window ---------------------------------------------------------------------------------


@pytest.mark.parametrize("window", [1, 2, 5, 10])
def test_part_maps_leave_the_map_after_exactly_n_cycles(window):
    settings = config(window_cycles=window)
    map_ = IntegrationMap(settings)
    floor = [(x, 0, 0) for x in range(0, 1000, 100)]
    for cycle in range(30):
        person = [(300, 0, z) for z in range(1000, 18_000, 100)] if 5 <= cycle <= 12 else []
        map_.add(part_of(floor + person, cycle, settings))
        is_there = bool((map_.cuboids().top > 0).any())
        # Last seen in cycle 12: absent from M_(12 + n), present in the one before.
        assert is_there == (5 <= cycle < 12 + window)


def test_moments_stay_exact_over_thousands_of_cycles():
    settings = config(window_cycles=3)
    rng = np.random.default_rng(0)
    map_ = IntegrationMap(settings)
    for cycle in range(3000):
        points = np.column_stack([rng.integers(0, 400, (6, 2)), 7000 + rng.integers(-200, 200, 6)])
        map_.add(part_of(points, cycle, settings))
    assert snapshot(map_) == snapshot(filled(settings, map_.parts))


def test_cycle_numbers_may_be_missing_from_the_window():
    settings = config(window_cycles=4)
    map_ = IntegrationMap(settings)
    for cycle in (0, 2, 7, 9):
        map_.add(part_of([(0, 0, 7000 + 400 * cycle)], cycle, settings))
    assert map_.cycles == [7, 9]
    assert map_.cuboids().cycles.tolist() == [7, 9]


def test_empty_part_maps_move_the_window_on():
    settings = config(window_cycles=2)
    map_ = filled(settings, [part_of([(0, 0, 7000)], 0, settings)])
    map_.add(part_of([], 1, settings))
    assert len(map_.cuboids()) == 1
    map_.add(part_of([], 2, settings))
    assert len(map_.cuboids()) == 0


def test_older_part_maps_and_other_cell_sizes_are_refused():
    settings = config()
    map_ = filled(settings, [part_of([], 3, settings)])
    with pytest.raises(ValueError, match="not newer"):
        map_.add(part_of([], 3, settings))
    with pytest.raises(ValueError, match="cells"):
        map_.add(part_of([], 4, config(cell_size=0.01)))
    with pytest.raises(KeyError):
        map_.remove(1)


def test_composites_of_one_part_map_are_its_cuboids():
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.integers(-900, 900, (300, 2)), rng.integers(-4000, 4000, 300)])
    settings = config()
    part = part_of(points, 0, settings)
    alone, together = part.cuboids(), filled(settings, [part]).cuboids()
    for name in ("ix", "iy", "bottom", "top", "count", "s", "S", "cycles", "cycle_offsets"):
        assert getattr(alone, name).tolist() == getattr(together, name).tolist()
    assert sum(len(found) for found in as_dict(part).values()) == len(together)


def test_part_maps_may_have_any_memory_layout_and_lifetime():
    # Kernels read part maps by their address: layout, copies and a dropped window change nothing.
    rng = np.random.default_rng(2)
    clouds = [
        np.column_stack([rng.integers(-300, 300, (80, 2)), rng.integers(-2000, 2000, 80)])
        for _ in range(4)
    ]
    parts = [part_of(points, cycle, config()) for cycle, points in enumerate(clouds)]
    odd = [
        replace(p, moments=np.asfortranarray(p.moments), bounds=np.asfortranarray(p.bounds))
        for p in parts
    ]
    one, other = filled(config(window_cycles=3), parts), filled(config(window_cycles=3), odd)
    del odd
    assert snapshot(one) == snapshot(other)
    other.remove(2)
    one.remove(2)
    assert snapshot(one) == snapshot(other)
