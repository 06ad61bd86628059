"""The lint of the words finds names and sentences, and leaves alone what is neither."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TOOL = runpy.run_path(str(ROOT / "tools" / "check_words.py"))
CHECKER = TOOL["Checker"]()


def found(path, source):
    return [(place.line, place.private) for place in CHECKER.check(path, source)]


@pytest.mark.parametrize(
    ("source", "private"),
    [
        ("def hand_over_points(): ...", "hand-over"),
        ("class LyingPlane: ...", "lying"),
        ("def f(longest_reach): ...", "reach"),
        ("share, rest = 1, 2", "share"),
        ("x.knots_ns = []", "knot"),
        ("x = 1  # the sweep of a joint", "sweep"),
        ('raise ValueError("a sweep is too short")', "sweep"),
        ('def f():\n    """Return a plane.\n\n    It is upright.\n    """', "standing, upright"),
    ],
)
def test_private_words_are_found_in_names_comments_and_messages(source, private):
    assert private in {word for _, word in found("tccm_ros/example.py", source)}


def test_the_name_of_a_module_is_a_name():
    assert found("tccm_ros/surfaces/lineage.py", '"""Identities."""')
    assert found("tccm_ros/cuboids/state.py", '"""A map."""')
    assert not found("tccm_ros/cuboids/part_map.py", '"""A map."""')


@pytest.mark.parametrize(
    "source",
    [
        "sweeper = 1",
        "points = heir_of(x)",
        'KEY = "sweep"',
        "unit = 1  # unity, something, unsettled weather, bound, pieces",
        "def at_last(): ...",
    ],
)
def test_a_word_within_another_and_a_name_that_is_only_used_are_not_found(source):
    assert not found("tccm_ros/example.py", source)


def test_a_document_is_checked_in_its_sentences_alone():
    text = "\n".join(["`min_sweep`", "[a](sweep.md)", "```", "a sweep", "```", "A *sweep* ends."])
    assert found("example.md", text) == [(6, "sweep")]


def test_an_exception_counts_for_its_file_and_its_line_alone():
    line = "    reach: float = 1"
    assert not found("tccm_ros/config/example.py", f"class A:\n{line}")
    assert found("tccm_ros/slam/example.py", f"class A:\n{line}")
    assert found("tccm_ros/config/example.py", "class A:\n    the_reach: float = 1")


def test_every_exception_has_a_reason():
    assert all(entry["reason"] for entry in CHECKER.exceptions)
