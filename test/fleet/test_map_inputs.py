"""Maps are found in files, result folders and fleets."""

import pytest

from tccm_ros.errors import FleetError, MapError
from tccm_ros.fleet.map_inputs import checksum_of, find_maps


@pytest.fixture
def folder(tmp_path):
    for name in ("a/map.mcap", "b.mcap", "fleet/recordings/x/map.mcap",
                 "fleet/recordings/y/map.mcap", "fleet/recordings/failed/notes"):  # fmt: skip
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return tmp_path


def test_files_folders_and_fleets_are_maps_in_their_order(folder):
    found = find_maps([folder / "b.mcap", folder / "fleet", folder / "a"])
    names = ["b.mcap", "fleet/recordings/x/map.mcap", "fleet/recordings/y/map.mcap", "a/map.mcap"]
    assert found == [folder / name for name in names]


def test_a_folder_without_a_map_is_an_error(folder):
    with pytest.raises(FleetError, match="no map here"):
        find_maps([folder / "a", folder])


def test_a_single_map_is_an_error(folder):
    with pytest.raises(FleetError, match="nothing to merge"):
        find_maps([folder / "a"])


def test_the_checksum_is_of_the_bytes(folder):
    (folder / "c.mcap").write_text("b.mcap")
    assert checksum_of(folder / "b.mcap") == checksum_of(folder / "c.mcap")
    assert checksum_of(folder / "b.mcap") != checksum_of(folder / "a" / "map.mcap")
    with pytest.raises(MapError, match="cannot be read"):
        checksum_of(folder / "none.mcap")
