"""The generator: what is there is left alone, and what cannot be made is said in a sentence."""

import subprocess
import sys
import sysconfig
from pathlib import Path

import generate_interfaces
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def package(tmp_path) -> Path:
    """A package that no environment has."""
    (tmp_path / "never_generated_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "never_generated_msgs" / "msg" / "Some.msg").write_text("int32 number\n")
    return tmp_path / "never_generated_msgs"


def generate(*folders: Path) -> subprocess.CompletedProcess:
    """Run the generator where there is no compiler."""
    return subprocess.run(
        [sys.executable, ROOT / "tools" / "generate_interfaces.py", *folders],
        env={"PATH": ""}, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_without_a_compiler_the_missing_tool_is_named(package):
    done = generate(package)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "no interfaces are generated: cmake, make, c++ not installed",
        "all else works without what is missing of never_generated_msgs",
    ]


def test_up_to_date_files_are_left_alone():
    pytest.importorskip("tccm_interfaces", reason="tccm_interfaces is not generated")
    done = generate(ROOT / "interfaces")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_changed_definition_is_generated_again(tmp_path):
    pytest.importorskip("tccm_interfaces", reason="tccm_interfaces is not generated")
    changed = tmp_path / "interfaces"
    (changed / "msg").mkdir(parents=True)
    (changed / "package.xml").write_bytes((ROOT / "interfaces" / "package.xml").read_bytes())
    (changed / "msg" / "Other.msg").write_text("int32 number\n")
    done = generate(changed)
    assert done.returncode == 1
    assert "all else works without what is missing of tccm_interfaces" in done.stderr


def test_paths_of_any_other_python_become_ours(tmp_path):
    """A cached wheel named an environment that was gone; every package on its messages failed."""
    cached = tmp_path / "cached.cmake"
    cached.write_text(
        'INCLUDE "/opt/python/cp311-cp311/include/python3.11;'
        '/gone/.venv/lib/python3.11/site-packages/numpy/_core/include"\n'
        '"${DIR}/../../../lib/python3.11/site-packages"\n'
    )
    before = cached.read_text()
    (tmp_path / "share").mkdir()
    (tmp_path / "share" / "export.cmake").hardlink_to(cached)
    generate_interfaces.point_cmake_at(tmp_path)
    assert (tmp_path / "share" / "export.cmake").read_text() == (
        f'INCLUDE "{sysconfig.get_path("include")};'
        f'{sysconfig.get_path("purelib")}/numpy/_core/include"\n'
        '"${DIR}/../../../lib/python3.11/site-packages"\n'
    )
    assert cached.read_text() == before


def test_the_mark_of_a_copied_environment_stays(package, tmp_path, monkeypatch):
    """Both were hard links: the other environment took its old messages for the new ones."""
    ours, copied = (tmp_path / name / "share" / package.name for name in ("ours", "copied"))
    for folder in (ours, copied):
        folder.mkdir(parents=True)
    (copied / generate_interfaces.MARK).write_text("older definitions")
    (ours / generate_interfaces.MARK).hardlink_to(copied / generate_interfaces.MARK)
    monkeypatch.setattr(generate_interfaces, "run", lambda *arguments: None)
    generate_interfaces.generate(package, tmp_path / "ours")
    assert (ours / generate_interfaces.MARK).read_text() == generate_interfaces.digest(package)
    assert (copied / generate_interfaces.MARK).read_text() == "older definitions"
