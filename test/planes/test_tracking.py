"""The identity of planes over cycles."""

import numpy as np
import pytest
from plane_rig import EYE, part_map, room, scan, table

from tccm_ros.config import Config
from tccm_ros.planes import find_planes
from tccm_ros.planes.tracking import PlaneTracker

CONFIG = Config()


def update(tracker, patches, seed=0, eye=EYE):
    points, _ = scan(patches, 0.0025, seed, eye=eye)
    return tracker.update(find_planes(part_map(points), CONFIG, eye))


def top_of(records, height=0.7):
    found = [r for r in records if r.kind == "horizontal" and abs(r.centroid[2] - height) < 0.01]
    return max(found, key=lambda r: r.support) if found else None


def test_ids_stay_over_cycles():
    tracker = PlaneTracker(CONFIG)
    ids = [top_of(update(tracker, room() + table(), seed)).id for seed in range(5)]
    assert len(set(ids)) == 1


def test_ids_are_unique_in_a_cycle():
    records = update(PlaneTracker(CONFIG), room() + table())
    assert len({r.id for r in records}) == len(records)


def test_ids_stay_while_the_robot_moves():
    tracker = PlaneTracker(CONFIG)
    ids = set()
    for step in range(6):
        eye = EYE + np.array([0.05, 0.1, 0.0]) * step
        ids.add(top_of(update(tracker, room() + table((0.8, 1.5)), step, eye)).id)
    assert len(ids) == 1


def test_the_record_of_a_moved_table_is_updated():
    tracker = PlaneTracker(CONFIG)
    before = top_of(update(tracker, room() + table(y=(-0.5, 0.5))))
    after = top_of(update(tracker, room() + table(y=(-0.35, 0.65)), 1))
    assert after.id == before.id
    assert after.centroid[1] - before.centroid[1] == pytest.approx(0.15, abs=0.03)


def test_a_plane_that_is_gone_is_dropped_and_forgotten():
    tracker = PlaneTracker(CONFIG)
    first = top_of(update(tracker, room() + table()))
    assert top_of(update(tracker, room())) is None
    hidden = top_of(update(tracker, room() + table()))
    assert hidden.id == first.id
    for _ in range(CONFIG.planes.track_cycles + 1):
        update(tracker, room())
    assert top_of(update(tracker, room() + table())).id != first.id


def test_two_boards_above_each_other_keep_their_ids():
    tracker = PlaneTracker(CONFIG)
    shelf = [*room(), *table((0.6, 0.9), top=0.5), *table((0.9, 1.3), top=0.8, name="upper")]
    ids = []
    for seed in range(3):
        records = update(tracker, shelf, seed)
        ids.append((top_of(records, 0.5).id, top_of(records, 0.8).id))
    assert len(set(ids)) == 1
    assert ids[0][0] != ids[0][1]


def test_records_have_the_values_of_the_fits():
    points, _ = scan(room() + table(), 0.0025, 0)
    fits = find_planes(part_map(points), CONFIG, EYE)
    for fit, record in zip(fits, PlaneTracker(CONFIG).update(fits), strict=True):
        assert record.covariance.shape == (3, 3)
        assert np.all(np.linalg.eigvalsh(record.covariance) > 0)
        assert (record.support, record.kind, record.rms) == (fit.support, fit.kind, fit.rms)
        assert record.area == pytest.approx(fit.area)
        assert record.quality > 0
