"""Part maps: exact unions whatever the order, against a brute force on Python integers."""

import itertools

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from interval_oracle import moments_of, part_cuboids
from tccm_rig import (
    HEIGHT,
    as_dict,
    config,
    exactly,
    floor_ranges,
    laser_pose,
    make_scan,
    part_of,
    posed,
    rotation_y,
)

from tccm_ros.cuboids.cuboids import cell_keys, key_cells
from tccm_ros.cuboids.intrinsics import lowest_bit
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.cuboids.union import DIGITS, gather_points, mark_cells, merge_intervals, sort_cells
from tccm_ros.errors import ConfigError
from tccm_ros.geometry import interpolate_poses, transform

FEW = 32  # points of a cell that are sorted by insertion

CELL, DEPTH = 200, 300

coordinate = st.one_of(
    st.integers(-3, 3).map(lambda k: k * CELL),  # cell borders
    st.integers(-500, 500),
)
height = st.one_of(
    st.integers(-4, 4).map(lambda k: k * DEPTH),  # touching intervals
    st.integers(-1500, 1500),
    st.sampled_from([-DEPTH - 1, DEPTH + 1, 2 * DEPTH + 1]),
)
points_lists = st.lists(st.tuples(coordinate, coordinate, height), max_size=40)


@exactly
@given(points_lists)
@example([(0, 0, 0), (0, 0, DEPTH)])  # touching: one cuboid
@example([(0, 0, 0), (0, 0, DEPTH + 1)])  # with a tick between: two
@example([(0, 0, -5)] * 3)  # equal, negative
@example([(-1, -1, 0), (0, 0, 0), (CELL - 1, CELL, 0)])  # cell borders
def test_part_map_of_random_points_equals_brute_force(points):
    part = part_of(points, 0, config())
    assert as_dict(part) == part_cuboids(points, CELL, DEPTH)


@exactly
@given(points_lists, st.randoms(use_true_random=False))
def test_the_part_map_does_not_depend_on_the_order_of_points(points, random):
    shuffled = list(points)
    random.shuffle(shuffled)
    one, other = part_of(points, 0, config()), part_of(shuffled, 0, config())
    for name in ("keys", "bounds", "moments"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


@pytest.mark.parametrize("count", [5, 11, 12, 13, 14, 60, 400])
@pytest.mark.parametrize("order", ["rising", "falling", "random"])
def test_cells_with_many_points_in_any_order_equal_brute_force(count, order):
    rng = np.random.default_rng(count)
    z = np.sort(rng.integers(-40_000, 40_000, count))
    z = {"rising": z, "falling": z[::-1], "random": rng.permutation(z)}[order]
    points = [(int(x), int(y), int(h)) for x, y, h in zip(z % CELL, (z * 7) % CELL, z, strict=True)]
    assert as_dict(part_of(points, 0, config())) == part_cuboids(points, CELL, DEPTH)


@pytest.mark.parametrize("top", [1, 255, 256, 300_000, 2**29])
def test_heights_of_any_span_are_sorted(top):
    # One to four digits of the radix sort.
    rng = np.random.default_rng(0)
    z = rng.integers(-top, top, 50)
    points = [(1, 2, int(h)) for h in z]
    part = part_of(points, 0, config(cuboid_depth=0.0002))
    assert as_dict(part) == part_cuboids(points, CELL, 2)


@pytest.mark.parametrize("offset", [(0, 0), (-700_000_000, 650_000_000), (2**29, -(2**29))])
def test_huge_offsets_keep_moments_exact(offset):
    # 70 km from the origin, cells and moments are those of the same points at the origin.
    points = [(5, 190, 7000), (10, 20, 7050), (199, 0, 6400), (-1, -200, 7000)]
    base = [(x + offset[0] // CELL * CELL, y + offset[1] // CELL * CELL, z) for x, y, z in points]
    part = part_of(base, 0, config())
    assert as_dict(part) == part_cuboids(base, CELL, DEPTH)


@exactly
@given(
    st.lists(st.tuples(st.integers(0, 2), st.integers(-400, 400), st.integers(1, 300)), min_size=1)
)
def test_points_of_different_depths_equal_brute_force(points):
    # As with the adaptive gap: the interval of a deep point may contain others.
    cells = sorted({cell for cell, _, _ in points})
    counts = [sum(p[0] == cell for p in points) for cell in cells]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    assert found_cuboids(points, np.array(cells), starts) == merged_intervals(points)


@pytest.mark.parametrize("span", [0, 3, 300, 70_000, 20_000_000])
@pytest.mark.parametrize("n", [FEW - 1, FEW + 1, 700])
def test_points_of_a_cell_are_stably_sorted_by_height(span, n):
    rng = np.random.default_rng(span)
    z, other = rng.integers(-span, span + 1, n), np.arange(n)
    points = np.column_stack([(z << 32) | rng.integers(0, 1 << 20, n), other])
    expected = points[np.argsort(z, kind="stable")]
    scratch = np.zeros(n, np.uint64), np.zeros(n, np.uint64), np.zeros(DIGITS, np.int64)
    sort_cells(points.reshape(-1), np.array([0, n], np.int32), 1, scratch)
    np.testing.assert_array_equal(points, expected)


def found_cuboids(points, cells, starts):
    """Return [(cell, bottom, top)] of points (cell, z, depth) by the kernels."""
    n, n_cells = len(points), len(cells)
    address = {int(cell): k for k, cell in enumerate(cells)}
    records = [w for c, z, d in points for w in (z << 32, (d << 32) | address[c])]
    points_out, begins = np.zeros(2 * n, np.int64), np.zeros(n + 1, np.int8)
    counts, addresses = starts[:-1].copy(), np.arange(n_cells, dtype=np.int32)
    scratch = np.zeros(n, np.uint64), np.zeros(n, np.uint64), np.zeros(DIGITS, np.int64)
    keys, bounds, _ = found = (
        np.zeros(n, np.int64), np.zeros(2 * n, np.int32), np.zeros(n, np.int32)
    )  # fmt: skip
    gather_points(np.array(records), np.array([n], np.int32), counts, points_out)
    sort_cells(points_out, starts, n_cells, scratch)
    mark_cells(starts, n_cells, addresses, counts, begins)
    k = merge_intervals(points_out, n, begins, cells.astype(np.int64), n_cells, found)
    assert not counts.any()
    for first, last in itertools.pairwise(starts):
        assert (np.diff(points_out[2 * first : 2 * last : 2]) >= 0).all()
    rows = bounds.reshape(-1, 2)[k:].tolist()
    return [(c, b, t) for c, (b, t) in zip(keys[k:].tolist(), rows, strict=True)]


def merged_intervals(points):
    """Return the same by sets of unit steps: touching intervals share a step of half a tick."""
    result = []
    for cell in sorted({c for c, _, _ in points}):
        steps = {h for c, z, d in points if c == cell for h in range(2 * (z - d), 2 * z + 1)}
        bottoms = sorted(h for h in steps if h - 1 not in steps)
        tops = sorted(h for h in steps if h + 1 not in steps)
        result += [(cell, b // 2, t // 2) for b, t in zip(bottoms, tops, strict=True)]
    return result


@given(st.integers(1, 2**64 - 1))
def test_lowest_bit_is_the_index_of_the_lowest_set_bit(word):
    assert lowest_bit(np.uint64(word)) == (word & -word).bit_length() - 1


def test_cell_keys_round_trip_and_sort_like_their_cells():
    ix = np.array([-(2**31), -1, 0, 2**31 - 1, 5, 5])
    iy = np.array([2**31 - 1, -(2**31), -1, 0, -7, 7])
    keys = cell_keys(ix, iy)
    assert [a.tolist() for a in key_cells(keys)] == [ix.tolist(), iy.tolist()]
    order = np.lexsort([iy, ix])
    assert (np.diff(keys[order]) > 0).all()


def test_points_are_rounded_to_ticks_and_not_truncated():
    builder = PartMapBuilder(config())
    builder.add_points(np.array([[0.00006, -0.00004, 0.70006], [0.00004, -0.00006, 0.69994]]))
    part = builder.close(0, 0, 1)
    ticks = np.rint(part.positions() * 1e4).astype(int).tolist()
    assert sorted(ticks) == sorted([[1, 0, 7001], [0, -1, 6999]])


def test_points_belong_to_their_cuboids():
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.integers(-900, 900, (500, 2)), rng.integers(-4000, 4000, 500)])
    part = part_of(points, 0, config())
    cuboid = part.point_cuboids()
    xyz = np.rint(part.positions() * 1e4).astype(int)
    assert sorted(map(tuple, xyz.tolist())) == sorted(map(tuple, points.tolist()))
    for index in range(len(part)):
        ix, iy = key_cells(part.keys[index : index + 1])
        inside = xyz[cuboid == index] - [ix[0] * CELL, iy[0] * CELL, 0]
        assert tuple(part.moments[index].tolist()) == moments_of(inside.tolist())
        assert inside[:, 2].max() == part.bounds[index, 1]
        assert inside[:, 2].min() - DEPTH == part.bounds[index, 0]


def test_points_that_are_not_numbers_are_left_out():
    builder = PartMapBuilder(config())
    builder.add_points(np.array([[np.nan, 0, 0], [0, 0, 0.5], [0, np.inf, 1.0]]))
    assert builder.close(0, 0, 1).moments[:, 0].tolist() == [1]


def test_a_cell_size_that_is_no_multiple_of_a_tick_is_refused():
    with pytest.raises(ConfigError, match="cell_size"):
        PartMapBuilder(config(cell_size=0.02005 + 1e-6))


# -- from scans ---------------------------------------------------------------------------------


def add_cycle(builder, angles, z=0.0, time_increment=0.0, step=0.0, x_wall=3.0, **pose):
    """Add scans of the floor and a wall; return the true points (N, 3)."""
    truth = []
    bearings = -1.0 + 0.02 * np.arange(101)
    for k, angle in enumerate(angles):
        at = angle + step * np.arange(101) / 100.0
        ranges = np.array(
            [floor_ranges(b, a, z, x_wall) for b, a in zip(bearings, at, strict=True)]
        )
        scan = make_scan(k * 28_000_000, ranges, time_increment=time_increment)
        valid = np.isfinite(ranges) & (ranges < 10)
        builder.add(posed(scan, angle, angle_end=angle + step, **pose), valid)
        for i in np.flatnonzero(valid):
            direction = [np.cos(bearings[i]), np.sin(bearings[i]), 0.0, 0.0]
            truth.append((laser_pose(at[i]) @ direction)[:3] * ranges[i] + [0, 0, HEIGHT])
    return np.array(truth)


def test_beams_are_binned_in_the_cells_that_they_hit():
    builder = PartMapBuilder(config())
    truth = add_cycle(builder, np.linspace(0.3, 1.0, 12))
    part = builder.close(0, 0, 1)
    found = part.positions()
    order = np.lexsort(np.rint(found * 1e3).T)
    expected = np.lexsort(np.rint(truth * 1e3).T)
    # Rounding to ticks, and float32 ranges: less than 0.1 mm.
    assert np.abs(np.sort(found[order], 0) - np.sort(truth[expected], 0)).max() < 1e-4
    on_floor = np.abs(truth[:, 2]) < 1e-9
    assert np.abs(found[:, 2]).min() == 0.0
    assert (np.abs(found[:, 2]) <= 1e-4).sum() == on_floor.sum()


def test_each_beam_is_projected_with_the_tilt_of_its_own_time():
    # The joint moves 1.1 deg within a scan: with one angle for the scan the floor would be 20 mm
    # off; interpolated per beam it is flat within a tick.
    builder = PartMapBuilder(config())
    add_cycle(builder, np.linspace(0.5, 1.0, 12), time_increment=0.0002, step=0.02)
    z = builder.close(0, 0, 1).positions()[:, 2]
    assert np.abs(z[z < 0.2]).max() < 2e-4


@pytest.mark.parametrize("rotation", [0.0, 0.02, 0.1])
def test_projection_with_a_moving_base_equals_interpolated_poses(rotation):
    # Twin: every beam with scipy's interpolation of its own pose.
    scan = make_scan(10_000, np.linspace(1.0, 4.0, 101), time_increment=0.0003)
    T0, T1 = rotation_y(0.02), rotation_y(0.02 + rotation)
    T0[:3, 3], T1[:3, 3] = [3.0, -2.0, 0.01], [3.03, -2.02, 0.0]
    whole = posed(scan, 0.4, T0, 0.4 + rotation, T1)
    builder = PartMapBuilder(config())
    builder.add(whole, np.ones(101, bool))
    found = builder.close(0, 0, 1).positions()
    f = np.arange(101) / 100.0
    T = interpolate_poses(T0, T1, f) @ interpolate_poses(
        laser_pose(0.4), laser_pose(0.4 + rotation), f
    )
    b = -1.0 + 0.02 * np.arange(101)
    local = scan.ranges[:, None] * np.column_stack([np.cos(b), np.sin(b), 0 * b])
    truth = transform(T, local[:, None, :])[:, 0]
    gap = np.linalg.norm(found[:, None] - truth[None], axis=2).min(axis=1)
    # Half a tick per axis, and the sagitta of the path of the laser, 1.52 m above the base.
    assert gap.max() < 1e-4 + rotation**2 / 8 * 1.52


def test_beams_outside_the_span_are_left_out():
    scan = make_scan(0, np.full(101, 2.0))
    builder = PartMapBuilder(config())
    builder.add(posed(scan, 0.5), np.ones(101, bool), 20, 33)
    assert builder.points == 13
    builder.add(posed(scan, 0.5), np.arange(101) % 2 == 0)
    assert builder.close(0, 0, 1).moments[:, 0].sum() == 13 + 51


def test_with_the_adaptive_gap_the_cuboids_of_a_far_wall_are_connected():
    # Scan lines at steps of 26 mrad hit a wall at 3 m every 8 cm: d0 = 3 cm divides it.
    whole, shattered = PartMapBuilder(config(gap="adaptive")), PartMapBuilder(config())
    angles = np.linspace(0.0, 0.42, 17)
    for builder in (whole, shattered):
        add_cycle(builder, angles, x_wall=3.01)
    # The beam straight ahead stays in one column of cells, whatever the tilt.
    ahead = [as_dict(b.close(0, 0, 1))[150, 0] for b in (whole, shattered)]
    assert [len(cuboids) for cuboids in ahead] == [1, 17]


def test_adaptive_gap_is_capped_and_never_below_the_depth():
    builder = PartMapBuilder(config(gap="adaptive", max_depth=0.1))
    builder.add(posed(make_scan(0, [0.5, 3.0, 20.0], increment=0.02), 0.5), np.ones(3, bool))
    part = builder.close(0, 0, 1)
    # range x 0.02 rad x 1.5: 1.5 cm, 9 cm and 60 cm.
    depth = sorted((part.bounds[:, 1] - part.bounds[:, 0]).tolist())
    assert depth == [300, 900, 1000]


def test_region_in_base_follows_the_robot():
    settings = config(region=(0.5, 1.5, -0.4, 0.4, -0.1, 0.5), region_frame="base")
    for x, yaw in ((0.0, 0.0), (25.0, 1.3)):
        T = np.eye(4)
        c, s = np.cos(yaw), np.sin(yaw)
        T[:2, :2], T[0, 3] = [[c, -s], [s, c]], x
        builder = PartMapBuilder(settings)
        add_cycle(builder, np.linspace(0.5, 1.0, 12), T_odom_base=T)
        found = transform(np.linalg.inv(T), builder.close(0, 0, 1).positions())
        assert len(found) > 100
        assert found[:, 0].min() >= 0.4999
        assert found[:, 0].max() <= 1.5001
        assert np.abs(found[:, 1]).max() <= 0.4001


def test_region_in_odom_does_not_move_with_the_robot():
    settings = config(region=(0.5, 1.5, -0.4, 0.4, -0.1, 0.5), region_frame="odom")
    T = np.eye(4)
    T[0, 3] = 25.0
    builder = PartMapBuilder(settings)
    add_cycle(builder, [0.6, 0.7], T_odom_base=T)
    assert builder.points == 0


def test_tiles_grow_and_are_reused_in_the_next_cycle():
    # 40 m of floor in tiles of 1.28 m, far from where the next add_cycle is.
    builder = PartMapBuilder(config())
    rng = np.random.default_rng(1)
    for cycle, origin in enumerate([0.0, 500.0, -300.0]):
        points = rng.uniform(-20, 20, (4000, 3)) * [1, 1, 0.01] + [origin, -origin, 0]
        for chunk in np.array_split(points, 7):
            builder.add_points(chunk)
        ticks = np.floor(points * 1e4 + 0.5).astype(int)
        assert as_dict(builder.close(cycle, 0, 1)) == part_cuboids(
            [tuple(p) for p in ticks.tolist()], CELL, DEPTH
        )


def test_clear_drops_the_scans_of_the_open_cycle():
    builder = PartMapBuilder(config())
    builder.add_points(np.random.default_rng(0).uniform(-1, 1, (100, 3)))
    builder.clear()
    builder.add_points(np.array([[0.0, 0.0, 0.7]]))
    assert as_dict(builder.close(0, 0, 1)) == part_cuboids([(0, 0, 7000)], CELL, DEPTH)


def test_seen_times_of_cuboids_are_the_stamps_of_their_scans():
    builder = PartMapBuilder(config())
    builder.add_points(np.array([[0.001, 0.0, 0.7], [1.0, 0.0, 0.7]]), 100)
    builder.add_points(np.array([[0.002, 0.0, 0.7]]), 200)
    builder.add_points(np.array([[0.003, 0.0, 0.7]]), 300)
    part = builder.close(0, 100, 300)
    assert part.seen_ns.tolist() == [[100, 300], [100, 100]]


# -- Eq. (1) as printed -------------------------------------------------------------------------


def heights(zs, **settings):
    part = part_of([(0, 0, z) for z in zs], 0, config(mode="paper", **settings))
    return part.bounds.tolist(), part.moments[:, 0].tolist()


def test_equation_1_as_printed_overextends_cuboids():
    # A point inside grows the cuboid by (u - z) although nothing new is covered.
    assert heights([1000, 900]) == ([[1000 - 300 - 100, 1000]], [2])
    assert heights([1000, 1200]) == ([[700, 1200]], [2])
    assert heights([1000, 2000]) == ([[700, 1000], [1700, 2000]], [1, 1])


def test_equation_1_as_printed_depends_on_the_order_of_points():
    # 1000 then 700, then 900: each is near; from below upwards the printed rule grows otherwise.
    assert heights([1000, 700, 900]) != heights([700, 900, 1000])


def test_equation_1_as_printed_keeps_all_points():
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.integers(0, 900, (400, 2)), rng.integers(-3000, 3000, 400)])
    part = part_of(points, 0, config(mode="paper"))
    assert part.moments[:, 0].sum() == 400
    for intervals in as_dict(part).values():
        for (_, top, _), (bottom, _, _) in itertools.pairwise(intervals):
            assert top < bottom
