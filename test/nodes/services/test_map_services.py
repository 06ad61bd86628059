"""Names of maps stay in their folder."""

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.errors import MapError
from tccm_ros.nodes.saving.map_folder import PREVIOUS
from tccm_ros.nodes.services.map_services import named_folder, saved_folders
from tccm_ros.results.labels_file import MAP_FILE

SIGNS = string.ascii_letters + string.digits + "._-"


@given(st.text(max_size=120))
def test_a_folder_of_any_name_lies_in_the_root(tmp_path_factory, name):
    root = tmp_path_factory.getbasetemp()
    try:
        folder = named_folder(root, name)
    except MapError:
        return
    assert folder.resolve().parent == root.resolve()
    assert set(name) <= set(SIGNS)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a/b", "/a", "a\0b", "a\n", ".a", "a" * 101, "a" + PREVIOUS, "ä"]
)
def test_wrong_names_are_refused(tmp_path, name):
    with pytest.raises(MapError, match="cannot be the name of a map"):
        named_folder(tmp_path, name)


def test_a_link_out_of_the_root_is_refused_and_not_listed(tmp_path):
    root, other = tmp_path / "maps", tmp_path / "other"
    for folder in (root / "home", other):
        folder.mkdir(parents=True)
        (folder / MAP_FILE).touch()
    (root / "link").symlink_to(other)
    (root / ("home" + PREVIOUS)).mkdir()
    (root / "empty").mkdir()
    with pytest.raises(MapError, match="leads out of"):
        named_folder(root, "link")
    assert saved_folders(root) == [root / "home"]
    assert named_folder(root, "home") == root / "home"


def test_a_root_that_is_a_link_itself_holds_its_maps(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "maps").symlink_to(tmp_path / "disk")
    assert named_folder(tmp_path / "maps", "home").resolve() == tmp_path / "disk" / "home"
    assert saved_folders(tmp_path / "nowhere") == []
