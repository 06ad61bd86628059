"""Recordings are found in files, folders, patterns and URLs, and keep their names."""

import os

import fsspec
import pytest
from fleet_bags import write_recordings

from tccm_ros.errors import FleetError
from tccm_ros.fleet.recordings import (
    Recording,
    content_checksum,
    file_states,
    find_recordings,
    local_copy,
)


@pytest.fixture
def archive(tmp_path):
    """A folder as archives are: rosbag2 folders, bare files, results, and hidden files."""
    root = tmp_path / "archive"
    for name in ("a/metadata.yaml", "a/a_0.mcap", "b/one.mcap", "b/two.db3", "b/notes.txt",
                 "b/deeper/three.mcap.zstd", "results/surfaces.json", "results/map.mcap",
                 ".hidden/four.mcap"):  # fmt: skip
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return root


def sources(found):
    return [recording.source for recording in found]


def test_a_folder_is_searched_at_any_depth(archive):
    expected = ["a", "b/deeper/three.mcap.zstd", "b/one.mcap", "b/two.db3"]
    assert sources(find_recordings([str(archive)])) == [str(archive / e) for e in expected]


def test_a_pattern_and_a_folder_name_a_recording_once(archive):
    found = find_recordings([str(archive / "b" / "*.mcap"), str(archive / "b")])
    assert len(found) == len(set(sources(found))) == 3


def test_urls_are_searched_like_folders(archive):
    found = find_recordings([f"file://{archive}"])
    assert sources(found) == sources(find_recordings([str(archive)]))


def test_the_same_end_of_two_paths_gives_two_names(tmp_path):
    one, other = Recording.of("/x/run.mcap"), Recording.of("/y/run.mcap")
    assert one.name != other.name
    assert one.name.startswith("run-")
    assert Recording.of("/x/run.mcap") == one


def test_a_name_is_the_name_of_one_plain_folder():
    for source in ("s3://bucket/a b/../.run?.mcap", "/x/.hidden", "/x/ü/run/"):
        name = Recording.of(source).name
        assert os.sep not in name
        assert not name.startswith(".")


def test_an_empty_folder_is_an_error(tmp_path):
    with pytest.raises(FleetError, match="no recording"):
        find_recordings([str(tmp_path)])


def test_a_pattern_without_a_match_is_an_error(tmp_path):
    with pytest.raises(FleetError, match="no recording"):
        find_recordings([str(tmp_path / "*.mcap")])


def test_a_url_without_a_driver_is_an_error():
    with pytest.raises(FleetError, match="nosuch"):
        find_recordings(["nosuch://bucket/run.mcap"])


def test_a_missing_file_is_left_to_its_task(tmp_path):
    path = str(tmp_path / "missing.mcap")
    assert sources(find_recordings([path])) == [path]


def test_a_copy_from_a_remote_file_system_has_the_same_content(tmp_path):
    bags = write_recordings(tmp_path / "bags", 1)
    remote = fsspec.filesystem("memory")
    remote.put(str(bags), "/archive", recursive=True)
    try:
        (found,) = find_recordings(["memory://archive"])
        assert found.source == "memory:///archive/robot_0"
        with local_copy(found.source) as path:
            assert content_checksum(path) == content_checksum(bags / "robot_0")
        assert not path.exists()
    finally:
        remote.rm("/archive", recursive=True)


def test_states_detect_a_rewritten_file(archive):
    path = archive / "a"
    before = file_states(str(path))
    assert before == file_states(str(path))
    (path / "a_0.mcap").write_text("a/a_0.mcbp")
    after = file_states(str(path))
    assert [s.name for s in before] == [s.name for s in after] == ["a_0.mcap", "metadata.yaml"]
    assert before[0] != after[0]
    assert before[1] == after[1]


def test_the_checksum_is_of_names_and_bytes_alone(archive):
    path = archive / "a"
    before = content_checksum(path)
    os.utime(path / "a_0.mcap", (1, 1))
    assert content_checksum(path) == before
    (path / "a_0.mcap").rename(path / "a_1.mcap")
    assert content_checksum(path) != before
