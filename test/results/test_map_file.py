import gc
import io
import json
import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from shapely import Polygon
from slam_run import PLACES, TABLE, drive, new_slam

from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError
from tccm_ros.geometry import planar
from tccm_ros.mapping.saved_map import pack_views
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.results.map_file import load_map, save_map
from tccm_ros.results.models import SurfacesFile
from tccm_ros.results.numbers import json_text


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
    return json_text(SurfacesFile.of(solution.surfaces, solution.floor_z, "map"))


def test_a_loaded_map_has_the_same_surfaces(run, saved):
    loaded = SurfaceSlam.from_saved(Config(), load_map(saved))
    again = loaded.map.build(loaded._saved_poses(loaded.wall_slam.solve()))
    assert json_text(SurfacesFile.of(again.surfaces, again.floor_z, "map")) == text_of(run[1])


def test_saving_a_loaded_map_gives_the_same_bytes(run, saved, tmp_path):
    save_map(tmp_path / "again.mcap", load_map(saved), run[1])
    assert (tmp_path / "again.mcap").read_bytes() == saved.read_bytes()


def test_a_new_session_with_other_odometry_continues_the_map(saved):
    slam = SurfaceSlam.from_saved(Config(), load_map(saved))
    start = (0.2, -0.4, 0.3)
    places = [start, (0.0, 0.3, -0.5), (-0.4, 0.1, 0.0)]
    solution = drive(slam, places, start=start, seed=9).solve()
    assert solution.alignment.found
    x, y, yaw = planar(solution.alignment.T_map_session)
    assert np.hypot(x - start[0], y - start[1]) < 0.05
    assert abs(yaw - start[2]) < 0.02
    tables = [s for s in solution.surfaces if abs(s.height - TABLE.z) < 0.02]
    assert len(tables) == 1
    assert len(tables[0].views) >= 4
    outline = Polygon(tables[0].boundary[:, :2])
    assert outline.intersection(TABLE.polygon).area / outline.union(TABLE.polygon).area > 0.75


def test_an_ambiguous_session_does_not_change_the_map(run, saved):
    from room import Board, Room
    from slam_run import odometry

    slam = SurfaceSlam.from_saved(Config(), load_map(saved))
    hall = Room([], [], Board(0.0, 0.0, 12.0, 12.0, 0.0))
    for stamp in (600_000_000, 1_400_000_000):
        slam.add(odometry(stamp, (0, 0, 0)))
    for record in hall.look((0, 0, 0), 1_000_000_000):
        slam.add(record)
    solution = slam.solve()
    assert not solution.alignment.found
    assert text_of(solution) == text_of(run[1])


def test_a_map_is_an_mcap_with_messages(saved):
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


@pytest.mark.parametrize("fraction", [0.0, 0.2, 0.5, 0.95])
def test_a_truncated_file_is_an_error(saved, fraction):
    data = saved.read_bytes()
    saved.write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(MapError, match=r"map\.mcap"):
        load_map(saved)


def test_a_newer_file_is_an_error(run, saved, monkeypatch):
    slam, solution = run
    monkeypatch.setattr("tccm_ros.results.map_file.VERSION", 4)
    save_map(saved, slam.saved(solution), solution)
    monkeypatch.undo()
    with pytest.raises(MapError, match="version 4"):
        load_map(saved)


def test_a_pickle_in_a_map_is_refused(run, saved, monkeypatch):
    slam, solution = run
    stream = io.BytesIO()
    np.savez(stream, **{"anchor/hangs": np.array([{"a": 1}], dtype=object)})
    monkeypatch.setattr("tccm_ros.results.map_file.array_archive", lambda _: stream.getvalue())
    save_map(saved, slam.saved(solution), solution)
    with pytest.raises(MapError, match="damaged"):
        load_map(saved)


def test_a_missing_file_and_a_file_of_another_kind_are_errors(tmp_path):
    with pytest.raises(MapError, match="no such map"):
        load_map(tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text(json.dumps({}))
    with pytest.raises(MapError, match="not a map"):
        load_map(tmp_path / "text.mcap")


def test_a_path_that_cannot_be_written_is_an_error(run, tmp_path):
    slam, solution = run
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        save_map(tmp_path / "file" / "map.mcap", slam.saved(solution), solution)
    assert os.listdir(tmp_path) == ["file"]


def growth(act, times):
    """Return by how many bytes the memory of Python and NumPy grows over some calls."""
    tracemalloc.start()
    try:
        act()
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(times):
            act()
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def held(path):
    """Return the bytes of the views of a loaded map."""
    views = [s.view for s in load_map(path).views]
    return sum(array.nbytes for array in pack_views(views).values())


def test_memory_does_not_grow_over_100_loads(saved):
    load_map(saved)
    kept = []
    flat = growth(lambda: load_map(saved), 100)
    assert flat < 0.2 * held(saved)
    assert growth(lambda: kept.append(load_map(saved)), 1) > 0.8 * held(saved), "a leak is seen"


def test_the_messages_are_decoded_with_the_definitions_in_the_file(run, saved):
    """Every message is read by the definitions in the file alone, none of this package's."""
    with saved.open("rb") as stream:
        rows = [(s, c, m.data) for s, c, m in make_reader(stream).iter_messages()]
    assert len(rows) == 3
    for schema, channel, data in rows:
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(schema.data.decode(), schema.name))
        message = store.deserialize_cdr(data, schema.name)
        if channel.topic == "/surface_slam/surface_cloud":
            assert message.width * message.height == len(run[1].mapped.points)
            assert message.header.frame_id == "map"
        else:
            assert len(message.markers) > 0 or channel.topic == "/surface_slam/walls"


def test_a_changed_byte_is_an_error(saved):
    """Bytes spread over the file, each byte of its beginning and each of its last 400."""
    whole = saved.read_bytes()
    places = np.random.default_rng(0).integers(0, len(whole), 150)
    for place in [*range(60), *places.tolist(), *range(len(whole) - 400, len(whole))]:
        data = bytearray(whole)
        data[place] ^= 1 << (place % 8)
        saved.write_bytes(data)
        with pytest.raises(MapError) as refused:
            load_map(saved)
        assert str(refused.value).startswith(str(saved)), place
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("version", [1, 2])
def test_a_map_of_an_earlier_release_is_a_clear_error(run, saved, monkeypatch, version):
    slam, solution = run
    monkeypatch.setattr("tccm_ros.results.map_file.VERSION", version)
    save_map(saved, slam.saved(solution), solution)
    monkeypatch.undo()
    with pytest.raises(MapError, match=rf"version {version}, saved before tccm_ros 0.1.*replay"):
        load_map(saved)


SAVE_AND_DIE = """
import os, sys
from pathlib import Path
from mcap.writer import Writer
from tccm_ros.results.map_file import load_map, save_map

path, where = Path(sys.argv[1]), sys.argv[2]
saved = load_map(path)
solution = SOLUTION

def die(*arguments, **options):
    os._exit(9)

owner, _, name = where.rpartition(".")
setattr(Writer if owner == "Writer" else os, name, die)
save_map(path, saved, solution)
"""
NO_SOLUTION = (
    "__import__('types').SimpleNamespace(surfaces=(), mapped=__import__('types').SimpleNamespace("
    "points=__import__('numpy').zeros((0, 3), 'f4'), surface_id=__import__('numpy').zeros(0, 'u4')"
    "), objects=(), compartments=(), graph=__import__('types').SimpleNamespace(walls=(), "
    "keyframes=(), signs=()), stamp_ns=0)"
)


@pytest.mark.parametrize(
    "where", ["Writer.add_message", "Writer.add_attachment", "Writer.finish", "os.fsync",
              "os.replace", "os._exit"]
)  # fmt: skip
def test_a_killed_process_leaves_the_old_map_or_the_new(saved, where):
    before = saved.read_bytes()
    script = SAVE_AND_DIE.replace("SOLUTION", NO_SOLUTION)
    done = subprocess.run([sys.executable, "-c", script, saved, where], check=False)
    if where == "os._exit":
        assert done.returncode == 0
        assert saved.read_bytes() != before
    else:
        assert done.returncode == 9
        assert saved.read_bytes() == before
    load_map(saved)


def test_the_content_is_synchronised_before_the_file_is_renamed(run, tmp_path, monkeypatch):
    steps = []
    for name in ("fsync", "replace"):
        real = getattr(os, name)

        def noted(*arguments, real=real, name=name):
            steps.append(name)
            return real(*arguments)

        monkeypatch.setattr(os, name, noted)
    slam, solution = run
    save_map(tmp_path / "map.mcap", slam.saved(solution), solution)
    assert steps == ["fsync", "replace"]
