"""Two drives through the flat become one map, in truth's frame; other maps stay by themselves.

The drives are halves of a bundled recording, each with a frame of its own.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from distributed import LocalCluster
from map_truth import surface_errors, wall_errors

from tccm_ros.config import Config
from tccm_ros.errors import FleetError
from tccm_ros.fleet.cluster import Workers
from tccm_ros.fleet.merge import merge_maps
from tccm_ros.geometry import inverse2, transform2
from tccm_ros.results.map_info import map_info

BAGS = Path(__file__).resolve().parents[2] / "bags"
MAX_ERROR = 0.015


@pytest.fixture(scope="module")
def maps(session_files, tmp_path_factory):
    """The maps of both halves, and that of another place."""
    root = tmp_path_factory.mktemp("maps")
    for folder in session_files.replayed_halves():
        shutil.copytree(folder, root / folder.name)
    shutil.copytree(session_files.replayed("walkthrough"), root / "elsewhere")
    return root


@pytest.fixture(scope="module")
def workers():
    """A worker in this process, which has loaded its kernels."""
    with LocalCluster(n_workers=1, processes=False, dashboard_address="127.0.0.1:0") as cluster:
        yield Workers(scheduler=cluster.scheduler_address)


@pytest.fixture(scope="module")
def merged(maps, tmp_path_factory):
    """The map of both halves, which a process of its own has matched."""
    out = tmp_path_factory.mktemp("merged") / "flat"
    return merge_maps([maps / "first", maps / "second"], out, Config())


def surfaces(folder):
    entries = json.loads((folder / "surfaces.json").read_text())["surfaces"]
    return {entry["id"]: entry for entry in entries}


def test_walls_and_surfaces_are_where_they_are_in_truth(merged):
    walls = wall_errors(merged.out, BAGS / "flat")
    assert len(walls) >= 10
    assert walls.max() < MAX_ERROR
    heights, counts = surface_errors(merged.out, BAGS / "flat")
    assert heights.max() < MAX_ERROR
    assert counts.min() == 1, "a top is missing"


def test_the_table_of_ids_leads_to_the_same_surface(merged, maps):
    (component,) = merged.content.components
    new, seen = surfaces(merged.out), []
    for entry, name in zip(component.maps, ("first", "second")):
        old = surfaces(maps / name)
        assert {s.old for s in entry.surfaces} == set(old)
        kept = [s for s in entry.surfaces if s.new is not None]
        assert len(kept) > 0.8 * len(old)
        for s in kept:
            assert abs(new[s.new]["height"] - old[s.old]["height"]) < 0.03
        seen.append({s.new for s in kept if old[s.old]["label"] == "table"})
    assert seen[0] & seen[1], "a table that both have seen has one id"


def test_the_merged_map_is_a_map(merged, maps):
    counts = [map_info(maps / name / "map.mcap") for name in ("first", "second")]
    found = map_info(merged.out / "map.mcap")
    assert found.sessions == 2
    assert found.keyframes == sum(c.keyframes for c in counts)
    assert found.views == sum(c.views for c in counts)


def test_a_map_of_another_place_is_matched_alone_and_stays_by_itself(merged, maps, workers):
    sources = [maps / name for name in ("first", "second", "elsewhere")]
    before = (merged.out / "surfaces.json").read_bytes()
    again = merge_maps(sources, merged.out, Config(), workers=workers)
    assert again.matched == 2, "what was matched before is remembered"
    assert [len(c.maps) for c in again.content.components] == [2, 1]
    assert (again.out / "surfaces.json").read_bytes() == before
    own = surfaces(again.out / again.content.components[1].folder)
    assert own.keys() == surfaces(maps / "elsewhere").keys()
    assert f"shares nothing with it: {maps / 'elsewhere'}" in again.text()
    assert merge_maps(sources, merged.out, Config()).matched == 0


def with_signs(folder, map_folder, T_first_map, texts):
    """Copy a map, with door signs at the same places of the first map's frame."""
    copy = shutil.copytree(map_folder, folder / map_folder.name)
    signs = [
        {"id": k, "text": text, "number": text, "confidence": 0.9, "normal": [1, 0, 0],
         "covariance": np.eye(3).tolist(), "wall": None, "views": [],
         "position": [*transform2(inverse2(T_first_map), np.array([[2.0 * k, 1.0]]))[0], 1.5]}
        for k, text in enumerate(texts)
    ]  # fmt: skip
    (copy / "signs.json").write_text(json.dumps({"signs": signs}))
    return copy


@pytest.mark.parametrize(("other", "sizes"), [("1", [2]), ("2", [1, 1])])
def test_signs_distinguish_buildings_with_equal_walls_and_furniture(
    merged, maps, workers, tmp_path, other, sizes
):
    (component,) = merged.content.components
    sources = [
        with_signs(tmp_path, maps / name, entry.T_map_old, [f"{floor}0{k}" for k in range(3)])
        for name, entry, floor in zip(("first", "second"), component.maps, ("1", other))
    ]
    found = merge_maps(sources, tmp_path / "out", Config(), workers=workers)
    assert [len(c.maps) for c in found.content.components] == sizes
    (pair,) = found.content.pairs
    assert ("3 of 3 door signs read otherwise" in pair.reason) == (other == "2")


def test_maps_of_equal_bytes_are_merged_on_request_only(maps, tmp_path):
    copy = shutil.copytree(maps / "elsewhere", tmp_path / "copy")
    sources = [maps / "elsewhere", copy]
    two = merge_maps(sources, tmp_path / "out", Config())
    assert [len(c.maps) for c in two.content.components] == [1, 1]
    assert "--same-building" in two.text()
    together = merge_maps(sources, tmp_path / "out", Config(), same_building=True)
    (component,) = together.content.components
    first, second = component.maps
    assert first.surfaces == second.surfaces
    assert all(s.new is not None for s in first.surfaces)
    assert np.array_equal(first.T_map_old, second.T_map_old)


def test_a_single_map_is_an_error(maps, tmp_path):
    with pytest.raises(FleetError, match="nothing to merge"):
        merge_maps([maps / "first"], tmp_path / "out", Config())
