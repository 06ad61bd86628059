"""The faults of tools/faults.toml: each still applies to the code, and names tests that exist.

What becomes of a fault is tried on a package of one function, with tests of its own.
"""

import ast
import importlib.util
import re
import shutil
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]

SPEC = importlib.util.spec_from_file_location("faults", ROOT / "tools" / "faults.py")
tool = importlib.util.module_from_spec(SPEC)
sys.modules["faults"] = tool
SPEC.loader.exec_module(tool)
FAULTS = tool.read_faults()


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the package that faults are put into."""
    root = tmp_path_factory.mktemp("faults")
    for folder in (tool.PACKAGE, "config"):
        shutil.copytree(ROOT / folder, root / folder)
    return root


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_applies_to_the_code_as_it_is(fault, copy):
    for path in {edit.apply(copy) for edit in fault.edits}:
        changed = path.read_text()
        original = (ROOT / path.relative_to(copy)).read_text()
        path.write_text(original)
        meaning = yaml.safe_load if path.suffix == ".yaml" else lambda s: ast.dump(ast.parse(s))
        assert meaning(changed) != meaning(original)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_tests_of_a_fault_exist(fault):
    assert fault.tests
    for test in fault.tests:
        path, _, name = test.partition("::")
        source = (ROOT / path).read_text()
        assert not name or re.search(rf"^def {name.split('[')[0]}\(", source, re.MULTILINE)


def test_the_names_of_faults_differ():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)


MODULE = """
LIMIT = (1,
         2)

class Ruler:
    def length(self, x):
        if x:
            return 2  *  x
        return 0

def length(x):
    return x + x
"""


@pytest.fixture
def rulers(tmp_path, monkeypatch):
    """A package of one module, and how it is after an edit."""
    monkeypatch.setattr(tool, "PACKAGE", "small")
    (tmp_path / "small").mkdir()

    def after(place, old, new):
        (tmp_path / "small" / "rulers.py").write_text(MODULE)
        return ast.unparse(ast.parse(tool.Edit(place, old, new).apply(tmp_path).read_text()))

    return after


@pytest.mark.parametrize(
    ("place", "old", "new", "expected"),
    [
        ("Ruler.length", "2*x", "3 * x", "return 3 * x"),
        ("rulers:length", "x + x", "x", "return x"),
        ("LIMIT", "(1, 2)", "3", "LIMIT = 3"),
        ("Ruler.length", "return 2 * x", "y = x\nreturn y", "y = x\n            return y"),
        ("Ruler.length", "if x:\n    return 2 * x\nreturn 0", "return 5", "return 5"),
    ],
    ids=["expression", "function by module", "constant", "statement", "several statements"],
)
def test_an_edit_finds_its_piece_whatever_its_format(place, old, new, expected, rulers):
    changed = rulers(place, old, new)
    assert expected in changed
    assert changed != ast.unparse(ast.parse(MODULE))


@pytest.mark.parametrize(
    ("place", "old"),
    [("Ruler.length", "3 * x"), ("length", "x"), ("width", "x"), ("LIMIT", "1 2")],
    ids=["gone", "there twice", "no such place", "no Python"],
)
def test_a_piece_that_is_not_there_once_is_an_error(place, old, rulers):
    with pytest.raises(tool.FaultError):
        rulers(place, old, "2")


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
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # its tests use none


def half_fault(new, test="test/test_half.py::test_half", old="x / 2"):
    return tool.Fault(new, (tool.Edit("half", old, new),), (test,))


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
