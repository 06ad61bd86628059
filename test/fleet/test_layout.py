"""The folders of a fleet and those of two recordings differ."""

from pathlib import Path

from tccm_ros.fleet.layout import FleetFolder


def test_nothing_of_a_fleet_stands_in_the_folder_of_a_recording():
    folder = FleetFolder(Path("/fleet"))
    parts = {folder.recordings, folder.failures, folder.catalogue, folder.page}
    assert len(parts) == 4
    assert {part.parent for part in parts} == {folder.path}
    assert folder.results("a").parent == folder.recordings
    assert folder.failure("a").parent == folder.failures
