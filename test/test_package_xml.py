"""package.xml names each ROS and Debian package that is imported, and no other."""

import ast
import re
import sys
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

OPTIONAL = {
    "control_msgs", "moveit_msgs", "object_recognition_msgs", "tccm_interfaces", "vision_msgs",
}  # fmt: skip
"""Without these everything else works, so that they are no dependencies."""

ROSDEP = {
    "matplotlib": "python3-matplotlib", "numpy": "python3-numpy", "PIL": "python3-pil",
    "scipy": "python3-scipy", "shapely": "python3-shapely", "yaml": "python3-yaml",
}  # fmt: skip

BROUGHT = {"llvmlite": "numba", "lz4": "mcap", "onnxruntime": "rapidocr_onnxruntime"}
"""What comes with a package that pip installs."""

TYPE = re.compile(r"([a-z0-9_]+)/(?:msg|srv|action)/\w*")


@cache
def imported() -> frozenset[str]:
    """Return the packages that the code imports, and those of the types that it names."""
    found: set[str] = set()
    for path in (*ROOT.glob("tccm_ros/**/*.py"), *ROOT.glob("launch/*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found.update(alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                named = TYPE.fullmatch(node.value)
                found.update({named[1]} if named else ())
    return frozenset(found - sys.stdlib_module_names - {"tccm_ros", "__future__"})


def depends() -> set[str]:
    return {tag.text for tag in ET.parse(ROOT / "package.xml").iter("exec_depend")}


def from_pip() -> str:
    files = ("requirements.txt", "requirements-signs.txt", "setup.py")
    return "\n".join((ROOT / name).read_text() for name in files).lower().replace("-", "_")


def test_every_import_is_a_dependency_or_comes_from_pip():
    lines = from_pip()
    missing = {
        name
        for name in imported() - OPTIONAL
        if ROSDEP.get(name, name) not in depends()
        and not re.search(rf"\b{BROUGHT.get(name, name).lower()}", lines)
    }
    assert not missing


def test_every_dependency_is_imported():
    names = {ROSDEP.get(name, name) for name in imported()}
    assert depends() <= names


def test_what_is_optional_is_no_dependency():
    assert not OPTIONAL & depends()
