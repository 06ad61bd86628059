"""Questions to the map, against brute force and by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tccm_rig import config, exactly, part_of

from tccm_ros.cuboids.free_columns import NEVER, FreeSpace
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.queries import MapQuery, Occupancy
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import ViewIntervals

CELL, DEPTH = 200, 300
FREE, OCCUPIED, UNKNOWN = Occupancy.FREE, Occupancy.OCCUPIED, Occupancy.UNKNOWN


def map_of(*clouds, **settings):
    configuration = config(**settings)
    map_ = IntegrationMap(configuration)
    for cycle, points in enumerate(clouds):
        map_.add(part_of(points, cycle, configuration))
    return map_


def view(stamp_ns, rows):
    return ViewIntervals(stamp_ns, "base", np.array(rows, np.float32).reshape(-1, 4))


cloud = st.lists(
    st.tuples(st.integers(-400, 400), st.integers(-400, 400), st.integers(-900, 900)), max_size=15
)


@exactly
@given(cloud, cloud)
def test_occupancy_of_points_equals_brute_force(points, asked):
    query = MapQuery(map_of(points))
    found = query.points(np.array(asked, float).reshape(-1, 3) * 1e-4)
    for (x, y, z), state in zip(asked, found.tolist(), strict=True):
        covered = any(
            p[0] // CELL == x // CELL and p[1] // CELL == y // CELL and p[2] - DEPTH <= z <= p[2]
            for p in points
        )
        assert state == (OCCUPIED if covered else UNKNOWN)


box = st.tuples(
    st.integers(-500, 500), st.integers(0, 400), st.integers(-500, 500), st.integers(0, 400),
    st.integers(-900, 900), st.integers(0, 900),
)  # fmt: skip


@exactly
@given(cloud, st.lists(box, max_size=6))
def test_occupancy_of_boxes_equals_brute_force(points, boxes):
    query = MapQuery(map_of(points))
    bounds = [(x, x + dx, y, y + dy, z, z + dz) for x, dx, y, dy, z, dz in boxes]
    found = query.boxes(np.array(bounds, float).reshape(-1, 6) * 1e-4)
    for (x0, x1, y0, y1, z0, z1), state in zip(bounds, found.tolist(), strict=True):
        touched = any(
            x0 // CELL <= p[0] // CELL <= x1 // CELL
            and y0 // CELL <= p[1] // CELL <= y1 // CELL
            and p[2] >= z0
            and p[2] - DEPTH <= z1
            for p in points
        )
        assert state == (OCCUPIED if touched else UNKNOWN)


def test_points_that_beams_passed_are_free_unless_occupied():
    settings = config(window_cycles=2)
    free = FreeSpace(settings)
    T = pose_from_rpy([2.0, 1.0, 0.0, 0.0, 0.0, np.pi / 2])
    free.add(0, T, view(77, [[0.55, 0.05, 0.2, 1.0], [0.55, 0.05, 1.2, 1.5], [0.65, 0.05, 0, 1]]))
    query = MapQuery(map_of([(19_600, 15_600, 7000)]), free)
    # The column (0.55, 0.05) in base is at (2 - 0.05, 1 + 0.55) in the map's frame.
    asked = [[1.95, 1.55, 0.5], [1.95, 1.55, 1.1], [1.95, 1.55, 1.3], [1.961, 1.561, 0.69]]
    assert query.points(asked).tolist() == [FREE, UNKNOWN, FREE, OCCUPIED]
    assert query.boxes([[1.91, 1.94, 1.51, 1.64, 0.3, 0.9]]).tolist() == [FREE]
    assert query.boxes([[1.91, 1.94, 1.51, 1.64, 0.1, 0.9]]).tolist() == [UNKNOWN]
    assert query.boxes([[1.91, 1.99, 1.51, 1.59, 0.3, 0.9]]).tolist() == [OCCUPIED]
    assert query.last_seen(asked).tolist() == [77, NEVER, 77, 77]


def test_free_space_is_forgotten_when_its_cycle_leaves_the_window():
    free = FreeSpace(config(window_cycles=2))
    point = np.array([[0.55, 0.05, 0.5]])
    free.add(3, np.eye(4), view(30, [[0.55, 0.05, 0.0, 1.0]]))
    free.add(4, np.eye(4), view(40, []))
    assert free.last_seen(point).tolist() == [30]
    free.add(5, np.eye(4), view(50, []))
    assert free.last_seen(point).tolist() == [NEVER]


def test_trace_returns_the_measuring_cycles_and_their_times():
    map_ = map_of([(0, 0, 7000)], [(0, 0, 7100), (900, 0, 7000)], [(0, 0, 1000)])
    query = MapQuery(map_)
    found = query.trace([0.005, 0.005, 0.69])
    assert [(m.cycle, m.start_ns, m.end_ns, m.points) for m in found] == [
        (0, 0, 9, 1),
        (1, 10, 19, 1),
    ]
    assert query.trace([0.5, 0.5, 0.5]) == []
    assert query.last_seen([[0.005, 0.005, 0.69], [0.5, 0.5, 0.5]]).tolist() == [19, NEVER]


@pytest.mark.parametrize("points", [[], [(0, 0, 0)]])
def test_queries_to_an_empty_map_return_nothing(points):
    query = MapQuery(map_of(points, [], window_cycles=1))
    assert query.points([[0, 0, 0]]).tolist() == [UNKNOWN]
    assert query.boxes([[0, 1, 0, 1, 0, 1]]).tolist() == [UNKNOWN]
    assert query.trace([0, 0, 0]) == []


def test_columns_hold_the_intervals_of_all_cuboids():
    # Twin: a dictionary of cells.
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.integers(-300, 300, (200, 2)), rng.integers(-3000, 3000, 200)])
    cuboids = part_of(points, 0, config()).cuboids()
    cells = {}
    for x, y, *span in zip(cuboids.ix, cuboids.iy, cuboids.bottom, cuboids.top, strict=True):
        cells.setdefault((int(x), int(y)), []).append([int(v) for v in span])
    columns = cuboids.columns()
    found = {
        key: columns.spans[a:b].tolist()
        for key, a, b in zip(columns.keys.tolist(), columns.first, columns.first[1:], strict=False)
    }
    assert found == {(x << 32) + y: spans for (x, y), spans in sorted(cells.items())}
    assert list(found) == sorted(found)
    assert columns.nbytes == 12 * len(cells) + 4 + 8 * len(cuboids)
    assert part_of([], 0, config()).cuboids().columns().first.tolist() == [0]
