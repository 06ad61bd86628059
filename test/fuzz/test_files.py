"""Robot descriptions, configurations and map files: each is read, or refused by one error of ours.

Nothing in a file is executed: YAML tags, pickles and XML entities are refused.
"""

import pytest
from campaign import fuzzed
from fed import fed_slam
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.config import Config, parameters
from tccm_ros.config.reader import read_config
from tccm_ros.errors import ConfigError, MapError, UrdfError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import RobotDescription
from tccm_ros.replay.processors import Pipeline
from tccm_ros.results.map_file import load_map, save_map
from tccm_ros.robot import Robot

robot = pytest.importorskip("live_robot", reason="rclpy is not installed")

URDF = robot.URDF.format(p="", kind="revolute")

WORDS = ["<", ">", "/", '"', "0", "-1", "1e999", "nan", "joint", "link", "tilt", "&a;", "\x00", "é"]


def refusal(kind, function) -> str | None:
    """Call a function; return the text of an error of a kind, None where there was none."""
    try:
        function()
    except kind as error:
        return str(error)
    return None


@st.composite
def damaged_text(draw, text):
    """Draw a text with some pieces cut out, doubled or replaced."""
    for _ in range(draw(st.integers(0, 6))):
        i = draw(st.integers(0, len(text)))
        j = min(len(text), i + draw(st.integers(0, 40)))
        piece = draw(st.one_of(st.sampled_from(WORDS), st.just(text[i:j] * 2), st.just("")))
        text = text[:i] + piece + text[j:]
    return text


@fuzzed
@given(st.one_of(damaged_text(URDF), st.text(max_size=200)))
def test_any_robot_description_is_used_or_refused_in_one_line(text):
    pipeline = Pipeline(Config(), expects_odometry=False)
    reason = refusal(UrdfError, lambda: pipeline.add("robot_description", RobotDescription(text)))
    assert "\n" not in (reason or "")
    for topic, record in list(robot.recording(0.3)):
        pipeline.add(topic, record)


BOMB = """<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "aaaaaaaaaa">
<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">]>
<robot name="&c;"><link name="base"/></robot>"""
FILE = """<?xml version="1.0"?><!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]>
<robot name="&x;"><link name="base"/></robot>"""


@pytest.mark.parametrize("text", [BOMB, FILE])
def test_entities_are_refused(text):
    with pytest.raises(UrdfError):
        Robot(Config(), ()).add("robot_description", RobotDescription(text))


KEYS = [p.name for p in parameters()]
values = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=7), st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


@fuzzed
@given(st.sampled_from([*KEYS, "map", "rig", "nothing.here", ""]), values)
def test_any_setting_is_valid_or_refused_in_one_line(key, value):
    def read() -> None:
        Config.model_validate(read_config(None, [f"{key}={value!r}"]).model_dump())

    assert "\n" not in (refusal(ConfigError, read) or "")


@fuzzed
@given(text=st.text(max_size=300))
def test_any_configuration_file_is_read_or_refused_by_its_name(tmp_path, text):
    path = tmp_path / "config.yaml"
    path.write_text(text, encoding="utf-8", errors="replace")
    assert str(path) in (refusal(ConfigError, lambda: read_config(path)) or str(path))


@pytest.mark.parametrize(
    "text",
    [
        "map: !!python/object/apply:os.system ['echo hacked']",
        "a: &a [x,x]\nb: &b [*a,*a]\nmap: *b",
        "? {a: b}\n: c",
        "[" * 2000,
    ],
)
def test_nothing_in_a_configuration_is_executed_or_expanded(tmp_path, text):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError):
        read_config(path)


@pytest.fixture(scope="module")
def map_bytes(tmp_path_factory):
    """Return the bytes of a small map with level scans."""
    fed = fed_slam()
    fed.add(RobotDescription(URDF))
    for topic, record in robot.recording(1):
        if topic != "tilt_scan":
            fed.add(record)
    fed.finish()
    slam = fed.processor
    solution = slam.solve()
    path = tmp_path_factory.mktemp("map") / "map.mcap"
    save_map(path, slam.saved(solution), solution)
    return path.read_bytes()


@fuzzed
@given(data=st.data())
def test_a_damaged_map_is_used_or_refused_in_one_line(tmp_path, map_bytes, data):
    content = bytearray(map_bytes)
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))]
    path = tmp_path / "map.mcap"
    path.write_bytes(content)
    reason = refusal(MapError, lambda: SurfaceSlam.from_saved(Config(), load_map(path)).solve())
    assert "\n" not in (reason or "")


@fuzzed
@given(content=st.binary(max_size=300))
def test_any_bytes_that_are_no_map_are_refused(tmp_path, content):
    path = tmp_path / "map.mcap"
    path.write_bytes(content)
    with pytest.raises(MapError):
        load_map(path)
