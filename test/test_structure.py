"""The walls between the rooms: who may import whom."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "tccm_ros"

ROOMS = [
    "errors",
    "config",
    "config_file",
    "config_text",
    "progress",
    "stopwatch",
    "snapshot",
    "geometry",
    "records",
    "messages",
    "kinematics",
    "scan_kernels",
    "scan",
    "stamps",
    "sync",
    "mapping",
    "slam",
    "surfaces",
    "publications",
    "io",
    "info",
    "pipeline",
    "sim",
    "report",
    "evaluate",
    "replay",
    "calibrate",
    "nodes",
    "cli",
]
"""Top to bottom; a module imports only what stands above it, or its own room."""

GTSAM_ROOMS = {"slam/graph.py", "slam/factors"}


def modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module)
            if node.module == "tccm_ros":
                names |= {f"tccm_ros.{a.name}" for a in node.names if a.name != "__version__"}
    return names


def test_no_two_files_of_tests_have_one_name():
    names = [path.name for path in Path(__file__).parent.rglob("test_*.py")]
    assert len(names) == len(set(names)), "pytest imports test files by their names alone"


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_rooms_above_it(path: Path):
    room = room_of(path)
    assert room in ROOMS, f"{room} is not in the plan of the house"
    used = {n.split(".")[1] for n in imports(path) if n.startswith("tccm_ros.")}
    below = {name for name in used - {room} if ROOMS.index(name) > ROOMS.index(room)}
    assert not below, f"{path.name} reaches down to {sorted(below)}"


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_only_nodes_know_ros_and_only_the_graph_knows_gtsam(path: Path):
    tops = {name.split(".")[0] for name in imports(path)}
    ros = {top for top in tops if top == "rclpy" or top.endswith("_msgs") or top.endswith("_srvs")}
    assert not ros or room_of(path) == "nodes"
    place = path.relative_to(PACKAGE)
    assert "gtsam" not in tops or {str(place), str(place.parent)} & GTSAM_ROOMS


def test_the_simulator_shares_no_geometry_with_the_mapping():
    forbidden = {"tccm_ros.kinematics", "tccm_ros.scan", "tccm_ros.geometry", "tccm_ros.sync"}
    used = set().union(*(imports(path) for path in (PACKAGE / "sim").glob("*.py")))
    assert not used & forbidden
