"""Messages that help."""

import inspect

import pytest

from tccm_ros import errors
from tccm_ros.errors import TccmError, one_line, suggest


def test_every_error_has_the_common_base_class():
    families = [
        e for _, e in inspect.getmembers(errors, inspect.isclass) if e.__module__ == errors.__name__
    ]
    assert len(families) > 5
    assert all(issubclass(e, TccmError) for e in families)


@pytest.mark.parametrize(
    ("name", "known", "clause"),
    [
        ("oddom", ["odom", "scan"], "; did you mean 'odom'?"),
        ("x", ["scan", "odom"], "; there are: odom, scan"),
        ("x", [], "; there are none"),
        ("", ["a"], "; there are: a"),
    ],
)
def test_a_suggestion_names_a_similar_name_or_all(name, known, clause):
    assert suggest(name, known) == clause


def test_a_long_list_of_names_is_cut():
    clause = suggest("x", (f"topic{i:02}" for i in range(50)))
    assert clause.endswith("topic11, ...")


def test_the_text_of_any_error_becomes_one_short_line():
    assert one_line(ValueError("a\n  b\tc")) == "a b c"
    assert one_line(KeyError()) == "KeyError"
    assert len(one_line(ValueError("x" * 1000))) == 200
