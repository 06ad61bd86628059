"""A simulated recording: a table moves, a stool goes, a crate comes, a person hides a cupboard."""

import json

import pytest
from shapely import Polygon

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.config import Config
from tccm_ros.records import Odometry
from tccm_ros.replay.processors import Pipeline
from tccm_sim.options import Options
from tccm_sim.recording import simulate

CHANGE_S = 12.0
"""Stamp, s from the start, at which the furniture has changed and was not seen again yet."""


def in_view(surface):
    return surface.label != "floor" and surface.area >= 0.1


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    bag = tmp_path_factory.mktemp("moved") / "bag"
    simulate("moved", bag, options=Options(people=True))
    with BagReader(bag) as reader:
        records = [(role, record) for role, _, record in reader.records(DEFAULT_TOPICS)]
    truth = json.loads((bag / "truth.json").read_text())
    return records, truth


def half_of(records):
    stamps = [r.stamp_ns for _, r in records if isinstance(r, Odometry)]
    before = stamps[0] + int(CHANGE_S * 1e9)
    return next(k for k, (_, r) in enumerate(records) if getattr(r, "stamp_ns", 0) > before)


@pytest.fixture(scope="module")
def solutions(recording):
    """The map before the change, and after it."""
    records, _ = recording
    half = half_of(records)
    pipeline = Pipeline(Config(), expects_odometry=True)
    for role, record in records[:half]:
        pipeline.add(role, record)
    before = pipeline.solve()
    for role, record in records[half:]:
        pipeline.add(role, record)
    pipeline.finish()
    return before, pipeline.solve()


def at(solution, entry):
    """Return the surfaces of the map that overlap a true one, at its height."""
    outline = Polygon([p[:2] for p in entry["boundary"]])
    return [
        s
        for s in solution.surfaces
        if abs(s.height - entry["height"]) < 0.03
        and Polygon(s.boundary[:, :2]).intersection(outline).area > 0.3 * outline.area
    ]


def test_the_map_shows_the_room_after_the_changes(recording, solutions):
    _, truth = recording
    _, after = solutions
    names = {entry["label"]: entry for entry in truth["surfaces"]}
    assert set(names) == {"moved table", "cupboard", "crate"}
    for entry in names.values():
        (surface,) = at(after, entry)
        outline = Polygon([p[:2] for p in entry["boundary"]])
        found = Polygon(surface.boundary[:, :2])
        assert found.intersection(outline).area / found.union(outline).area > 0.7
        assert surface.height == pytest.approx(entry["height"], abs=0.005)
    assert sum(map(in_view, after.surfaces)) == 3, "nothing is left at old positions"


def test_a_stool_that_was_carried_away_is_gone(recording, solutions):
    _, truth = recording
    (stool,) = truth["gone"]
    before, after = solutions
    assert len(at(before, stool)) == 1
    assert at(after, stool) == []


def test_a_cupboard_that_a_person_hides_keeps_its_id_and_dates(recording, solutions):
    _, truth = recording
    before, after = solutions
    cupboard = next(e for e in truth["surfaces"] if e["label"] == "cupboard")
    (old,), (new,) = at(before, cupboard), at(after, cupboard)
    assert (new.id, new.first_seen_ns) == (old.id, old.first_seen_ns)
    assert [v.points for v in old.views] == [v.points for v in new.views][: len(old.views)]
    again = sum(v.points for v in new.views) - old.points
    assert again < 0.1 * old.points, "the person hides it"
    crate = next(e for e in truth["surfaces"] if e["label"] == "crate")
    assert at(before, crate) == []
    assert at(after, crate)[0].first_seen_ns > old.last_seen_ns
