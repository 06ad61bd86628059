"""An .rrd of a replay, read back by rerun's own dataframes."""

import json

import depth_room
import numpy as np
import pytest
from typer.testing import CliRunner

from tccm_ros.cli import app
from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError
from tccm_ros.results.trajectory import read_tum

rr_chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk (the extra 'view') is missing")
pytest.importorskip("datafusion", reason="rerun's dataframes need rerun-sdk[catalog]")

from rerun_server import depth_points, in_map, rows, transforms, views  # noqa: E402

from tccm_ros.view import rerun_viewer  # noqa: E402
from tccm_ros.view.rerun_log import rerun_file  # noqa: E402

BAG = "bags/walkthrough"


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """The result folder of a replay and its .rrd."""
    folder = tmp_path_factory.mktemp("rerun")
    out, file = folder / "out", folder / "map.rrd"
    command = ["replay", BAG, "--out", str(out), "--no-pictures", "-q", "--rerun", str(file)]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    return out, file


@pytest.fixture(scope="module")
def store(replayed):
    return rr_chunk.RrdReader(replayed[1]).stream().collect()


def test_poses_are_those_of_the_trajectory_at_their_stamps(replayed, store):
    stamps, T_map_odom = transforms(store, "/map/odom")
    same, T_odom_base = transforms(store, "/map/odom/base")
    assert (stamps == same).all()
    T_map_base = T_map_odom @ T_odom_base
    truth = read_tum(replayed[0] / "trajectory.tum")
    at = np.searchsorted(stamps, truth.stamps - 1e-6)
    assert len(truth.stamps) > 50
    np.testing.assert_allclose(stamps[at], truth.stamps, atol=1e-6)
    # Rerun keeps float32: 1e-6 of some metres.
    np.testing.assert_allclose(T_map_base[at, :2, 3], truth.positions[:, :2], atol=1e-5)
    np.testing.assert_allclose(T_map_base[at, :3, :3], truth.T_map_base[:, :3, :3], atol=1e-5)


def test_surfaces_come_with_name_and_outline_when_they_were_first_seen(replayed, store):
    content = json.loads((replayed[0] / "surfaces.json").read_text())
    assert len(content["surfaces"]) > 2
    for surface in content["surfaces"]:
        entity = f"/map/surfaces/{surface['id']}"
        stamps, strips = rows(store, f"{entity}/outline", "LineStrips3D:strips")
        np.testing.assert_allclose(stamps, [surface["first_seen"]], atol=1e-6)
        [ring] = strips[0]
        np.testing.assert_allclose(ring[:-1], surface["boundary"], atol=1e-5)
        if surface["label"] != "floor":
            _, [[name]] = rows(store, f"{entity}/name", "Points3D:labels")
            over_floor = surface["height"] - (content["floor_z"] or 0.0)
            assert name == f"{surface['label']} {surface['id']}, {over_floor:.2f} m"


def test_walls_objects_and_views_are_those_of_the_result(replayed, store):
    walls = json.loads((replayed[0] / "walls.json").read_text())["walls"]
    [strips] = rows(store, "/map/walls", "LineStrips3D:strips", index=None)
    corners = [np.array(strip)[:2, :2] for strip in strips]
    np.testing.assert_allclose(corners, [wall["endpoints"] for wall in walls], atol=1e-5)
    for item in json.loads((replayed[0] / "objects.json").read_text())["objects"]:
        _, [[center]] = rows(store, f"/map/objects/{item['id']}", "Boxes3D:centers")
        np.testing.assert_allclose(center, item["center"], atol=1e-5)
    cycles = json.loads((replayed[0] / "planes.json").read_text())["cycles"]
    stamps, _ = rows(store, "/map/odom/part_map", "Boxes3D:centers")
    np.testing.assert_allclose(stamps, [cycle["stamp"] for cycle in cycles], atol=1e-6)


def test_scans_lie_on_the_walls_at_their_stamps(replayed, store):
    """Half of the hits of a level scan are within 5 cm of a wall: the room is furnished."""
    walls = json.loads((replayed[0] / "walls.json").read_text())["walls"]
    lines = np.array([[np.cos(w["phi"]), np.sin(w["phi"]), -w["rho"]] for w in walls])
    stamps, points = rows(store, "/map/odom/scan", "Points3D:positions")
    at, T_map_odom = transforms(store, "/map/odom")
    for k in (0, len(stamps) // 2, len(stamps) - 1):
        [pose] = T_map_odom[at == stamps[k]]
        xy = np.array(points[k])[:, :2] @ pose[:2, :2].T + pose[:2, 3]
        distances = np.abs(np.column_stack([xy, np.ones(len(xy))]) @ lines.T).min(axis=1)
        assert np.median(distances) < 0.05


def test_the_blueprint_shows_the_map_the_newest_cycle_and_events(replayed):
    assert views(replayed[1]) == [{"Map", "Newest tilt cycle", "Events"}]


def test_files_of_a_second_of_a_drive_stay_small(replayed):
    """At most 60 MB for the 108 s of bags/flat; the walkthrough is measured by the same lasers."""
    seconds = len(read_tum(replayed[0] / "trajectory.tum").stamps) / 10.0  # scans at 10 Hz
    assert replayed[1].stat().st_size < 60e6 / 108.0 * seconds


@pytest.fixture(scope="module")
def depth_store(tmp_path_factory):
    """The .rrd of a head camera and a lidar over a table, their bag's poses being exact."""
    folder = tmp_path_factory.mktemp("depth")
    depth_room.write_recording(folder / "bag")
    words = ["--out", str(folder / "out"), "--no-pictures", "-q", "--rerun", str(folder / "a.rrd")]
    done = CliRunner().invoke(app, ["replay", str(folder / "bag"), *words])
    assert done.exit_code == 0, done.output
    [shown] = views(folder / "a.rrd")
    assert shown == {"Map", "Newest tilt cycle", "Events", "depth/image_rect_raw"}
    return rr_chunk.RrdReader(folder / "a.rrd").stream().collect()


def test_depth_images_with_their_camera_show_the_table_at_their_stamps(depth_store):
    camera = "/map/odom/base/depth/image_rect_raw"
    stamps, images = depth_points(depth_store, camera)
    expected = depth_room.START_NS * 1e-9 + np.arange(0.1, 4.0, 0.2)
    assert set(np.round(stamps, 3)) <= set(np.round(expected, 3))
    assert len(stamps) > 10
    for k in (0, len(stamps) // 2, len(stamps) - 1):
        seen = in_map(depth_store, camera, stamps[k], images[k])
        depth_room.assert_on_table_or_floor(seen)


def test_clouds_of_a_lidar_show_the_table_at_their_stamps(depth_store):
    stamps, clouds = rows(depth_store, "/map/odom/base/points", "Points3D:positions")
    assert len(stamps) > 10
    for k in (0, len(stamps) // 2, len(stamps) - 1):
        points = in_map(depth_store, "/map/odom/base/points", stamps[k], np.array(clouds[k]))
        assert (np.abs(points[:, 2] - depth_room.TOP) < 0.01).any()


def test_a_saved_map_is_written_without_its_recording(replayed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = rerun_viewer.rerun_of(replayed[0], Config())
    assert file.name == "out.rrd"
    made = rr_chunk.RrdReader(file).stream().collect()
    surfaces = json.loads((replayed[0] / "surfaces.json").read_text())["surfaces"]
    for surface in surfaces:
        stamps, _ = rows(made, f"/map/surfaces/{surface['id']}/outline", "LineStrips3D:strips")
        np.testing.assert_allclose(stamps, [surface["first_seen"]], atol=1e-6)


def test_incomplete_recordings_are_removed(tmp_path):
    with pytest.raises(RuntimeError), rerun_file(tmp_path / "a.rrd", Config()):
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_without_a_display_the_file_is_named(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OutputError, match=r"a\.rrd: there is no display"):
        rerun_viewer.open_rerun(tmp_path / "a.rrd")


def test_a_target_that_is_missing_is_named(tmp_path):
    with pytest.raises(MapError, match="no such result folder"):
        rerun_viewer.rerun_of(tmp_path / "none", Config())
