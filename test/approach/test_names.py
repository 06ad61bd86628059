"""The file of named spots: what is read, refused and written."""

import os
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.approach.names import NamedSpot, read_names, spot_of, write_names
from tccm_ros.errors import ConfigError, OutputError

FILE = """
kitchen/counter: {labels: [counter], near_sign: kitchen}
living/dinner_table: {ids: [3], spot: [0.2, -0.1], side: 1.5}
"""


def test_names_of_a_file(tmp_path):
    path = tmp_path / "named_poses.yaml"
    path.write_text(FILE)
    assert read_names(path) == {
        "kitchen/counter": NamedSpot(labels=("counter",), near_sign="kitchen"),
        "living/dinner_table": NamedSpot(ids=(3,), spot=(0.2, -0.1), side=1.5),
    }


@pytest.mark.parametrize("text", [None, "", "# nothing yet\n"])
def test_without_entries_there_are_no_names(tmp_path, text):
    path = tmp_path / "named_poses.yaml"
    if text is not None:
        path.write_text(text)
    assert read_names(path) == {}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("- a\n", "has no names"),
        ("a: [b\n", "cannot be read as YAML"),
        ("a b: {ids: [1]}\n", "'a b' is no name"),
        ("/a: {ids: [1]}\n", "'/a' is no name"),
        ("a: 3\n", "a: expected a surface"),
        ("a: {}\n", "a: expected a surface"),
        ("a: {id: [1]}\n", "a: no key 'id'; did you mean 'ids'?"),
        ("a: {ids: [-1]}\n", "a: ids has -1"),
        ("a: {ids: [true]}\n", "a: ids has True"),
        ("a: {ids: 3}\n", "a: "),
        ("a: {spot: [0, 0]}\n", "a: no surface is selected"),
        ("a: {ids: [1], spot: [0, .nan]}\n", "a: nan is no number"),
        ("a: {ids: [1], spot: [0, 0, 0]}\n", "a: spot is"),
        ("a: {ids: [1], spot: [0, 11]}\n", "a: 11 is no number of at most 10"),
        ("a: {ids: [1], side: .inf}\n", "a: inf is no number"),
        ("a: {labels: [3]}\n", "a: 3 is not a string"),
    ],
)
def test_mistake_is_reported_with_its_name(tmp_path, text, why):
    path = tmp_path / "named_poses.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as error:
        read_names(path)
    assert why in str(error.value)
    assert "\n" not in str(error.value)


numbers = st.floats(-6.0, 6.0, allow_subnormal=False)
words = st.text("abcdef ghi", max_size=8)
spots = st.builds(
    NamedSpot,
    ids=st.lists(st.integers(0, 2**31 - 1), min_size=1, max_size=3).map(tuple),
    labels=st.lists(words.filter(bool), max_size=2).map(tuple),
    near_sign=words,
    text=words,
    spot=st.none() | st.tuples(numbers, numbers),
    side=st.none() | numbers,
)
names = st.from_regex(r"[A-Za-z0-9_-]{1,8}(/[a-z0-9]{1,8})?", fullmatch=True)


@given(st.dictionaries(names, spots, max_size=4))
def test_written_names_are_read(tmp_path_factory, entries):
    path = tmp_path_factory.mktemp("names") / "named_poses.yaml"
    write_names(path, entries)
    assert read_names(path) == entries


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda x: st.lists(x, max_size=3) | st.dictionaries(st.text(), x, max_size=3),
    )
)
def test_no_entry_ends_in_another_error(entry):
    for key in ("ids", "labels", "spot", "side", "text"):
        for made in (entry, {key: entry}, {"ids": [1], key: entry}):
            with suppress(ConfigError):
                assert isinstance(spot_of("a", made), NamedSpot)


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_file_that_cannot_be_written_stays(tmp_path):
    path = tmp_path / "named_poses.yaml"
    path.write_text(FILE)
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError):
        write_names(path, {})
    tmp_path.chmod(0o700)
    assert len(read_names(path)) == 2
