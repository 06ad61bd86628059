"""Reading a result folder: required, optional and damaged files."""

import json

import numpy as np
import pytest

from tccm_ros.errors import MapError
from tccm_ros.results.folder_reader import load_results

REQUIRED = ("surfaces.json", "walls.json", "trajectory.tum")
OPTIONAL = (
    "graph.json",
    "objects.json",
    "planes.json",
    "racks.json",
    "cuboids.npz",
    "cycles.npz",
    "summary.json",
    "timing.json",
)


def test_every_file_of_a_folder_is_read(flat):
    results = load_results(flat)
    assert [s.label for s in results.surfaces][:3] == ["floor", "counter", "counter"]
    assert len(results.above_floor) == len(results.surfaces) - 1
    assert results.ground == -0.02
    assert len(results.walls) == 6
    assert results.trajectory.positions.shape == (61, 3)
    assert len(results.graph.keyframes) == 61
    assert len(results.planes) == len(results.cycles) == 24
    assert results.cuboids.mean.shape == (len(results.cuboids), 3)
    assert results.cuboids.newest.min() == 14
    assert results.summary.counts.cycles == 24


def test_the_trajectory_has_its_length_and_finds_the_nearest_pose(flat):
    trajectory = load_results(flat).trajectory
    assert trajectory.length == pytest.approx(17.64, abs=0.01)
    assert trajectory.nearest(np.array([-5.0, 0.4, 30.6, 99.0])).tolist() == [0, 0, 31, 60]


@pytest.mark.parametrize("name", OPTIONAL)
def test_an_optional_file_may_be_missing(flat_copy, name):
    (flat_copy / name).unlink()
    assert load_results(flat_copy).surfaces


@pytest.mark.parametrize("name", REQUIRED)
def test_a_missing_required_file_is_an_error_that_names_it(flat_copy, name):
    (flat_copy / name).unlink()
    with pytest.raises(MapError, match=rf"{name}: no such file"):
        load_results(flat_copy)


def test_a_missing_folder_is_an_error(tmp_path):
    with pytest.raises(MapError, match="no such folder"):
        load_results(tmp_path / "nothing")


def test_keys_of_later_versions_are_ignored(flat_copy):
    tree = json.loads((flat_copy / "surfaces.json").read_text())
    tree["surfaces"][4]["room"] = tree["lamps"] = "kitchen"
    (flat_copy / "surfaces.json").write_text(json.dumps(tree))
    assert len(load_results(flat_copy).surfaces) == 11


@pytest.mark.parametrize("name", REQUIRED + OPTIONAL)
@pytest.mark.parametrize("damage", ["truncated", "binary", "list"])
def test_a_damaged_file_is_an_error_that_names_it(flat_copy, name, damage):
    path = flat_copy / name
    content = path.read_bytes()
    cut = content[: len(content) // 2 + 3]
    path.write_bytes({"truncated": cut, "binary": b"\xff\x00" * 40, "list": b"[1, 2]"}[damage])
    with pytest.raises(MapError, match=name.replace(".", r"\.")) as caught:
        load_results(flat_copy)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [("boundary", [[0.0, None, 1.0]]), ("boundary", [[0.0, 1.0]]), ("height", "high")],
)
def test_a_wrong_value_is_an_error_that_names_its_key(flat_copy, key, value):
    tree = json.loads((flat_copy / "surfaces.json").read_text())
    tree["surfaces"][4][key] = value
    (flat_copy / "surfaces.json").write_text(json.dumps(tree))
    with pytest.raises(MapError, match=rf"surfaces\.4\.{key}"):
        load_results(flat_copy)
