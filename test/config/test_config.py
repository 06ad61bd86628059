"""Reading of the configuration: files, settings, and the errors of bad ones."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.config import Config, parameters
from tccm_ros.config.reader import REMOVED, read_config
from tccm_ros.errors import ConfigError

DEFAULTS = {
    "map.cell_size": 0.02,
    "map.window_cycles": 10,
    "map.cuboid_depth": 0.03,
    "map.gap": "adaptive",
    "map.mode": "union",
    "map.region": None,
    "planes.source": "map",
    "planes.height_threshold": 0.010,
    "center_core.trials": 50,
    "center_core.min_quality": 0.15,
    "surfaces.segmentation": "tccm",
    "surfaces.min_points": 500,
    "surfaces.cluster_distance": 0.10,
    "surfaces.merge_distance": 0.05,
    "surfaces.min_height": 0.3,
    "views.when": "always",
    "clock_jump": 2.0,
    "sync_timeout": 0.5,
    "reorder_window": 0.05,
    "rig.kinematics": "auto",
    "rig.tilt_offset": 0.0,
    "rig.tilt_scale": 1.0,
    "rig.joint_time_offset": 0.0,
    "qos.reliability": "best_effort",
}
"""Names and values that users rely on."""


def value_of(config, dotted):
    for part in dotted.split("."):
        config = getattr(config, part)
    return config


@pytest.mark.parametrize(("name", "value"), DEFAULTS.items())
def test_names_and_defaults_that_users_rely_on_stay(name, value):
    assert value_of(Config(), name) == value
    assert name in {p.name for p in parameters()}


def test_every_parameter_has_a_meaning_of_one_line():
    for parameter in parameters():
        assert parameter.meaning, parameter.name
        assert "\n" not in parameter.meaning, parameter.name
        assert not parameter.meaning.endswith("."), parameter.name


def test_settings_override_the_file_and_the_file_the_defaults(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("map:\n  cell_size: 0.03\n  window_cycles: 5\nsync_timeout: 1\n")
    config = read_config(path, ["map.window_cycles=7"])
    assert (config.map.cell_size, config.map.window_cycles) == (0.03, 7)
    assert config.sync_timeout == 1.0


def test_the_ros_form_of_a_file_is_read(tmp_path):
    path = tmp_path / "ros.yaml"
    path.write_text("/**:\n  ros__parameters:\n    map:\n      cell_size: 0.03\n")
    assert read_config(path).map.cell_size == 0.03
    path.write_text("/**:\n  ros__parameters:\n    map.cell_size: 0.04\n")
    assert read_config(path).map.cell_size == 0.04


def test_an_empty_file_changes_nothing(tmp_path):
    path = tmp_path / "empty.yaml"
    path.write_text("")
    assert read_config(path) == Config()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("map.cell_sise=0.02", "did you mean 'map.cell_size'"),
        ("mapp.cell_size=0.02", "did you mean 'map.cell_size'"),
        ("map.cell_size", "write group.key=value"),
        ("map.cell_size=wide", "map.cell_size.*found 'wide'"),
        ("map.cell_size=5", "map.cell_size.*found 5"),
        ("map.cell_size=.nan", "map.cell_size"),
        ("map.gap=wide", "map.gap"),
        ("map.window_cycles=2.5", "map.window_cycles"),
        ("rig.tilt_laser=[1, 2]", "rig.tilt_laser"),
        ("rig.tilt_laser=[0, 0, .nan, 0, 0, 0]", "rig.tilt_laser"),
        ("map.cell_size=[", "not a YAML value"),
        ("map=3", "map is a group"),
        ("=3", "unknown key"),
    ],
)
def test_a_bad_setting_is_an_error_of_one_line(setting, message):
    with pytest.raises(ConfigError, match=message) as caught:
        read_config(None, [setting])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("map: [", "not a YAML file"),
        ("- 1\n- 2\n", "a mapping of groups is expected"),
        ("map: !!python/object/apply:os.system ['true']\n", "not a YAML file"),
        ("map:\n  cell_sise: 1\n", "unknown key 'map.cell_sise'"),
        ("1: 2\n", "unknown key"),
        ("map:\n  1: 2\n", "unknown key"),
    ],
)
def test_the_error_of_a_bad_file_names_it(tmp_path, text, message):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        read_config(path)
    assert str(path) in str(caught.value)


def test_a_missing_or_binary_file_is_an_error(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        read_config(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigError):
        read_config(tmp_path / "binary.yaml")


@pytest.mark.parametrize("name", REMOVED)
def test_a_parameter_of_release_0_1_that_is_gone_is_ignored_with_a_warning(name, tmp_path, caplog):
    group, key = name.split(".")
    path = tmp_path / "old.yaml"
    old = {key: True} | ({"cell_size": 0.03} if group == "map" else {})
    path.write_text(yaml.safe_dump({"map": {"cell_size": 0.03}} | {group: old}))
    assert read_config(path) == read_config(None, ["map.cell_size=0.03"])
    (warning,) = caplog.messages
    assert warning == f"{path}: {name} is ignored: {REMOVED[name]}"
    assert read_config(None, [f"{name}=true"]) == Config()
    assert caplog.messages[1].startswith(f"--set {name}=true: {name} is ignored")


def test_assignments_are_checked():
    config = Config()
    with pytest.raises(ValueError):
        config.map.cell_size = -1.0


@given(st.text(max_size=40))
def test_any_setting_is_read_or_refused(text):
    with pytest.raises(ConfigError):
        read_config(None, ["map.no_such_key=" + text])
    try:
        read_config(None, [text])
    except ConfigError as error:
        message = str(error)
    else:
        message = ""
    assert len(message) < 1000
