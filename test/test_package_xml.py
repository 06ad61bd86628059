"""package.xml, setup.py, pyproject.toml and the requirement files say the same."""

import ast
import os
import re
import runpy
import sys
import tomllib
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path
from typing import Any

import generate_interfaces
import pytest
import setuptools
from lowest_versions import lowest

import tccm_ros
from tccm_sim.bundled import DEMO

ROOT = Path(__file__).resolve().parents[1]

OPTIONAL = {
    "control_msgs", "moveit_msgs", "nav2_msgs", "object_recognition_msgs", "tccm_interfaces",
    "vision_msgs",
}  # fmt: skip
"""Without these everything else works, so that they are no dependencies."""

ROSDEP = {
    "matplotlib": "python3-matplotlib", "numpy": "python3-numpy", "PIL": "python3-pil",
    "scipy": "python3-scipy", "shapely": "python3-shapely", "yaml": "python3-yaml",
}  # fmt: skip
"""Keys of rosdep of what is imported."""

PIP = {
    "PIL": "pillow",
    "yaml": "pyyaml",
    "rapidocr_onnxruntime": "rapidocr-onnxruntime",
    "rerun": "rerun-sdk",
}
"""Names on the package index of what is imported, where they differ."""

BROUGHT = {
    "anyio": "mcp",
    "distributed": "dask",
    "llvmlite": "numba",
    "lz4": "mcap",
    "onnxruntime": "rapidocr-onnxruntime",
}
"""What comes with a package that pip installs."""

TYPE = re.compile(r"([a-z0-9_]+)/(?:msg|srv|action)/\w*")
NAME = re.compile(r"[A-Za-z0-9_.-]+")


@cache
def arguments() -> dict[str, Any]:
    """Return what setup.py hands to setuptools."""
    given: dict[str, Any] = {}
    here = Path.cwd()
    os.chdir(ROOT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setuptools, "setup", lambda **fields: given.update(fields))
        runpy.run_path("setup.py")
    os.chdir(here)
    return given


def names(requirements) -> set[str]:
    return {NAME.match(line)[0] for line in requirements}


@cache
def imported() -> frozenset[str]:
    """Return the packages that the code imports, and those of the types that it names."""
    found: set[str] = set()
    folders = ("tccm_ros/**/*.py", "tccm_sim/*.py", "launch/*.py")
    for path in (p for folder in folders for p in ROOT.glob(folder)):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found.update(alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                named = TYPE.fullmatch(node.value)
                found.update({named[1]} if named else ())
    return frozenset(found - sys.stdlib_module_names - {"tccm_ros", "tccm_sim", "__future__"})


def from_pip() -> set[str]:
    """Return the packages that pip installs, with all extras."""
    extras = arguments()["extras_require"]
    return names(arguments()["install_requires"]) | names(extras["all"])


def manifest() -> ET.Element:
    return ET.parse(ROOT / "package.xml").getroot()


def depends() -> set[str]:
    return {tag.text for tag in manifest().iter("exec_depend")}


def test_every_import_is_a_dependency_or_comes_from_pip():
    for name in imported() - OPTIONAL:
        pip = PIP.get(name, BROUGHT.get(name, name))
        assert ROSDEP.get(name, name) in depends() or pip in from_pip(), name


def test_rosdep_dependencies_are_pip_dependencies():
    for name in imported() & set(ROSDEP):
        assert PIP.get(name, name) in names(arguments()["install_requires"])


def test_every_dependency_is_imported():
    assert depends() <= {ROSDEP.get(name, name) for name in imported()}
    required = {PIP.get(name, BROUGHT.get(name, name)) for name in imported()}
    assert from_pip() - {n for n in from_pip() if n.startswith("ros-jazzy-")} <= required | {
        "zstandard"  # mcap's compression
    }


def test_optional_libraries_are_no_dependencies():
    assert not OPTIONAL & depends()


def test_every_requirement_has_a_lowest_version():
    extras = arguments()["extras_require"]
    for line in (*arguments()["install_requires"], *extras["all"]):
        assert ">=" in line, line


def test_lowest_versions_are_constraints_for_pip():
    given = ["numpy<3,>=1.26", "rosbags<0.12,>=0.11.9", 'duckdb>=1.1; extra == "fleet"']
    assert lowest(given) == ["numpy==1.26", "rosbags==0.11.9"]
    with pytest.raises(ValueError, match="pillow: no lowest version"):
        lowest(["pillow"])
    assert len(lowest(arguments()["install_requires"])) == len(arguments()["install_requires"])


def test_the_extra_all_is_the_union_of_those_of_one_distribution():
    extras = dict(arguments()["extras_require"])
    everything, kilted = extras.pop("all"), extras.pop("ros-kilted")
    assert sorted(everything) == sorted(line for extra in extras.values() for line in extra)
    packages = {name.replace("-kilted-", "-jazzy-") for name in names(kilted)}
    assert packages == names(extras["ros"])


def test_manifest_and_setup_agree():
    about, given = manifest(), arguments()
    for key in ("name", "version", "license"):
        assert about.findtext(key) == given[key]
    assert about.find("maintainer").attrib["email"] == given["maintainer_email"]
    assert tccm_ros.__version__ == given["version"]


def test_pyproject_leaves_all_that_the_package_is_to_setup():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert set(settings) == {"build-system", "tool"}
    assert "setuptools" not in settings["tool"]
    lowest = re.fullmatch(r">=(\d\.\d+)", arguments()["python_requires"])[1]
    assert settings["tool"]["mypy"]["python_version"] == lowest
    assert settings["tool"]["ruff"]["target-version"] == f"py{lowest.replace('.', '')}"


@pytest.mark.parametrize("path", sorted(ROOT.glob("requirements-*.txt")), ids=lambda p: p.name)
def test_requirement_files_repeat_nothing_of_setup(path):
    lines = [line for line in path.read_text().splitlines() if line and line[0] not in "#-"]
    assert not names(lines) & from_pip()
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    assert all(line in build for line in lines if line.startswith("setuptools"))


def test_the_recording_of_the_demo_is_small():
    assert DEMO.stat().st_size <= 3_000_000


def test_only_the_generators_of_cpp_are_left_out():
    left_out = re.search(r'MATCHES "([^"]+)"', generate_interfaces.PROJECT)[1]
    needed = ("generator_c", "generator_py", "generator_type_description", "typesupport_c",
              "typesupport_fastrtps_c", "typesupport_introspection_c")  # fmt: skip
    assert not [name for name in needed if re.search(left_out, f"rosidl_{name}")]
    for name in ("generator_cpp", "typesupport_cpp", "typesupport_fastrtps_cpp"):
        assert re.search(left_out, f"rosidl_{name}")
