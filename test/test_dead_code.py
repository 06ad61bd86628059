"""The package has no code that nothing calls, but for the list of exceptions in pyproject.toml."""

import tomllib
from pathlib import Path

import pytest

vulture = pytest.importorskip("vulture", reason="vulture is not installed (make lint)")

ROOT = Path(__file__).resolve().parents[1]
OPTIONS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["vulture"]


def unused(paths, names=()):
    found = vulture.Vulture(
        ignore_names=list(names), ignore_decorators=OPTIONS["ignore_decorators"]
    )
    found.scavenge([str(path) for path in paths])
    return {item.name for item in found.get_unused_code()}


def test_nothing_is_unused_but_the_exceptions_and_each_of_these_is():
    found = unused(ROOT / path for path in OPTIONS["paths"])
    assert found == set(OPTIONS["ignore_names"])


def test_a_function_that_only_tests_call_is_found(tmp_path):
    (tmp_path / "module.py").write_text("def used():\n    pass\n\n\ndef dead():\n    used()\n")
    assert unused([tmp_path]) == {"dead"}
    assert unused([tmp_path], ["dead"]) == set()
