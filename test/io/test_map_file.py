import json
import os
import resource
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from shapely import Polygon
from slam_run import PLACES, TABLE, drive, new_slam

from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError
from tccm_ros.geometry import planar
from tccm_ros.io.exports import surfaces_table
from tccm_ros.io.map_file import load_map, save_map
from tccm_ros.io.numbers import json_text
from tccm_ros.surfaces.continuation import Continuation, LastSample
from tccm_ros.surfaces.surface_slam import SurfaceSlam


@pytest.fixture(scope="module")
def run():
    slam = drive(new_slam(), PLACES[:3])
    return slam, slam.solve()


@pytest.fixture
def saved(run, tmp_path):
    slam, solution = run
    save_map(tmp_path / "map.mcap", slam.saved(solution), solution)
    return tmp_path / "map.mcap"


def text_of(solution):
    return json_text(surfaces_table(solution.surfaces, solution.floor_z, "map"))


def test_a_loaded_map_shows_the_same_surfaces(run, saved):
    loaded = SurfaceSlam.from_saved(Config(), load_map(saved))
    again = loaded.map.build(loaded._old_views(loaded.walls.solve()))
    assert json_text(surfaces_table(again.surfaces, again.floor_z, "map")) == text_of(run[1])


def test_saving_what_was_loaded_gives_the_same_bytes(run, saved, tmp_path):
    save_map(tmp_path / "again.mcap", load_map(saved), run[1])
    assert (tmp_path / "again.mcap").read_bytes() == saved.read_bytes()


def test_a_new_session_without_common_odometry_goes_on(saved):
    slam = SurfaceSlam.from_saved(Config(), load_map(saved), expects_odometry=True)
    start = (0.2, -0.4, 0.3)
    places = [start, (0.0, 0.3, -0.5), (-0.4, 0.1, 0.0)]
    solution = drive(slam, places, start=start, seed=9).solve()
    assert solution.session.found
    x, y, yaw = planar(solution.session.T_map_session)
    assert np.hypot(x - start[0], y - start[1]) < 0.05
    assert abs(yaw - start[2]) < 0.02
    tables = [s for s in solution.surfaces if abs(s.height - TABLE.z) < 0.02]
    assert len(tables) == 1
    assert len(tables[0].views) >= 4
    outline = Polygon(tables[0].boundary[:, :2])
    assert outline.intersection(TABLE.polygon).area / outline.union(TABLE.polygon).area > 0.75


def test_an_ambiguous_session_leaves_the_map_alone(run, saved):
    from room import Board, Room
    from slam_run import odometry

    slam = SurfaceSlam.from_saved(Config(), load_map(saved), expects_odometry=True)
    hall = Room([], [], Board(0.0, 0.0, 12.0, 12.0, 0.0))
    for stamp in (600_000_000, 1_400_000_000):
        slam.add(odometry(stamp, (0, 0, 0)))
    for record in hall.look((0, 0, 0), 1_000_000_000):
        slam.add(record)
    solution = slam.solve()
    assert not solution.session.found
    assert text_of(solution) == text_of(run[1])


def test_it_opens_as_an_mcap_with_messages(saved):
    with saved.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert topics == {
        "/surface_slam/surfaces",
        "/surface_slam/surface_cloud",
        "/surface_slam/walls",
    }


@pytest.mark.parametrize("where", [0.02, 0.3, 0.6, 0.9, 0.999])
def test_a_damaged_file_is_a_clear_error(saved, where):
    data = bytearray(saved.read_bytes())
    data[int(where * len(data))] ^= 0xFF
    saved.write_bytes(data)
    with pytest.raises(MapError, match=r"^[^\n]*map\.mcap[^\n]*$"):
        load_map(saved)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.95])
def test_a_truncated_file_is_an_error(saved, share):
    data = saved.read_bytes()
    saved.write_bytes(data[: int(share * len(data))])
    with pytest.raises(MapError, match=r"map\.mcap"):
        load_map(saved)


def test_a_newer_file_is_an_error(run, saved, monkeypatch):
    slam, solution = run
    monkeypatch.setattr("tccm_ros.io.map_file.VERSION", 2)
    save_map(saved, slam.saved(solution), solution)
    monkeypatch.undo()
    with pytest.raises(MapError, match="version 2"):
        load_map(saved)


def test_no_file_and_no_map_are_errors(tmp_path):
    with pytest.raises(MapError, match="no such map"):
        load_map(tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text(json.dumps({}))
    with pytest.raises(MapError, match="not a map"):
        load_map(tmp_path / "text.mcap")


def test_a_place_that_cannot_be_written_is_an_error(run, tmp_path):
    slam, solution = run
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        save_map(tmp_path / "file" / "map.mcap", slam.saved(solution), solution)
    assert os.listdir(tmp_path) == ["file"]


def test_memory_stays_flat_over_100_loads(saved):
    for _ in range(10):
        load_map(saved)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(100):
        load_map(saved)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown * 1024 < 10 * saved.stat().st_size + 20_000_000


@pytest.fixture
def saved_run(run, tmp_path):
    """A map with the run in the middle of which it was saved."""
    slam, solution = run
    last = LastSample(3_400_000_000, ("odom", "base"), (0.2, 0.6, -0.4))
    ended = replace(slam.saved(solution), run=Continuation.of({"slam": slam}, last, slam.config))
    save_map(tmp_path / "run.mcap", ended, solution)
    return tmp_path / "run.mcap"


def test_a_map_holds_the_run_that_it_was_saved_in(run, saved_run, tmp_path):
    loaded = load_map(saved_run)
    save_map(tmp_path / "again.mcap", loaded, run[1])
    assert (tmp_path / "again.mcap").read_bytes() == saved_run.read_bytes()
    slam = loaded.run.processors(Config())["slam"]
    assert text_of(slam.solve()) == text_of(run[1])


def test_a_map_without_a_run_is_a_map(saved):
    assert load_map(saved).run is None


@pytest.mark.parametrize("where", np.linspace(0.05, 0.95, 7))
def test_a_damaged_run_is_a_clear_error(saved_run, where):
    data = bytearray(saved_run.read_bytes())
    data[int(where * len(data))] ^= 0xFF
    saved_run.write_bytes(data)
    with pytest.raises(MapError, match=r"^[^\n]*run\.mcap[^\n]*$"):
        load_map(saved_run)


def test_memory_stays_flat_over_100_runs_taken_up(saved_run):
    def take_up():
        load_map(saved_run).run.processors(Config())["slam"].solve()

    for _ in range(10):
        take_up()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(100):
        take_up()
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown * 1024 < 10 * saved_run.stat().st_size + 20_000_000
