"""The faults of tools/faults.toml: each still applies to the code, and names tests that exist."""

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
