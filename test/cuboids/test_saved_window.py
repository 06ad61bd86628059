"""Saving and loading the map with its window."""

import numpy as np
import pytest
from tccm_rig import config, part_of, snapshot, void_part

from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.saved_window import load_map, save_map
from tccm_ros.errors import MapError, OutputError


@pytest.fixture
def settings():
    return config(window_cycles=4)


@pytest.fixture
def filled(settings):
    rng = np.random.default_rng(0)
    map_ = IntegrationMap(settings)
    for cycle in range(6):
        points = np.column_stack([rng.integers(-900, 900, (80, 2)), rng.integers(0, 3000, 80)])
        part = part_of(points, cycle, settings)
        map_.add(void_part(part, {(0, 0): [(100, 900)]}) if cycle == 4 else part)
    return map_


def test_round_trip_goes_on_bit_for_bit(filled, settings, tmp_path):
    path = tmp_path / "map.npz"
    save_map(filled, path, "odom")
    again, frame_id = load_map(path, settings)
    assert frame_id == "odom"
    assert snapshot(again) == snapshot(filled)
    later = part_of([(0, 0, 500), (300, 0, 800)], 6, settings)
    for map_ in (filled, again):
        map_.add(later)
        map_.remove(5)
    assert snapshot(again) == snapshot(filled)


def test_same_map_same_bytes(filled, tmp_path):
    for name in ("a", "b"):
        save_map(filled, tmp_path / name, "odom")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_smaller_window_keeps_the_newest(filled, tmp_path):
    save_map(filled, tmp_path / "map.npz", "odom")
    again, _ = load_map(tmp_path / "map.npz", config(window_cycles=2))
    assert again.cycles == [4, 5]


def test_an_empty_map(settings, tmp_path):
    save_map(IntegrationMap(settings), tmp_path / "map.npz", "odom")
    assert load_map(tmp_path / "map.npz", settings)[0].parts == []


def test_any_damaged_byte_is_noticed(filled, settings, tmp_path):
    path = tmp_path / "map.npz"
    save_map(filled, path, "odom")
    good = path.read_bytes()
    rng = np.random.default_rng(1)
    unnoticed = 0
    for at in rng.integers(0, len(good), 60).tolist():
        path.write_bytes(good[:at] + bytes([good[at] ^ 0x55]) + good[at + 1 :])
        try:
            again, _ = load_map(path, settings)
        except MapError:
            continue
        # Bytes of the container that say nothing (times, attributes) may differ.
        assert snapshot(again) == snapshot(filled)
        unnoticed += 1
    assert unnoticed < 30
    for length in (0, 10, len(good) // 2, len(good) - 1):
        path.write_bytes(good[:length])
        with pytest.raises(MapError, match=r"map\.npz"):
            load_map(path, settings)


def test_says_what_is_wrong(filled, settings, tmp_path):
    with pytest.raises(MapError, match="no such map"):
        load_map(tmp_path / "none.npz", settings)
    save_map(filled, tmp_path / "map.npz", "odom")
    with pytest.raises(MapError, match=r"map\.cell_size is 0\.01"):
        load_map(tmp_path / "map.npz", config(cell_size=0.01))
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(MapError, match="not a saved map"):
        load_map(tmp_path / "other.npz", settings)
    np.savez(tmp_path / "pickle.npz", a=np.array([{}], object))
    with pytest.raises(MapError, match="not a saved map"):
        load_map(tmp_path / "pickle.npz", settings)


def test_writes_whole_or_not_at_all(filled, tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        save_map(filled, tmp_path / "nowhere" / "map.npz", "odom")
    (tmp_path / "map.npz").mkdir()
    with pytest.raises(OutputError):
        save_map(filled, tmp_path / "map.npz", "odom")
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]
