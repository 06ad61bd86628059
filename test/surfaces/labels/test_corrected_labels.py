"""Labels that a person corrected: they stay through solutions, late views, saving and loading."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slam_run import PLACES, TABLE, drive, new_slam

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import LabelCorrection
from tccm_ros.results.map_file import load_map, save_map
from tccm_ros.surfaces.labels.corrected_labels import (
    corrected_labels,
    label_to_give,
    with_corrected_labels,
    with_corrections,
)
from tccm_ros.surfaces.labels.labels import Label, SurfaceLabel
from tccm_ros.surfaces.views.views import empty_view, with_numbers_of

GIVEN = [label for label in SurfaceLabel if label is not SurfaceLabel.FLOOR]


@pytest.fixture(scope="module")
def views():
    """Views of a drive past a table."""
    return drive(new_slam(), PLACES[:3]).map.views


@pytest.fixture
def slam():
    return drive(new_slam(), PLACES[:3])


def table_of(solution):
    (table,) = (s for s in solution.surfaces if abs(s.height - TABLE.z) < 0.02)
    return table


def correct(slam, solution, label):
    table = table_of(solution)
    slam.add(LabelCorrection((table.id, *table.merged_ids), label))
    return table.id


def test_a_corrected_label_holds_until_it_is_withdrawn(slam):
    before = slam.solve()
    assert table_of(before).label == "table"
    table = correct(slam, before, "counter")
    after = slam.solve()
    assert (table_of(after).id, table_of(after).label) == (table, "counter")
    assert table_of(after).confidence == 1.0
    assert after.corrected_labels == {table: "counter"}
    correct(slam, after, "")
    again = slam.solve()
    assert table_of(again).label == "table"
    assert again.corrected_labels == {}


def test_corrected_label_stays_in_saved_maps_and_sessions(slam, tmp_path):
    table = correct(slam, slam.solve(), "bed")
    solution = slam.solve()
    save_map(tmp_path / "map.mcap", slam.saved(solution), solution)
    later = SurfaceSlam.from_saved(Config(), load_map(tmp_path / "map.mcap"))
    found = drive(later, PLACES[:3], start=PLACES[0], seed=4).solve()
    assert found.alignment.found
    assert (table_of(found).id, table_of(found).label) == (table, "bed")


def test_session_without_localisation_can_correct_the_loaded_map(slam, tmp_path):
    solution = slam.solve()
    table = table_of(solution).id
    save_map(tmp_path / "map.mcap", slam.saved(solution), solution)
    later = SurfaceSlam.from_saved(Config(), load_map(tmp_path / "map.mcap"))
    later.add(LabelCorrection((table,), "seat"))
    unfound = later.solve()
    assert not unfound.alignment.found
    assert table_of(unfound).label == "seat"
    assert corrected_labels([s.view for s in later.saved(unfound).views]) == {table: "seat"}


def test_label_file_replaces_labels_of_the_map(slam, tmp_path):
    table = correct(slam, slam.solve(), "bed")
    solution = slam.solve()
    path, beside = tmp_path / "map.mcap", tmp_path / "labels.json"
    save_map(path, slam.saved(solution), solution)

    def write(*labels):
        entries = [{"surface": k, "label": label} for k, label in labels]
        beside.write_text(
            json.dumps({"format": "tccm_ros/labels", "version": 1, "labels": entries})
        )

    def read():
        return corrected_labels([s.view for s in load_map(path).views])

    assert read() == {table: "bed"}
    write((table, "counter"))
    assert read() == {table: "counter"}
    write()
    assert read() == {}
    for labels, problem in (
        ([(table, "throne")], f"surface {table}: no label 'throne': expected one of table"),
        ([(table, "floor")], "no label 'floor'"),
        ([(10**6, "table")], "no surface 1000000"),
        ([(table, "table"), (table, "bed")], "twice"),
    ):
        write(*labels)
        with pytest.raises(MapError, match=problem):
            load_map(path)


@given(data=st.data())
def test_corrected_label_follows_its_surface_over_late_and_removed_views(views, data):
    """The ids shift where a view comes late; the correction shifts with them."""
    count = sum(len(view.patches) for view in views)
    labels = data.draw(st.dictionaries(st.integers(0, count - 1), st.sampled_from(GIVEN)))
    corrected = with_corrected_labels(views, labels)
    assert corrected_labels(corrected) == labels
    late = replace(views[0], stamp_ns=views[0].stamp_ns - 1)
    shift = len(late.patches)
    assert corrected_labels([late, *corrected]) == {k + shift: v for k, v in labels.items()}
    older, newer = corrected[:2]
    kept = with_numbers_of(newer, older, {})
    assert corrected_labels([kept, *corrected[2:]]) == labels
    again = with_corrected_labels([kept, *corrected[2:]], labels)
    assert corrected_labels(again) == labels


def test_a_surface_that_is_not_there_is_refused(views):
    count = sum(len(view.patches) for view in views)
    for number in (-1, count):
        with pytest.raises(MapError, match=f"no surface {number}"):
            with_corrected_labels(views, {number: SurfaceLabel.TABLE})
    with pytest.raises(MapError, match="no surface 0"):
        with_corrected_labels([empty_view(1, 0, Config())], {0: SurfaceLabel.TABLE})


def test_the_first_corrected_id_counts_and_the_floor_stays_the_floor():
    floor, other = Label(SurfaceLabel.FLOOR, 1.0), Label(SurfaceLabel.OTHER, 0.5)
    corrected = {3: SurfaceLabel.BED, 5: SurfaceLabel.SEAT, 0: SurfaceLabel.TABLE}
    found = with_corrections([floor, other, other], [[0], [2, 3, 5], [7]], corrected)
    assert found == [floor, Label(SurfaceLabel.BED, 1.0), other]


@pytest.mark.parametrize("text", ["", "floor", "Table", "throne"])
def test_invalid_label_is_refused(text):
    with pytest.raises(MapError, match="expected one of table, counter, shelf"):
        label_to_give(text)


def test_every_other_label_can_be_given():
    assert [label_to_give(label.value) for label in GIVEN] == GIVEN
    assert len(np.unique(GIVEN)) == len(SurfaceLabel) - 1
