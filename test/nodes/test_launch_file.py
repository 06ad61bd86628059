"""The launch file starts what is installed, with the files that are installed, by their names."""

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = {
    "launch": ("LaunchDescription",),
    "launch.actions": ("DeclareLaunchArgument",),
    "launch.conditions": ("IfCondition", "UnlessCondition"),
    "launch.substitutions": ("LaunchConfiguration", "PathJoinSubstitution"),
    "launch_ros": (),
    "launch_ros.actions": ("Node",),
    "launch_ros.substitutions": ("FindPackageShare",),
}
"""What a launch file imports; launch_ros is not on PyPI."""


def recorder(kind):
    return lambda *args, **fields: SimpleNamespace(kind=kind, args=args, **fields)


@pytest.fixture
def actions(monkeypatch):
    for name, classes in MODULES.items():
        module = ModuleType(name)
        for kind in classes:
            setattr(module, kind, recorder(kind))
        monkeypatch.setitem(sys.modules, name, module)
    made = runpy.run_path(str(ROOT / "launch" / "tccm.launch.py"))["generate_launch_description"]()
    return made.args[0]


def test_both_nodes_are_started_by_their_names(actions):
    installed = set(re.findall(r'"(\w+) = tccm_ros', (ROOT / "setup.py").read_text()))
    nodes = {a.executable: (a.name, a.condition) for a in actions if a.kind == "Node"}
    assert {name: node for name, (node, _) in nodes.items()} == {
        "tccm_node": "tccm",
        "slam_node": "surface_slam",
        "managed_tccm_node": "tccm",
        "managed_slam_node": "surface_slam",
        "approach_node": "approach",
        "view_node": "view",
    }
    assert set(nodes) <= installed
    for name, (_, condition) in nodes.items():
        asked = {"approach_node": "approach", "view_node": "view"}.get(name)
        assert condition.args[0].args == (asked or "managed",)
        is_asked = asked or name.startswith("managed")
        wanted = "IfCondition" if is_asked else "UnlessCondition"
        assert condition.kind == wanted


def test_stopped_node_has_time_to_save(actions):
    for node in (a for a in actions if a.kind == "Node"):
        assert float(node.sigterm_timeout) >= 30.0
        assert float(node.sigkill_timeout) >= 15.0


def test_every_setting_is_an_argument_and_the_parameter_file_is_there(actions):
    declared = {a.args[0]: a.default_value for a in actions if a.kind == "DeclareLaunchArgument"}
    used = set(
        re.findall(
            r'LaunchConfiguration\("(\w+)"\)', (ROOT / "launch" / "tccm.launch.py").read_text()
        )
    )
    assert used == set(declared)
    assert {"odometry", "joints", "model"} <= used
    assert all(a.description for a in actions if a.kind == "DeclareLaunchArgument")
    for node in (a for a in actions if a.kind == "Node"):
        remapped = {topic for topic, _ in node.remappings}
        assert {"odom", "joint_states", "robot_description"} <= remapped
    package, *path = declared["params_file"].args[0]
    assert package.args == ("tccm_ros",)
    assert ROOT.joinpath(*path).exists()
