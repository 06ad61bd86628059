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
    signs = len(json.loads((flat / "signs.json").read_text())["signs"])
    assert maps(catalogue, "signs") == {f"run-{k}": signs for k in range(3)}


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


def test_rows_of_another_version_are_read_with_their_columns(catalogue):
    path = catalogue.path / "surfaces" / "run-0.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["confidence"]), path)
    for _ in range(2):
        answer = catalogue.ask("SELECT map, count(confidence) FROM surfaces GROUP BY map")
        assert dict(answer.rows)["run-0"] == 0
        assert dict(answer.rows)["run-1"] > 0
        catalogue.gather(max_files=0)


def test_reader_finds_every_map_once_while_files_are_gathered(catalogue, flat):
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


DAY_S = 86_400.0


def furnished(folder, days, above_floor=0.75, edge=0.8):
    """Make a surface a table with a free square, and the whole map some days later."""
    surfaces = json.loads((folder / "surfaces.json").read_text())
    table = next(s for s in surfaces["surfaces"] if s["label"] != "floor")
    table |= {"label": "table", "height": (surfaces["floor_z"] or 0.0) + above_floor}
    for surface in surfaces["surfaces"]:
        for stamp in ("first_seen", "last_seen"):
            surface[stamp] += days * DAY_S
    ring = [[0, 0, 1], [edge, 0, 1], [edge, edge, 1], [0, edge, 1]]
    objects = {"objects": [], "free": [{"surface": table["id"], "polygons": [ring]}]}
    (folder / "surfaces.json").write_text(json.dumps(surfaces))
    (folder / "objects.json").write_text(json.dumps(objects))
    return table["id"]


def test_the_first_question_finds_the_free_tables_of_the_last_day(tmp_path, flat):
    made = Catalogue(tmp_path / "catalogue")
    maps = {
        "today": {"days": 3.0},
        "in the morning": {"days": 2.2},
        "two days ago": {"days": 1.0},
        "small": {"days": 3.0, "edge": 0.7},
        "high": {"days": 3.0, "above_floor": 0.85},
    }
    ids = {}
    for name, change in maps.items():
        folder = shutil.copytree(flat, tmp_path / name)
        ids[name] = furnished(folder, **change)
        made.add(name, folder)
    found = [row[:2] for row in made.ask(QUESTIONS[0]).rows]
    assert sorted(found) == [(name, ids[name]) for name in ("in the morning", "today")]


@pytest.mark.parametrize("labels", [("", ""), ("mug", ""), ("mug", "box"), ("", "box")])
def test_second_query_finds_the_mug_and_objects_not_seen_since(tmp_path, flat_copy, labels):
    surfaces = json.loads((flat_copy / "surfaces.json").read_text())
    under, *others = (s for s in surfaces["surfaces"] if s["label"] != "floor")
    for k, surface in enumerate(surfaces["surfaces"]):
        surface["last_seen"] = 100.0 + k
    under["last_seen"] = 101.5
    boxes = [
        {"id": 1, "surface": under["id"], "center": [1, 2, 0.8], "size": [0.08, 0.09, 0.1]},
        {"id": 2, "surface": others[0]["id"], "center": [3, 2, 0.8], "size": [0.3, 0.2, 0.1]},
    ]
    boxes = [box | {"yaw": 0.0, "label": label} for box, label in zip(boxes, labels)]
    objects = {"objects": boxes, "free": []}
    (flat_copy / "surfaces.json").write_text(json.dumps(surfaces))
    (flat_copy / "objects.json").write_text(json.dumps(objects))
    made = Catalogue(tmp_path / "catalogue")
    made.add("run", flat_copy)
    answer = made.ask(QUESTIONS[1])
    rows = [dict(zip(answer.columns, row)) for row in answer.rows]
    assert {(r["map"], r["seen_on"], r["center_x"]) for r in rows} == {("run", under["id"], 1.0)}
    older = {s["id"] for s in surfaces["surfaces"] if s["last_seen"] < 101.5}
    assert older
    assert {r["not_seen_since"] for r in rows} == older


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
