"""The catalogue has each map once, whenever it is asked; it answers the questions of the guide."""

import json
import re
import shutil
import threading
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tccm_ros.errors import FleetError, MapError
from tccm_ros.fleet.catalogue import Catalogue

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "find.md"
QUESTIONS = re.findall(r"```sql\n(.*?)```", GUIDE.read_text(), re.DOTALL)


@pytest.fixture
def catalogue(tmp_path, flat):
    """A catalogue of three maps of the same content."""
    made = Catalogue(tmp_path / "catalogue")
    for k in range(3):
        made.add(f"run-{k}", flat)
    return made


def maps(catalogue, table="surfaces"):
    return dict(catalogue.ask(f"SELECT map, count(*) FROM {table} GROUP BY map").rows)


def test_the_maps_are_found(catalogue, flat):
    count = len(json.loads((flat / "surfaces.json").read_text())["surfaces"])
    assert maps(catalogue) == {f"run-{k}": count for k in range(3)}
    assert maps(catalogue, "signs") == {}


def test_gathering_changes_no_answer(catalogue, flat):
    query = "SELECT * FROM surfaces ORDER BY map, id"
    before = catalogue.ask(query)
    catalogue.gather(max_files=0)
    assert not list(catalogue.path.glob("surfaces/*.parquet"))
    assert catalogue.ask(query) == before
    catalogue.add("run-3", flat)
    catalogue.gather(max_files=0)
    assert set(maps(catalogue)) == {f"run-{k}" for k in range(4)}


def test_a_map_that_is_written_again_replaces_its_rows(catalogue, flat_copy):
    catalogue.gather(max_files=0)
    tree = json.loads((flat_copy / "surfaces.json").read_text())
    tree["surfaces"] = tree["surfaces"][:2]
    (flat_copy / "surfaces.json").write_text(json.dumps(tree))
    catalogue.add("run-1", flat_copy)
    assert maps(catalogue)["run-1"] == 2
    catalogue.gather(max_files=0)
    assert maps(catalogue)["run-1"] == 2
    assert maps(catalogue)["run-0"] > 2


def test_few_files_are_left_as_they_are(catalogue):
    catalogue.gather()
    assert len(list(catalogue.path.glob("surfaces/*.parquet"))) == 3


def test_rows_of_another_version_are_read_with_what_they_have(catalogue):
    path = catalogue.path / "surfaces" / "run-0.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["confidence"]), path)
    for _ in range(2):
        answer = catalogue.ask("SELECT map, count(confidence) FROM surfaces GROUP BY map")
        assert dict(answer.rows)["run-0"] == 0
        assert dict(answer.rows)["run-1"] > 0
        catalogue.gather(max_files=0)


def test_a_reader_finds_every_map_once_while_files_are_written_and_gathered(catalogue, flat):
    expected, done = maps(catalogue)["run-0"], threading.Event()

    def write():
        for k in range(30):
            catalogue.add(f"run-{k % 3}", flat)
            catalogue.gather(max_files=1)
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    asked = 0
    try:
        while not done.is_set():
            assert maps(catalogue) == {f"run-{k}": expected for k in range(3)}
            asked += 1
    finally:
        writer.join()
    assert asked


@pytest.mark.parametrize("query", QUESTIONS, ids=range(len(QUESTIONS)))
def test_a_question_of_the_guide_is_answered(catalogue, query):
    answer = catalogue.ask(query)
    assert all(name in answer.text() for name in answer.columns)
    json.dumps(answer.to_json())
    assert bool(answer.rows) == (query != QUESTIONS[0])  # the room has no table with so much free


def test_there_are_five_questions():
    assert len(QUESTIONS) == 5


def test_a_geometry_is_shown_as_text(catalogue):
    answer = catalogue.ask("SELECT geometry FROM surfaces LIMIT 1")
    assert answer.to_json()["rows"][0][0].startswith("POLYGON Z ((")
    assert max(map(len, answer.text().splitlines())) <= 60


def test_a_wrong_query_is_an_error_of_one_line(catalogue):
    with pytest.raises(FleetError, match=r"query:.*no_such_column") as error:
        catalogue.ask("SELECT no_such_column FROM surfaces")
    assert "\n" not in str(error.value)


def test_a_folder_without_a_catalogue_is_an_error(tmp_path):
    with pytest.raises(FleetError, match="no catalogue"):
        Catalogue(tmp_path / "catalogue").ask("SELECT 1")


def test_a_folder_without_results_is_an_error(tmp_path, flat_copy):
    shutil.copy(flat_copy / "surfaces.json", tmp_path)
    with pytest.raises(MapError, match=r"walls\.json"):
        Catalogue(tmp_path / "catalogue").add("half", tmp_path)
    assert not (tmp_path / "catalogue").exists()
