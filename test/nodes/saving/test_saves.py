"""Saves that nobody requested: what is logged, and what the end of the process notes."""

import pytest

from tccm_ros.errors import MapError, OutputError
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.saving.saves import Saves


def at_once(job):
    job()


def failing(error):
    def save():
        raise error

    return save


@pytest.fixture
def lines():
    return []


@pytest.fixture
def saves(lines):
    return Saves("slam", lines.append)


def test_a_reason_is_logged_once_in_a_row(saves, lines):
    full, empty = OutputError("disk full"), MapError("nothing mapped")
    for error in (full, full, empty, full):
        saves.attempt(failing(error))
    assert lines == [
        "not saved: disk full", "not saved: nothing mapped", "not saved: disk full",
    ]  # fmt: skip


def test_a_save_that_works_lets_the_next_failure_be_logged(saves, lines):
    for save in (failing(OutputError("full")), lambda: "map", failing(OutputError("full"))):
        saves.attempt(save)
    assert lines == ["not saved: full"] * 2


def test_an_empty_map_at_the_end_is_no_failure(saves, lines):
    ending = Ending()
    saves.at_end(failing(MapError("nothing mapped")), ending, at_once)
    assert (ending.status, ending.saved, lines) == (0, {}, ["not saved: nothing mapped"])


def test_unfinished_save_at_the_end_fails_without_an_earlier_one(saves):
    ending = Ending()
    saves.at_end(lambda: "map", ending, lambda job: None)
    assert (ending.status, ending.failed) == (1, {"slam": "the save did not finish"})
    saves.at_end(lambda: "map", ending, at_once)
    saves.at_end(lambda: "newer map", ending, lambda job: None)
    assert (ending.status, ending.saved) == (0, {"slam": "map"})


def test_a_failed_save_at_the_end_is_a_failure_until_one_works(saves):
    ending = Ending()
    saves.at_end(failing(OutputError("disk full")), ending, at_once)
    assert (ending.status, ending.failed) == (1, {"slam": "disk full"})
    saves.at_end(lambda: "map: 3 surfaces", ending, at_once)
    assert (ending.status, ending.saved) == (0, {"slam": "map: 3 surfaces"})
