"""The command as users type it: what goes wrong ends in one line, status 1 and nothing written."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tccm_ros import cli
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.records import JointSample, RobotDescription, Scan
from tccm_ros.ros.writing import scan_message
from tccm_sim.sensor_messages import joint_sample_message, robot_description_message

BAGS = Path(__file__).parent.parent / "bags"
START_NS = 1_700_000_000_000_000_000
URDF = """<robot name="r"><link name="base_link"/><link name="moving"/><link name="laser"/>
<joint name="tilt" type="revolute"><parent link="base_link"/><child link="moving"/>
<origin xyz="0 0 1"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="mount" type="fixed"><parent link="moving"/><child link="laser"/></joint></robot>"""


def write_bag(path, *, urdf=URDF, joint="tilt", scans=True, topic="/tilt_scan"):
    types = TypestoreMessages()
    with BagWriter(path) as bag:
        model = robot_description_message(types, RobotDescription(urdf))
        bag.write("/robot_description", "std_msgs/msg/String", START_NS, model)
        for i in range(200):
            stamp = START_NS + i * 10_000_000
            sample = JointSample(stamp, (joint,), np.array([0.3 * np.sin(0.1 * i)]))
            message = joint_sample_message(types, sample)
            bag.write("/joint_states", "sensor_msgs/msg/JointState", stamp, message)
            if scans and i % 3 == 1:
                ranges = np.full(90, 2.0, np.float32)
                scan = Scan(stamp - 5_000_000, "laser", -0.8, 0.02, 0.0, 0.1, 10.0, ranges)
                bag.write(topic, "sensor_msgs/msg/LaserScan", stamp, scan_message(types, scan))
    return path


def run(capsys, monkeypatch, *arguments):
    """Run the command in this process; return its status and both outputs."""
    monkeypatch.setattr(sys, "argv", ["tccm", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, err = capsys.readouterr()
    return end.value.code or 0, out, err


def fails(capsys, monkeypatch, tmp_path, bag, *more):
    out = tmp_path / "out"
    status, _, err = run(capsys, monkeypatch, "replay", bag, "--out", out, "--quiet", *more)
    assert status == 1
    assert err.startswith("tccm: ")
    assert err.count("\n") == 1, err
    assert not out.exists()
    assert not list(tmp_path.glob(".out*"))
    return err


@pytest.fixture
def check(capsys, monkeypatch, tmp_path):
    return lambda bag, *more: fails(capsys, monkeypatch, tmp_path, bag, *more)


def test_a_missing_bag_is_an_error_of_one_line(check, tmp_path):
    assert "nowhere" in check(tmp_path / "nowhere")


def test_an_empty_file_is_an_error_of_one_line(check, tmp_path):
    path = tmp_path / "empty.mcap"
    path.touch()
    assert "empty.mcap" in check(path)


def test_a_truncated_bag_is_an_error_of_one_line(check, tmp_path):
    whole = (write_bag(tmp_path / "bag") / "bag.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    assert "recover" in check(path)


def test_a_file_of_random_bytes_is_an_error_of_one_line(check, tmp_path):
    path = tmp_path / "garbage.mcap"
    path.write_bytes(bytes(range(256)) * 40)
    assert "garbage.mcap" in check(path)


def test_an_error_without_scans_names_the_topics_of_the_bag(check, tmp_path):
    write_bag(tmp_path / "bag", topic="/head_scan")
    err = check(tmp_path / "bag", "--remap", "tilt_scan:=/heat_scan")
    assert "/heat_scan" in err
    assert "/head_scan" in err


def test_an_error_of_a_missing_joint_names_the_joints_of_the_bag(check, tmp_path):
    err = check(write_bag(tmp_path / "bag"), "--set", "frames.tilt_joint=tlit")
    assert "tlit" in err
    assert "'tilt'" in err


def test_joint_samples_of_other_joints_are_named(check, tmp_path):
    err = check(write_bag(tmp_path / "bag", joint="elbow"))
    assert "tilt" in err
    assert "elbow" in err


def test_an_error_of_an_unconnected_laser_names_the_frames(check, tmp_path):
    err = check(write_bag(tmp_path / "bag", urdf=URDF.replace("laser", "lidar")))
    assert "base_link" in err
    assert "laser" in err


def test_a_broken_urdf_is_an_error_of_one_line(check, tmp_path):
    assert "robot description" in check(write_bag(tmp_path / "bag", urdf="<robot><link"))


def test_an_error_of_an_unknown_key_names_a_similar_one(check, tmp_path):
    bag = write_bag(tmp_path / "bag")
    assert "map.cell_size" in check(bag, "--set", "map.cel_size=0.02")
    assert "map.cell_size" in check(bag, "--set", "map.cell_size=7")


def test_a_folder_that_cannot_be_written_is_an_error_of_one_line(capsys, monkeypatch, tmp_path):
    bag = write_bag(tmp_path / "bag")
    (tmp_path / "file").touch()
    status, _, err = run(capsys, monkeypatch, "replay", bag, "--out", tmp_path / "file", "-q")
    assert status == 1
    assert "file" in err
    assert (tmp_path / "file").read_bytes() == b""


def test_wrong_usage_has_exit_status_2(capsys, monkeypatch):
    assert run(capsys, monkeypatch, "replay")[0] == 2
    assert run(capsys, monkeypatch, "replya")[0] == 2


def test_info_of_a_bag_is_printed_as_text_or_json(capsys, monkeypatch, tmp_path):
    bag = write_bag(tmp_path / "bag")
    status, out, _ = run(capsys, monkeypatch, "info", bag, "--json")
    assert status == 0
    names = {topic["name"]: topic["count"] for topic in json.loads(out)["topics"]}
    assert names["/joint_states"] == 200


def test_info_distinguishes_the_lasers(capsys, monkeypatch):
    """Of two lasers with other names, the one that a joint moves is the tilting one."""
    _, out, _ = run(capsys, monkeypatch, "info", BAGS / "upside_down")
    assert out.splitlines()[-1] == (
        f"try tccm replay {BAGS / 'upside_down'} --out map "
        "--remap tilt_scan:=/nod_lidar/scan --remap joint_states:=/dynamixel/joint_states "
        "--remap odom:=/wheel_odom --remap scan:=/front_lidar/scan"
    )


def test_info_gives_no_laser_two_roles(capsys, monkeypatch, tmp_path):
    bag = write_bag(tmp_path / "bag", topic="/head_scan")
    _, out, _ = run(capsys, monkeypatch, "info", bag)
    assert "tilt_scan:=/head_scan" in out
    assert "scan:=/head_scan" not in out.replace("tilt_scan:=/head_scan", "")


def test_info_shows_the_contents_of_a_saved_map(capsys, monkeypatch, session_files):
    folder = session_files.replayed("walkthrough")
    path = folder / "map.mcap"
    status, out, _ = run(capsys, monkeypatch, "info", path)
    assert status == 0
    assert out.startswith(f"{path}: a saved map, ")
    assert "of 1 session" in out
    _, out, _ = run(capsys, monkeypatch, "info", path, "--json")
    found = json.loads(out)
    summary = json.loads((folder / "summary.json").read_text())
    assert (found["sessions"], found["keyframes"]) == (1, summary["counts"]["keyframes"])
    assert found["size"] == path.stat().st_size


@pytest.mark.parametrize("command", ["info", "replay"])
def test_a_damaged_map_is_an_error_of_one_line(
    capsys, monkeypatch, session_files, tmp_path, command
):
    path = tmp_path / "map.mcap"
    data = bytearray((session_files.replayed("walkthrough") / "map.mcap").read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    arguments = ["info", path]
    if command == "replay":
        out = tmp_path / "out"
        arguments = ["replay", BAGS / "walkthrough", "--map", path, "--out", out]
    status, _, error = run(capsys, monkeypatch, *arguments)
    assert status == 1
    assert error.count("\n") == 1
    assert str(path) in error
    assert "damaged" in error
    assert not (tmp_path / "out").exists()


def test_a_map_can_be_given_by_its_folder(capsys, monkeypatch, tmp_path):
    bag, out = BAGS / "walkthrough", tmp_path / "out"
    status, _, error = run(capsys, monkeypatch, "replay", bag, "--map", tmp_path, "--out", out)
    assert status == 1
    assert f"{tmp_path / 'map.mcap'}: no such map" in error


@pytest.mark.parametrize(
    "arguments",
    [
        ("view", "nowhere"),
        ("replay", BAGS / "walkthrough", "--config", "nowhere", "--out", "unused"),
        ("replay", BAGS / "walkthrough", "--out", "/proc/nowhere"),
        ("evaluate", "nowhere", "--truth", BAGS / "flat" / "truth.json"),
    ],
)
def test_the_error_of_a_missing_path_names_it(capsys, monkeypatch, arguments):
    status, _, err = run(capsys, monkeypatch, *arguments)
    assert status == 1
    assert "nowhere" in err
    assert err.count("\n") == 1
    assert "Errno" not in err


def test_parameters_print_the_shipped_file(capsys, monkeypatch):
    status, out, _ = run(capsys, monkeypatch, "parameters")
    assert status == 0
    assert "cell_size: 0.02" in out


def test_signs_prints_a_line_of_json_for_each_picture(capsys, monkeypatch, tmp_path):
    pytest.importorskip("onnxruntime", reason="the extra 'signs' is not installed")
    pictures = [tmp_path / "one.png", tmp_path / "two.png"]
    for path in pictures:
        Image.new("RGB", (320, 240), "gray").save(path)
    status, out, _ = run(capsys, monkeypatch, "signs", *pictures)
    lines = [json.loads(line) for line in out.splitlines()]
    assert status == 0
    assert lines == [{"file": str(path), "signs": [], "refused": []} for path in pictures]


def test_signs_of_a_file_that_is_no_picture_is_an_error_of_one_line(capsys, monkeypatch, tmp_path):
    pytest.importorskip("onnxruntime", reason="the extra 'signs' is not installed")
    (tmp_path / "notes.txt").write_text("no picture")
    status, out, err = run(capsys, monkeypatch, "signs", tmp_path / "notes.txt")
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
    assert "notes.txt: not a readable image" in err


def test_signs_without_the_extra_names_it(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("tccm_ros.signs.reading.find_spec", lambda name: None)
    status, _, err = run(capsys, monkeypatch, "signs", tmp_path / "any.png")
    assert status == 1
    assert "pip install 'tccm_ros[signs]'" in err


def test_help_is_printed_without_importing_slow_libraries():
    """No heavy import before a command is known: --help must work without them."""
    code = (
        "import sys; from tccm_ros import cli; "
        "assert not {'numba', 'gtsam', 'matplotlib', 'scipy'} & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=dict(os.environ), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
