"""Stages that hang on the map: one that fails is left out, counted and said."""

import json

import pytest
from depth_room import write_recording

from tccm_ros.config import Config
from tccm_ros.replay.replay import replay
from tccm_ros.stages import STRICT, OptionalStages

STAGES = {
    "rooms": "tccm_ros.mapping.surface_slam.SurfaceSlam._rooms",
    "names of rooms": "tccm_ros.mapping.surface_slam.placed_surfaces",
    "free places": "tccm_ros.mapping.surface_slam.free_places",
    "placements": "tccm_ros.results.exports.ranked_placements",
    "surfaces.geojson": "tccm_ros.results.exports.feature_collection",
    "surfaces.scene": "tccm_ros.results.exports.scene_text",
    "cycles.npz": "tccm_ros.replay.replay.save_cycles",
    "result.mcap": "tccm_ros.replay.replay.write_result_bag",
    "pictures": "tccm_ros.report.pictures.map_png",
}
"""The function that each stage runs."""

MAP = {"surfaces.json", "surfaces.ply", "walls.json", "trajectory.tum", "cuboids.npz", "map.mcap"}


def fail(*_, **__):
    raise ValueError("broken\non purpose")


def test_a_stage_that_fails_is_counted(monkeypatch):
    monkeypatch.delenv(STRICT)
    stages = OptionalStages()
    assert stages.run("pictures", lambda: 3) == 3
    assert stages.run("pictures", fail) is None
    assert stages.run("pictures", fail) is None
    assert stages.failed == {"pictures: ValueError: broken on purpose": 2}


def test_tests_are_strict():
    with pytest.raises(ValueError, match="broken"):
        OptionalStages().run("pictures", fail)


def test_a_map_whose_every_stage_fails_is_saved(tmp_path, monkeypatch):
    write_recording(tmp_path / "bag")
    replay(tmp_path / "bag", tmp_path / "whole", Config(), pictures=False)
    monkeypatch.delenv(STRICT)
    for target in STAGES.values():
        monkeypatch.setattr(target, fail)
    summary = replay(tmp_path / "bag", tmp_path / "map", Config())
    expected = {f"{name}: ValueError: broken on purpose": 1 for name in STAGES}
    content = json.loads((tmp_path / "map" / "summary.json").read_text())
    assert content["counts"]["failed_stages"] == expected
    said = summary.text().splitlines()
    assert {f"left out, as it failed: {what}" for what in expected} <= set(said)
    for name in MAP:
        assert (tmp_path / "map" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
