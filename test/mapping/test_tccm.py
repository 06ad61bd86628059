"""The TCCM processor on a ray-cast room: planes, surface message, forgetting, arrival order."""

import itertools
import random
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fed import Fed, fed_tccm
from mapped_room import BOX, FLOOR, HALF_TIME, TABLE, WALL, base_at, ns, record, settings
from message_families import family

from tccm_ros.cuboids.queries import Occupancy
from tccm_ros.geometry import inverse, transform
from tccm_ros.mapping.tccm import DETECTORS, TccmProcessor
from tccm_ros.records import JointSample, Odometry, PlaneKind, Posed, Scan
from tccm_ros.ros.marker_parts import MessageContext
from tccm_ros.ros.markers import plane_markers

HITS_CUBE = 0.04  # m, edge of the cubes with one row of hits each
HITS_DISTANCE = 0.4  # m, horizontal distance from a surface: an open door of a cupboard
HITS_FROM = 0.15  # m, lowest hit above the floor

SMALL = {"map": {"window_cycles": 3}}

FRONT = [1.17, 1.23, -0.05, 0.05, 0.75, 0.85]
"""Around the front face of the box on the table."""


@cache
def room(seconds=4.2, drive=(0.0, 0.0)):
    return record(seconds, lambda t: (FLOOR, WALL, TABLE, BOX), drive, noise=0.002)


@cache
def visitor():
    """A table that a box leaves after the second cycle."""

    def boxes(t):
        return (FLOOR, WALL, TABLE, BOX) if t < 2 * HALF_TIME else (FLOOR, WALL, TABLE)

    return record(7 * HALF_TIME, boxes, noise=0.001)


def run(records, configuration=None, **options):
    fed = fed_tccm(configuration or settings(), **options)
    results = [r for item in records for r in fed.add(item)]
    return fed, results + fed.finish()


def everything(result):
    """Return all that a result says, as bytes and numbers."""
    arrays = (
        result.surfaces.points, result.surfaces.surface, result.view.intervals, result.part.keys,
        result.part.bounds, result.part.moments, result.part.seen_ns, result.T_odom_base,
    )  # fmt: skip
    planes = [(p.id, p.kind, p.offset, p.support, p.boundary.tobytes()) for p in result.planes]
    return (
        [a.tobytes() for a in arrays], planes, result.cycle, result.stamp_ns, result.scans,
        [(o.id, o.center.tobytes()) for o in result.objects],
    )  # fmt: skip


def test_the_table_and_the_floor_are_found():
    fed, results = run(room())
    assert [r.cycle for r in results] == [0, 1, 2]
    assert [r.ended_by for r in results] == ["turn"] * 3
    for result in results:
        heights = {round(float(p.centroid[2]), 2) for p in result.planes if p.kind == "horizontal"}
        assert {0.0, 0.7} <= heights
    table = next(p for p in results[-1].planes if abs(p.centroid[2] - 0.7) < 0.02)
    # Range noise 2 mm, some hundreds of points on the plane: far below a millimetre.
    assert float(table.centroid[2]) == pytest.approx(0.7, abs=0.001)
    # The table is 0.96 m2; the box on it hides its own footprint and what is behind it.
    assert 0.6 < table.area < 0.97
    assert fed.processor.counts["cycles"] == 3
    assert fed.processor.counts["scans used"] + sum(fed.dropped.values()) >= 150


def test_a_result_is_one_tilt_cycle_and_is_stamped_in_its_middle():
    _, results = run(room())
    for k, result in enumerate(results):
        assert result.start_ns == pytest.approx(ns(k * HALF_TIME), abs=30e6)
        assert result.stamp_ns == (result.start_ns + result.end_ns) // 2
        assert result.surfaces.stamp_ns == result.view.stamp_ns == result.stamp_ns
        assert result.surfaces.frame_id == result.base_frame_id == "base"
        assert result.frame_id == "odom"
        assert result.surfaces.points.dtype == result.view.intervals.dtype == np.float32


def test_scans_are_split_at_reversals_and_each_beam_is_used_once():
    records = room()
    _, results = run(records)
    beams = sum(int(r.part.moments[:, 0].sum()) for r in results)
    hits = sum(int(np.isfinite(r.ranges).sum()) for r in records if isinstance(r, Scan))
    # All but mixed pixels.
    assert 0.95 * hits < beams <= hits
    for one, other in itertools.pairwise(results):
        assert one.end_ns < other.start_ns
        assert other.start_ns - one.end_ns < 10e6


@pytest.mark.parametrize("drive", [(0.0, 0.0), (0.3, 0.0), (0.25, 0.3)])
def test_the_surface_message_is_in_the_base_frame_at_its_stamp(drive):
    _, results = run(room(3.0, drive))
    for result in results[:2]:
        x, y, yaw = base_at((result.stamp_ns - ns(0)) * 1e-9, drive)
        T = result.T_odom_base
        assert T[:2, 3] == pytest.approx([x, y], abs=1e-3)
        assert np.arctan2(T[1, 0], T[0, 0]) == pytest.approx(yaw, abs=1e-3)
        points = transform(T, result.surfaces.points)
        on_table = np.abs(points[:, 2] - 0.7) < 0.05
        assert on_table.sum() > 100
        # On the true table, although the robot drove a third of a metre meanwhile.
        assert points[on_table, 0].min() > TABLE[0] - 0.02
        assert points[on_table, 0].max() < TABLE[1] + 0.02
        assert np.abs(points[on_table, 1]).max() < TABLE[3] + 0.02
        assert points[on_table, 2].std() < 0.004
        # The odometry drives 0.1 mm per sample: the speed is right within the window's jitter.
        assert result.base_speed == pytest.approx(drive[0], abs=0.01)
        assert result.base_angular_speed == pytest.approx(drive[1], abs=0.01)
        assert result.is_still == (drive == (0.0, 0.0))


def test_the_surface_message_has_each_point_of_the_newest_tilt_cycle_once():
    _, results = run(room())
    for result in results:
        cloud = result.surfaces
        assert len(np.unique(cloud.points, axis=0)) == len(cloud.points)
        assert len(cloud.points) > 500
        assert set(cloud.surface.tolist()) == set(range(int(cloud.surface.max()) + 1))
        measured = transform(inverse(result.T_odom_base), result.part.positions())
        known = {p.tobytes() for p in measured.astype(np.float32)}
        assert all(p.tobytes() in known for p in cloud.points)
        for surface in np.unique(cloud.surface):
            assert cloud.points[cloud.surface == surface, 2].std() < 0.01


def test_a_block_ends_at_its_front():
    """Its last cells hold its front as well: their points are of the top none the less."""
    edge = 0.305
    block = (0.9, 1.9, edge, 1.2, 0.0, 0.7)
    records = record(3.0 * HALF_TIME, lambda t: (FLOOR, WALL, block), noise=0.002, every=1)
    kept: list[bool] = []
    for result in run(records)[1]:
        points = result.part.positions()
        top = result.surfaces.points[np.abs(result.surfaces.points[:, 2] - 0.7) < 0.02]
        assert top[:, 1].min() > edge - 0.01
        in_last_cells = (points[:, 1] < edge + 0.015) & (np.abs(points[:, 0] - 1.4) < 0.45)
        rows = points[in_last_cells & (np.abs(points[:, 2] - 0.7) < 0.002)]
        kept += (np.abs(rows[:, None] - top).max(axis=2).min(axis=1) < 1e-4).tolist()
    assert len(kept) > 20
    assert np.mean(kept) > 0.9


def test_views_are_only_of_tilt_cycles_at_rest_when_asked():
    still = settings(views={"when": "still"})
    _, results = run(room(3.0, (0.3, 0.0)), still)
    assert all(len(r.surfaces.points) == 0 and len(r.view.intervals) == 0 for r in results)
    _, results = run(room(3.0), still)
    assert all(len(r.surfaces.points) > 100 for r in results[:2])


def test_published_segmentation_takes_3d_scans_and_no_scan_lines():
    """A scan line is in a plane whatever it hits: as one on three walls, at 10 deg."""
    published = settings(
        planes={"horizontal_angle": 0.2},
        surfaces={"segmentation": "seed", "min_points": 60, "cluster_distance": 0.3},
    )
    sides = ((0.0, 9.0, 1.5, 9.0, 0.0, 3.0), (0.0, 9.0, -9.0, -1.5, 0.0, 3.0))
    records = record(1.5, lambda t: (FLOOR, WALL, *sides), noise=0.002)
    _, (whole, *_) = run(records, published)
    line = [r for r in records if not isinstance(r, Scan) or r.stamp_ns < ns(0.02)]
    _, (cycle, *_) = run(line, published)
    assert cycle.scans == 1
    assert len(whole.surfaces.points) > 1000
    assert len(cycle.surfaces.points) == 0


def test_removed_object_leaves_the_map_after_n_cycles():
    fed, there = fed_tccm(settings(**SMALL)), {}
    for item in visitor():
        for result in fed.add(item):
            box = fed.processor.query().boxes([FRONT])[0]
            there[result.cycle] = bool(box == Occupancy.OCCUPIED)
    # Last seen in cycle 1, window 3: absent from M_4.
    assert there == {0: True, 1: True, 2: True, 3: True, 4: False, 5: False}


def test_clearing_forgets_a_removed_object_at_once_and_keeps_the_table():
    cleared = settings(map={"window_cycles": 3, "clear_seen_through": True})
    fed, there = fed_tccm(cleared), {}
    for item in visitor():
        for result in fed.add(item):
            states = fed.processor.query().boxes([FRONT, [1.0, 1.1, -0.3, 0.3, 0.68, 0.70]])
            there[result.cycle] = tuple(states.tolist())
    assert [there[k][0] == Occupancy.OCCUPIED for k in range(6)] == [True, True] + [False] * 4
    assert all(table == 1 for _, table in there.values())
    # A rebuild replays the clearing.
    before = fed.processor.map.pieces.tobytes()
    assert any(len(part.void_keys) for part in fed.processor.map.parts)
    fed.processor.map.rebuild()
    assert fed.processor.map.pieces.tobytes() == before


def shuffled(records, max_delay_ns, seed):
    """Return the records by arrival: each topic in order, each topic late by its own jitter."""
    rng = random.Random(seed)
    newest, arrivals = {}, []
    for number, item in enumerate(records):
        kind = type(item)
        arrival = max(item.stamp_ns + rng.randrange(max_delay_ns), newest.get(kind, 0))
        newest[kind] = arrival
        arrivals.append((arrival, number, item))
    return [item for _, _, item in sorted(arrivals, key=lambda a: a[:2])]


@pytest.mark.parametrize("seed", range(3))
def test_result_is_independent_of_arrival_order(seed):
    _, expected = run(room())
    _, found = run(shuffled(room(), 200_000_000, seed))
    assert [everything(r) for r in found] == [everything(r) for r in expected]


@pytest.mark.parametrize("kind", [JointSample, Odometry])
def test_one_stamp_from_the_future_does_not_close_a_tilt_cycle(kind):
    _, expected = run(room())
    late = shuffled(room(), 200_000_000, 0)
    k = next(k for k, r in enumerate(late) if isinstance(r, kind) and r.stamp_ns > ns(1.0))
    wrong = replace(late[k], stamp_ns=late[k].stamp_ns + ns(3600.0))
    fed, found = run([*late[:k], wrong, *late[k:]])
    role = {JointSample: "joint_states", Odometry: "odom"}[kind]
    assert fed.robot.refused[f"{role}: future stamp"] == 1
    assert [everything(r) for r in found] == [everything(r) for r in expected]


def test_topics_that_arrive_one_after_the_other_give_the_same_results():
    # All joints and odometry first, then all scans: as far from live as it gets.
    _, expected = run(room())
    late = sorted(room(), key=lambda r: isinstance(r, Scan))
    _, found = run(late, settings(sync_timeout=20.0))
    assert [everything(r) for r in found] == [everything(r) for r in expected]


def test_a_result_comes_soon_after_the_laser_reverses():
    fed, waits_ns = fed_tccm(settings()), []
    for item in room():
        waits_ns += [item.stamp_ns - result.end_ns for result in fed.add(item)]
    assert len(waits_ns) == 2  # the third tilt cycle ends with the input
    # The next scan, its bracketing samples, and the dead band of the turn.
    assert max(waits_ns) < 0.12e9


def test_a_result_comes_although_no_scan_follows():
    turned = ns(1.5 * HALF_TIME)
    fed, came = fed_tccm(settings()), []
    for item in room():
        if isinstance(item, Scan) and item.stamp_ns > ns(HALF_TIME - 0.1):
            continue
        came += [(item.stamp_ns, r) for r in fed.add(item)]
        if item.stamp_ns > turned + 0.2e9:
            break
    (stamp_ns, result), = came  # fmt: skip
    assert result.cycle == 0
    # The timeout, and one scan.
    assert stamp_ns - ns(HALF_TIME) < 0.6e9


def test_a_jump_of_the_clock_begins_anew():
    fed = fed_tccm(settings())
    records = room()
    for item in records:
        fed.add(item)
    assert fed.processor.map.parts
    # The same run again, an hour earlier.
    again = [_moved(item, -3600 * 10**9) for item in records]
    results = [r for item in again for r in fed.add(item)] + fed.finish()
    assert fed.processor.counts["resets"] == 1
    assert [r.cycle for r in results] == [3, 4, 5]
    assert fed.processor.map.cycles == [3, 4, 5]


@pytest.mark.parametrize("forget", [TccmProcessor.clear_map, TccmProcessor.reset])
def test_ids_after_a_reset_are_new(forget):
    """The odometry frame may be another one: what is at an old position is not the same object."""
    fed, before = run(room())
    forget(fed.processor)
    again = Fed(fed.processor, "tilt_scan")
    after = [r for item in room() for r in again.add(item)] + again.finish()
    for found in ("planes", "objects"):
        old, new = ({x.id for r in each for x in getattr(r, found)} for each in (before, after))
        assert old
        assert new
        assert not old & new


def test_a_posed_record_of_a_stream_that_no_handler_maps_is_an_error():
    poses = np.eye(4)[None]
    processor = TccmProcessor(settings())
    unknown = Posed(record, np.array([0]), poses, poses, role="tilt_scan")
    with pytest.raises(TypeError, match="tilt_scan: no handler maps Posed records"):
        processor.add(unknown)
    assert processor.add(replace(unknown, role="sonar")) == []


def _moved(item, by_ns):
    if isinstance(item, Scan):
        fields = (item.frame_id, item.angle_min, item.angle_increment, item.time_increment)
        return Scan(item.stamp_ns + by_ns, *fields, item.range_min, item.range_max, item.ranges)
    if isinstance(item, JointSample):
        return JointSample(item.stamp_ns + by_ns, item.names, item.positions)
    return Odometry(item.stamp_ns + by_ns, item.frame_id, item.child_frame_id, item.T_odom_base)


def test_reset_begins_anew():
    fed, first = run(room())
    fed.processor.reset()
    assert fed.processor.map.parts == []
    again = Fed(fed.processor, "tilt_scan")
    second = [r for item in room() for r in again.add(item)] + again.finish()
    assert [r.part.moments.tobytes() for r in second] == [r.part.moments.tobytes() for r in first]


def test_scans_without_tilt_samples_are_counted():
    fed, results = run([r for r in room() if not isinstance(r, JointSample)])
    assert results == []
    assert sum(fed.dropped.values()) == sum(isinstance(r, Scan) for r in room())


def test_space_that_beams_passed_is_free_and_hidden_space_is_unknown():
    fed, _ = run(room())
    states = fed.processor.query().points([[0.7, 0.0, 0.6], [1.3, 0.0, 0.4], [3.5, 0.0, 1.0]])
    # Seen through; hidden under the table; behind the wall.
    assert states.tolist() == [Occupancy.FREE, Occupancy.UNKNOWN, Occupancy.UNKNOWN]


def test_view_intervals_contain_no_object_of_the_room():
    _, results = run(room())
    for result in results:
        rows = result.view.intervals
        assert len(rows) > 300
        x, y, low, high = rows.T
        assert (high > low).all()
        assert low.min() > -0.05
        # Nothing behind the wall, and nothing through the table top or the box.
        assert x.max() - 0.05 < WALL[0] + 0.01
        for solid in (TABLE, BOX):
            inside = (
                (x > solid[0] + 0.04) & (x < solid[1] - 0.04)
                & (y > solid[2] + 0.04) & (y < solid[3] - 0.04)
            )  # fmt: skip
            above = high > solid[5] + 0.02
            assert inside.any()
            assert low[inside & above].min() > solid[5] - 0.01


def test_hits_are_points_near_tops_and_none_of_the_floor():
    """Each is on the table, its box or the wall of the room, where the beams ended."""
    _, results = run(room())
    assert len(results) > 1
    for result in results:
        x, _, low, high = result.view.hits.astype(float).T
        assert len(x) > 100
        assert (low >= HITS_FROM - 1e-6).all()
        assert (high - low <= HITS_CUBE).all()
        assert np.hypot(x.clip(None, TABLE[0]) - TABLE[0], 0.0).max() < 2.0 * HITS_DISTANCE
        on_table = (low > TABLE[4] - 0.02) & (high < BOX[5] + 0.02) & (x < TABLE[1] + 0.02)
        on_wall = np.abs(x - WALL[0]) < 0.03
        assert (on_table | on_wall).all()


def test_hits_at_the_foot_of_a_face_are_on_the_face_or_on_the_top_below_it():
    """Cubes of hits hold points of both, of which the middle would be before the face."""
    top = 0.685  # less than a cube's height below the next multiple of it
    table, box = (*TABLE[:4], top - 0.04, top), (*BOX[:4], top, top + 0.2)
    _, results = run(record(4.2, lambda t: (FLOOR, WALL, table, box), noise=0.002))
    feet = np.concatenate([result.view.hits.astype(float) for result in results])
    x, y, low, high = feet.T
    is_front = (x < box[1]) & (np.abs(y) < box[3]) & (low < top + HITS_CUBE) & (high > top + 0.012)
    assert is_front.sum() > 10
    assert x[is_front] == pytest.approx(box[0], abs=4 * 0.002)


# -- the detectors of planes --------------------------------------------------------------------


def planes_with(detector, **groups):
    planes = {"detector": detector}
    _, results = run(room(1.5), settings(planes=planes, **groups))
    return results[0].planes


def test_the_setting_of_the_detector_chooses_how_planes_are_found():
    """The published detectors reach tracking and all that follows; each finds table and floor."""
    coarse = {"map": {"cell_size": 0.08}, "center_core": {"min_length": 0.02}}
    found = {name: planes_with(name, **coarse) for name in DETECTORS}
    assert list(found) == ["moments", "center_cores", "neighbours"]
    for name, planes in found.items():
        level = [plane for plane in planes if plane.normal[2] > 0.97]
        heights = np.array([plane.centroid[2] for plane in level])
        assert np.abs(heights - TABLE[5]).min() < 0.03, name
        assert np.abs(heights).min() < 0.03, name
    neighbours = found["neighbours"]
    assert all(plane.normal.tolist() == [0, 0, 1] for plane in neighbours), "as published"
    assert any(plane.kind == PlaneKind.ANY for plane in found["moments"])


@pytest.mark.parametrize("detector", ["center_cores", "neighbours"])
def test_planes_of_the_published_detectors_are_shown_as_markers(detector):
    planes = planes_with(detector, map={"cell_size": 0.08})
    context = MessageContext(family("typestore"), 1, "odom")
    shown = plane_markers(context, planes)
    assert {marker.id for marker in shown if marker.ns == "outline"} <= {p.id for p in planes}
    assert len(shown) >= len(planes) > 0


def test_a_reset_keeps_the_rule_of_cuboids():
    """Eq. (1) as printed, from the same records before and after a reset."""
    processor = TccmProcessor(settings(map={"mode": "paper"}))
    parts = []
    for _ in range(2):
        fed = Fed(processor, "tilt_scan")
        results = [r for item in room(1.5) for r in fed.add(item)] + fed.finish()
        parts.append(results[0].part.bounds.tobytes())
        processor.reset()
    assert parts[0] == parts[1]
