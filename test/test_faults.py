"""The faults of tools/faults.toml: each still applies to the code, and names tests that exist.

What becomes of a fault is tried on a package of one function, with tests of its own.
"""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

SPEC = importlib.util.spec_from_file_location("faults", ROOT / "tools" / "faults.py")
tool = importlib.util.module_from_spec(SPEC)
sys.modules["faults"] = tool
SPEC.loader.exec_module(tool)
FAULTS = tool.read_faults()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_applies_to_the_code_as_it_is(fault, tmp_path):
    for name in {edit.file for edit in fault.edits}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text((ROOT / name).read_text())
    for edit in fault.edits:
        edit.apply(tmp_path)
    for name in {edit.file for edit in fault.edits}:
        compile((tmp_path / name).read_text(), name, "exec")


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_tests_of_a_fault_exist(fault):
    assert fault.tests
    for test in fault.tests:
        path, _, name = test.partition("::")
        source = (ROOT / path).read_text()
        assert not name or re.search(rf"^def {name.split('[')[0]}\(", source, re.MULTILINE)


def test_the_names_of_faults_differ():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)


def test_a_text_that_is_gone_or_there_twice_is_an_error(tmp_path):
    (tmp_path / "module.py").write_text("x = 1\ny = 1\n")
    for old in ("z = 1", "1"):
        with pytest.raises(tool.FaultError, match="expected once"):
            tool.Edit("module.py", old, "2").apply(tmp_path)
    tool.Edit("module.py", "x = 1", "x = 2").apply(tmp_path)
    assert (tmp_path / "module.py").read_text() == "x = 2\ny = 1\n"


HALF = """
def half(x):
    return x / 2
"""

TESTS = """
import time

import pytest

from small.halves import half


def test_half():
    assert half(4) == 2


@pytest.fixture
def two():
    return half(4) + "" if half(4) != 2 else 2


def test_with_a_fixture(two):
    assert two == 2


def test_that_ends():
    while half(4) != 2:
        time.sleep(0.01)
"""

HALVES = "small/halves.py"


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A repository with a package of one function in place of this one."""
    for name, text in (("small/__init__.py", ""), (HALVES, HALF), ("test/test_half.py", TESTS)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\n")
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    monkeypatch.setattr(tool, "PACKAGE", "small")


def half_fault(new, test="test/test_half.py::test_half", old="x / 2"):
    return tool.Fault(new, (tool.Edit(HALVES, old, new),), (test,))


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (half_fault("x / 3"), "killed"),
        (half_fault("x / None"), "killed"),
        (half_fault("x * 0.5"), "SURVIVED"),
        (half_fault("x / 3", old="x % 2"), "ERROR"),
        (half_fault("x /"), "ERROR"),
        (half_fault("y / 2"), "ERROR"),
        (half_fault("__import__('there_is_none')"), "ERROR"),
        (half_fault("def third", old="def half"), "ERROR"),
        (half_fault("x / 3", "test/test_half.py::test_third"), "ERROR"),
        (half_fault("x / 3", "test/test_third.py"), "ERROR"),
        (half_fault("x / 3", "test/test_half.py::test_with_a_fixture"), "ERROR"),
    ],
    ids=[
        "wrong",
        "raises",
        "the same",
        "text not there",
        "no Python",
        "name not there",
        "module not there",
        "test cannot be imported",
        "test not there",
        "file not there",
        "fixture fails",
    ],
)
def test_only_a_test_that_ran_and_failed_kills(fault, expected, capsys):
    assert tool.outcome(fault) == expected
    assert capsys.readouterr().out.startswith(expected)


@pytest.mark.usefixtures("small")
def test_tests_that_do_not_end_kill_nothing():
    fault = half_fault("x / 3", "test/test_half.py::test_that_ends")
    with pytest.raises(tool.FaultError, match="no end within"):
        tool.run_tests(fault.tests, fault.edits, timeout_s=3.0)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("news", "line", "status"),
    [
        (["x / 3"], "1 killed, 0 survived", 0),
        (["x / 3", "x * 0.5"], "1 killed, 1 survived", 1),
        (["x / 3", "x * 0.5", "x /"], "1 killed, 1 survived, 1 not tried", 2),
    ],
)
def test_the_status_is_0_only_where_all_are_killed(news, line, status, capsys):
    assert tool.run([half_fault(new) for new in news], jobs=1) == status
    assert capsys.readouterr().out.splitlines()[-1] == line


@pytest.mark.usefixtures("small")
def test_no_fault_is_tried_with_tests_that_fail_without_one(capsys):
    (tool.ROOT / HALVES).write_text(HALF.replace("/ 2", "/ 5"))
    assert tool.run([half_fault("x / 3", old="x / 5")], jobs=1) == 2
    assert capsys.readouterr().out.startswith("ERROR     tests fail without any fault")


def test_a_name_that_no_fault_has_is_an_error(capsys):
    assert tool.run([], jobs=1) == 2
    assert capsys.readouterr().out == "ERROR     no fault has such a name\n"
