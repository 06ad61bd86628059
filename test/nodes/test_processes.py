"""Nodes as processes: signals, restarts, any order of starting, and kill -9 during a save."""

import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from live_robot import START_NS, Listener, recording, slam, wait_until_done
from processes import PATIENCE_S, play_until, settings, started, stop
from std_srvs.srv import Trigger

from tccm_ros.results.map_file import load_map

SECOND = 1_000_000_000


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.every_distro),
        signal.SIGHUP,
    ],
)
def test_a_signal_ends_both_nodes_with_a_saved_map_and_status_0(ros, tmp_path, number):
    folder = tmp_path / "map"
    arguments = settings(
        save__directory=folder, save__on_shutdown="true", qos__reliability="reliable"
    )
    with started(ros.domain, "all_in_one", *arguments) as process:
        caller = Listener(ros).node
        # A service is there before its node is made; one that answers is spun.
        for name in ("/tccm/reset", "/surface_slam/reset"):
            assert ros.call(caller.create_client(Trigger, name), Trigger.Request()).success
        save = caller.create_client(Trigger, "/surface_slam/save_map")

        def has_saved_surfaces() -> bool:
            is_saved = ros.call(save, Trigger.Request()).success
            return is_saved and json.loads((folder / "surfaces.json").read_text())["surfaces"]

        # A signal ends the node in some seconds, whether what was sent has come by then or not.
        play_until(ros, ros.robot(), 3, has_saved_surfaces, "surfaces")
        for path in tmp_path.iterdir():
            shutil.rmtree(path)
        status, output = stop(process, number)
    assert status == 0, output
    assert "Traceback" not in output
    assert json.loads((folder / "surfaces.json").read_text())["surfaces"]
    assert (folder / "cuboids.npz").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["map"]


DURING_IMPORTS = """
import builtins, os, signal
from tccm_ros.nodes import start

plain = builtins.__import__

def kill(name, *args, **fields):
    if name.startswith("rclpy"):
        builtins.__import__ = plain
        os.kill(os.getpid(), signal.{name})
    return plain(name, *args, **fields)

builtins.__import__ = kill
start.tccm_node()
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_during_the_imports_ends_a_node_with_status_0(domain, name):
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    done = subprocess.run(
        [sys.executable, "-c", DURING_IMPORTS.format(name=name)], env=environment,
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


SWALLOWED = """
import os, signal
from tccm_ros.nodes.run import run

def factory():
    try:  # as a callback of the compiler does
        os.kill(os.getpid(), signal.SIGINT)
        raise SystemExit(3)
    except KeyboardInterrupt:
        pass
    raise RuntimeError("no compiled object yet")

run(factory)
"""


def test_a_signal_that_the_compiler_swallows_ends_a_node_with_status_0(domain):
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWED], env=environment, capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def test_an_error_at_the_start_has_status_1_and_is_printed(domain):
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    script = SWALLOWED.replace("os.kill(os.getpid(), signal.SIGINT)", "raise KeyboardInterrupt")
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "RuntimeError" in done.stderr


def test_a_bad_parameter_ends_with_one_line_and_status_1(domain):
    with started(domain, "tccm_node", *settings(map__cell_size=1)) as process:
        output, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "write 1.0" in output
    assert "Traceback" not in output


def test_a_bad_parameter_of_one_of_two_nodes_ends_both_with_status_1(domain):
    """The first node is loading its kernels by then."""
    with started(domain, "all_in_one", *settings(graph__mode="x")) as process:
        output, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, output
    assert "graph.mode" in output
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (["--ros-args", "--params-file", "/nowhere.yaml"], 1, "/nowhere.yaml"),
        (["--ros-args", "-p", "bogus"], 1, "bogus"),
        (["--foo"], 2, "'--foo' is no argument of a node; usage:"),
        (["--ros-args", "--foo", "3"], 2, "'--foo' is no argument of a node; usage:"),
    ],
)
@pytest.mark.parametrize("node", ["tccm_node", "slam_node", "player_node"])
def test_an_unknown_argument_is_answered_with_one_line(domain, node, arguments, status, text):
    with started(domain, node, *arguments) as process:
        output, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == status
    assert text in output
    assert output.count("\n") == 1


def test_a_killed_tccm_node_is_started_again_and_the_pair_goes_on(ros):
    node, robot = slam(ros), ros.robot()
    start_ns = START_NS
    for _ in range(2):
        with started(ros.domain, "tccm_node", *settings(qos__reliability="reliable")) as process:
            # A killed participant stays in the graph for a while, and a new one is found by each
            # subscriber in its own time: what the SLAM node has got tells that it is found.
            before, end = node.processor.counts["clouds"], time.monotonic() + PATIENCE_S
            while node.processor.counts["clouds"] < before + 2:
                assert time.monotonic() < end, process.poll()
                robot.play(recording(2, start_ns=start_ns), node)
                start_ns += 10 * SECOND
            process.kill()
            process.wait()
    wait_until_done(ros, node)
    assert node.processor.counts["resets"] == 0


def test_a_slam_node_that_starts_late_or_again_goes_on(ros):
    robot = ros.robot()
    first = slam(ros)
    robot.play(recording(1), first)
    ros.remove(first)
    second = slam(ros)
    robot.play(recording(1, start_ns=START_NS + 5 * SECOND), second)
    assert second.processor.counts["level scans"] > 0


SAVE_FOREVER = """
    import os, sys
    from pathlib import Path
    sys.path.insert(0, sys.argv[1])
    from live_robot import URDF, recording
    from written_map import write_map
    from tccm_ros.config import Config
    from tccm_ros.replay.processors import Pipeline
    from tccm_ros.records import RobotDescription

    pipeline = Pipeline(Config(), expects_odometry=True)
    pipeline.add("robot_description", RobotDescription(URDF.format(p="", kind="revolute")))
    for topic, record in recording(4):
        pipeline.add(topic, record)
    slam, solution = pipeline.slam, pipeline.solve()
    folder = Path(sys.argv[2])
    write_map(folder, slam, solution)
    for line in sys.stdin:  # each line: save until killed
        child = os.fork()
        if child == 0:
            while True:
                write_map(folder, slam, solution)
        print(child, flush=True)
        os.waitpid(child, 0)
        print("gone", flush=True)
"""


def test_kill_9_during_a_save_loses_nothing_that_was_saved(tmp_path):
    folder = tmp_path / "map"
    script = textwrap.dedent(SAVE_FOREVER)
    here = str(Path(__file__).resolve().parents[1] / "helpers")
    with subprocess.Popen(
        [sys.executable, "-c", script, here, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        rng = np.random.default_rng(1)
        for delay in rng.uniform(0.0, 0.15, 12):
            process.stdin.write("go\n")
            process.stdin.flush()
            child = int(process.stdout.readline())
            # A busy wait, not a sleep: the kill falls anywhere in a save.
            end = os.times().elapsed + delay
            while os.times().elapsed < end:
                pass
            os.kill(child, signal.SIGKILL)
            assert process.stdout.readline() == "gone\n"
            saved = load_map(folder / "map.mcap")
            assert saved.views
            surfaces = json.loads((folder / "surfaces.json").read_text())
            assert surfaces["surfaces"]
            for name in ("walls.json", "graph.json"):
                json.loads((folder / name).read_text())
        process.stdin.close()
        assert process.wait(PATIENCE_S) == 0
