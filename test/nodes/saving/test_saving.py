"""What a node saves, and when: asked by a service, told to stop once or more often, left alone."""

import errno
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import termios
import threading
import time
from contextlib import contextmanager, suppress
from functools import partial

import numpy as np
import pytest
from asker import Asker
from live_robot import START_NS, Listener, recording, slam, tccm
from processes import PATIENCE_S, children, play_until, settings, started
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from tccm_ros.errors import OutputError
from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.saving.solution_saver import patience_s
from tccm_ros.nodes.solver.channel import Journal
from tccm_ros.records import RollPitch, SurfaceCloud
from tccm_ros.results.map_file import load_map, read_content

IMPATIENT_S = 2.0  # s: a second key press after this ends the save
SAME_S = 0.1  # s: signals closer than this are one key press

SECOND = 1_000_000_000
POLL_S = 0.01
LONG_S = 60.0
"""An executor that sleeps so long wakes up for an answer alone."""


def trigger(ros, name):
    client = Listener(ros, "caller").node.create_client(Trigger, name)
    return ros.call(client, Trigger.Request())


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@contextmanager
def mapping_node(ros, folder, **options):
    """Start slam_node as a process, with a solution of a short drive; yield it and its child.

    `options` are those of `started`.
    """
    values = {"save__directory": folder, "save__on_shutdown": "true"}
    words = settings(qos__reliability="reliable", **values)
    with started(ros.domain, "slam_node", *words, **options) as node:
        assert trigger(ros, "/surface_slam/reset").success
        play_until(
            ros, ros.robot(), 2, lambda: trigger(ros, "/surface_slam/save_map").success,
            "a solution", tilt=False,
        )  # fmt: skip
        (child,) = children(node)
        shutil.rmtree(folder)
        try:
            yield node, child
        finally:
            with_signal(child, signal.SIGKILL)


def save_until(ros, predicate):
    """Ask for the map to be saved until the answer is as wanted."""
    end = time.monotonic() + PATIENCE_S
    while not predicate(answer := trigger(ros, "/surface_slam/save_map")):
        assert time.monotonic() < end, answer.message


def hold_solution(ros, child, folder):
    """Stop the process that solves, and have records come that its newest solution is without."""
    os.kill(child, signal.SIGSTOP)
    play_until(
        ros, ros.robot(name="again"), 1,
        lambda: "not in it" in trigger(ros, "/surface_slam/save_map").message,
        "records that are not in the map", tilt=False,
    )  # fmt: skip
    shutil.rmtree(folder)


def with_signal(pid, number):
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return


def wait_until(predicate, what, process):
    end = time.monotonic() + PATIENCE_S
    while not predicate():
        assert time.monotonic() < end, what
        assert process.poll() is None, process.communicate()
        time.sleep(POLL_S)


def goes_on(process, seconds):
    """Wait for some seconds or the end of a process; return whether it still runs."""
    with suppress(subprocess.TimeoutExpired):
        process.wait(seconds)
    return process.poll() is None


# --- stopped ---


@pytest.mark.parametrize("delay_s", [0.002, 0.2])
def test_a_second_sigint_neither_aborts_nor_loses_the_map(ros, tmp_path, delay_s):
    with mapping_node(ros, tmp_path / "map") as (node, _):
        node.send_signal(signal.SIGINT)
        goes_on(node, delay_s)
        node.send_signal(signal.SIGINT)
        output, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, output
    assert read_content(tmp_path / "map" / "map.mcap").keyframes


def test_newest_solution_is_saved_at_once_and_a_late_signal_ends_the_wait(ros, tmp_path):
    """As `ros2 launch` does: SIGINT, later SIGTERM; the last solution would take forever."""
    with mapping_node(ros, tmp_path / "map") as (node, child):
        hold_solution(ros, child, tmp_path / "map")
        start = time.monotonic()
        node.send_signal(signal.SIGINT)
        wait_until((tmp_path / "map" / "map.mcap").exists, "the newest solution", node)
        assert goes_on(node, start + IMPATIENT_S + 0.5 - time.monotonic())
        node.send_signal(signal.SIGTERM)
        os.kill(child, signal.SIGCONT)
        output, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, output
    assert read_content(tmp_path / "map" / "map.mcap").keyframes


SAVES_SLOWLY = """
import os, time
from tccm_ros.nodes.saving import map_folder

plain = map_folder.save_archive

def save_when_told(archive, folder):
    if os.path.exists({wait!r}):
        open({begun!r}, "w").close()
        while os.path.exists({wait!r}):
            time.sleep(0.01)
    plain(archive, folder)

map_folder.save_archive = save_when_told
"""


def test_two_presses_of_ctrl_c_under_launch_lose_nothing(ros, tmp_path):
    """Each press is a signal to the group of the terminal, and at the first launch signals too."""
    wait, begun = tmp_path / "wait", tmp_path / "begun"
    slow = SAVES_SLOWLY.format(wait=str(wait), begun=str(begun))
    options = {"before": slow, "process_group": 0}
    with mapping_node(ros, tmp_path / "map", **options) as (node, child):
        hold_solution(ros, child, tmp_path / "map")
        wait.touch()
        os.killpg(node.pid, signal.SIGINT)
        node.send_signal(signal.SIGINT)
        wait_until(begun.exists, "the newest solution", node)
        for _ in range(2):
            assert goes_on(node, 2.0 * SAME_S)
            os.killpg(node.pid, signal.SIGINT)
            assert node.poll() is None
        goes_on(node, SAME_S)
        wait.unlink()
        output, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, output
    assert "left out: the newest records, asked again to stop" in output
    assert f"saved {tmp_path / 'map'}: solution" in output
    assert read_content(tmp_path / "map" / "map.mcap").keyframes


LAUNCHES = """
import signal, subprocess, sys

nodes = [
    subprocess.Popen(
        [sys.executable, "-c", f"from tccm_ros.nodes.start import {{name}}; {{name}}()", *{words!r}]
    )
    for name in ("tccm_node", "slam_node")
]

def pass_on(number, frame):
    for node in nodes:
        node.send_signal(number)

signal.signal(signal.SIGINT, pass_on)
print([node.wait() for node in nodes], flush=True)
"""
"""What `ros2 launch` does with two nodes; launch itself is not on PyPI."""


def test_two_presses_of_ctrl_c_save_a_continued_map(ros, tmp_path):
    """Terminal 1 launches with a saved map, terminal 2 plays, then Ctrl-C twice in terminal 1."""
    folder = tmp_path / "map"
    before, robot = slam(ros, save__directory=str(folder)), ros.robot()
    robot.play(recording(3, tilt=False), before)
    assert trigger(ros, "/surface_slam/save_map").success
    ros.remove(before)
    saved = read_content(folder / "map.mcap").keyframes
    words = settings(save__directory=folder, save__on_shutdown="true", qos__reliability="reliable")
    environment = {**os.environ, "ROS_DOMAIN_ID": str(ros.domain)}
    with subprocess.Popen(
        [sys.executable, "-c", LAUNCHES.format(words=words)], env=environment, process_group=0,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as terminal:  # fmt: skip
        try:
            for name in ("tccm/reset", "surface_slam/load_map"):
                assert trigger(ros, f"/{name}").success

            def has_new_keyframes() -> bool:
                is_saved = trigger(ros, "/surface_slam/save_map").success
                return is_saved and read_content(folder / "map.mcap").keyframes > saved

            again = ros.robot(name="again")
            play_until(ros, again, 3, has_new_keyframes, "keyframes", tilt=False)
            shutil.rmtree(folder)
            for _ in range(2):
                os.killpg(terminal.pid, signal.SIGINT)
                time.sleep(2.0 * SAME_S)  # between two presses
            output, _ = terminal.communicate(timeout=PATIENCE_S)
        finally:
            if terminal.poll() is None:
                os.killpg(terminal.pid, signal.SIGKILL)
    assert "[0, 0]" in output, output
    assert read_content(folder / "map.mcap").keyframes > saved
    assert load_map(folder / "map.mcap").walls


def test_a_terminal_that_is_gone_saves_the_map(ros, tmp_path):
    """As a dropped ssh session: the kernel sends SIGHUP, and each line that is printed fails."""
    ours, theirs = os.openpty()

    def take_terminal():
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    folder = tmp_path / "map"
    options = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
    with mapping_node(ros, folder, preexec_fn=take_terminal, **options) as (node, _):
        os.close(theirs)
        os.close(ours)
        assert node.wait(timeout=PATIENCE_S) == 0
    assert read_content(folder / "map.mcap").keyframes


def test_a_hang_up_under_nohup_ends_nothing():
    script = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from tccm_ros.nodes.process.stopping import stopping_signals\n"
        "print(*(s.name for s in stopping_signals()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["SIGINT", "SIGTERM"]


def test_slow_solution_is_left_out_at_the_end_and_reported(ros, tmp_path):
    with mapping_node(ros, tmp_path / "map") as (node, child):
        hold_solution(ros, child, tmp_path / "map")
        node.send_signal(signal.SIGINT)
        output, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, output
    assert "left out: the newest records, not done within 5 s" in output
    assert "s of records are not in it" in output
    assert read_content(tmp_path / "map" / "map.mcap").keyframes


def test_a_save_that_fails_at_the_end_is_status_1(ros, tmp_path):
    folder = tmp_path / "file" / "map"
    with mapping_node(ros, folder) as (node, _):
        folder.parent.rmdir()
        folder.parent.touch()
        node.send_signal(signal.SIGTERM)
        output, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 1, output
    assert f"not saved: {folder}" in output


def test_a_node_that_hangs_ends_all_the_same(tmp_path):
    script = HANGS.format(start=str(tmp_path / "started"))
    with subprocess.Popen(
        [sys.executable, "-c", script], stderr=subprocess.PIPE, text=True
    ) as node:
        wait_until((tmp_path / "started").exists, "the node", node)
        node.send_signal(signal.SIGINT)
        _, output = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 1
    assert "not done 8 s after the signal, ended now; not saved: the disk hangs" in output


HANGS = """
import threading
from tccm_ros.nodes.process.stopping import StopSignals

stopped = threading.Event()
signals = StopSignals(stopped.set)
open({start!r}, "w").close()
stopped.wait()
signals.ending.failed["node"] = "the disk hangs"
threading.Event().wait()
"""


# --- what replaces what ---


def test_an_empty_node_saves_nothing_over_a_map(ros, tmp_path):
    folder = tmp_path / "map"
    folder.mkdir()
    (folder / "map.mcap").write_bytes(b"a map")
    (folder / "cuboids.npz").write_bytes(b"cuboids")
    before = files(folder)
    slam(ros, save__directory=str(folder))
    tccm(ros, save__directory=str(folder))
    for name, reason in (("surface_slam", "nothing has been mapped"), ("tccm", "no tilt cycle")):
        answer = trigger(ros, f"/{name}/save_map")
        assert not answer.success
        assert reason in answer.message
    assert files(folder) == before


def test_autosave_of_an_empty_node_saves_nothing_over_a_map(ros, tmp_path):
    folder = tmp_path / "map"
    folder.mkdir()
    (folder / "map.mcap").write_bytes(b"a map")
    (folder / "cuboids.npz").write_bytes(b"cuboids")
    before = files(folder)
    said = Listener(ros, "log").listen(Log, "/rosout", latched=True)
    slam(ros, save__directory=str(folder), save__autosave_minutes=0.001)
    tccm(ros, save__directory=str(folder), save__autosave_minutes=0.001)
    for name in ("surface_slam", "tccm"):
        ros.spin_until(lambda n=name: any(m.name == n and "not saved" in m.msg for m in said))
    assert files(folder) == before
    assert not (tmp_path / "map.previous").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_empty_node_saves_nothing_over_a_map_when_stopped(ros, tmp_path, number):
    folder = tmp_path / "map"
    folder.mkdir()
    (folder / "map.mcap").write_bytes(b"a map")
    (folder / "cuboids.npz").write_bytes(b"cuboids")
    before = files(folder)
    arguments = settings(save__directory=folder, save__on_shutdown="true")
    with started(ros.domain, "all_in_one", *arguments) as node:
        for name in ("tccm", "surface_slam"):
            assert trigger(ros, f"/{name}/reset").success
        node.send_signal(number)
        output, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, output
    assert output.count("not saved") == 2
    assert files(folder) == before


def test_map_is_not_replaced_by_a_smaller_one(ros, tmp_path):
    folder, previous = tmp_path / "map", tmp_path / "map.previous"
    node, robot = slam(ros, save__directory=str(folder)), ros.robot()
    robot.play(recording(3, speed=0.5, tilt=False), node)
    assert trigger(ros, "/surface_slam/save_map").success
    long = files(folder)
    assert trigger(ros, "/surface_slam/reset").success
    robot.play(recording(1, tilt=False, start_ns=START_NS + 60 * SECOND), node)
    answer = trigger(ros, "/surface_slam/save_map")
    assert not answer.success
    assert "holds more" in answer.message
    assert files(folder) == long
    assert not previous.exists()
    robot.play(recording(5, speed=0.5, tilt=False, start_ns=START_NS + 90 * SECOND), node)
    answer = trigger(ros, "/surface_slam/save_map")
    assert answer.success, answer.message
    assert files(previous) == long
    assert files(folder) != long


@pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")
def test_a_map_that_is_named_is_replaced_by_one_that_holds_less(ros, tmp_path):
    node, robot, asker = slam(ros, save__directory=str(tmp_path)), ros.robot(), Asker(ros)
    save = partial(asker.ask, "SaveMap", "/surface_slam/save_named_map", name="home")
    robot.play(recording(3, speed=0.5, tilt=False), node)
    assert save().success
    more = read_content(tmp_path / "home" / "map.mcap")
    assert trigger(ros, "/surface_slam/reset").success
    robot.play(recording(1, tilt=False, start_ns=START_NS + 60 * SECOND), node)
    assert not save().success
    assert read_content(tmp_path / "home" / "map.mcap") == more
    answer = save(overwrite=True)
    assert answer.success, answer.message
    assert read_content(tmp_path / "home" / "map.mcap").is_less_than(more)
    assert read_content(tmp_path / "home.previous" / "map.mcap") == more


def test_a_smaller_map_of_another_drive_is_saved_beside_at_the_end(ros, tmp_path):
    folder, beside = tmp_path / "map", tmp_path / "map.2"
    node, robot = slam(ros, save__directory=str(folder)), ros.robot()
    robot.play(recording(3, speed=0.5, tilt=False), node)
    assert trigger(ros, "/surface_slam/save_map").success
    long = files(folder)
    assert trigger(ros, "/surface_slam/reset").success
    robot.play(recording(1, tilt=False, start_ns=START_NS + 60 * SECOND), node)
    assert not trigger(ros, "/surface_slam/save_map").success
    for _ in range(2):  # the newest solution, then the last one
        ending = Ending().begin()
        node.save_at_end(ending)
        assert ending.saved["surface_slam"].startswith(f"{beside}: solution")
    assert files(folder) == long
    assert read_content(beside / "map.mcap") == node.solver.newest.content
    assert sorted(p.name for p in tmp_path.iterdir()) == ["map", "map.2"]


def test_a_full_disk_names_the_file(ros, tmp_path, monkeypatch):
    def no_space(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    robot.play(recording(1, tilt=False), node)
    monkeypatch.setattr(os, "sendfile", no_space)
    answer = trigger(ros, "/surface_slam/save_map")
    assert not answer.success
    assert str(tmp_path / "map") in answer.message
    assert "no space left on device" in answer.message
    monkeypatch.setattr(os, "pwrite", no_space)
    with pytest.raises(OutputError, match=tempfile.gettempdir()):
        Journal().append([1])


def test_a_full_disk_at_the_end_leaves_the_newest_solution(ros, tmp_path, monkeypatch):
    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    robot.play(recording(2, tilt=False), node)
    assert trigger(ros, "/surface_slam/save_map").success

    def no_space(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    robot.play(recording(1, tilt=False, start_ns=START_NS + 5 * SECOND), node)
    monkeypatch.setattr(os, "pwrite", no_space)
    ending = Ending().begin()
    node.save_at_end(ending)
    assert "newest records" in ending.left_out["surface_slam"]
    assert "solution" in ending.saved["surface_slam"]
    assert read_content(tmp_path / "map" / "map.mcap") == node.solver.newest.content


def test_save_after_a_drive_waits_for_records_up_to_the_request(ros, tmp_path):
    """Scans and an IMU go on while the robot stands: what comes later is no loss."""
    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    robot.play(recording(2, tilt=False), node)
    asked = node.begin_save()
    node.worker.wait(lambda: node.session.add(RollPitch(node.session.newest_ns, 0.0, 0.0)))
    ros.spin_until(asked.done, what="the save")
    assert "not in it" not in asked.result()


def test_a_saved_map_names_its_solution(ros, tmp_path):
    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    robot.play(recording(3, speed=0.5, tilt=False), node)
    answer = trigger(ros, "/surface_slam/save_map")
    newest = node.solver.newest
    assert f"solution {newest.number}, up to {newest.stamp_ns * 1e-9:.3f} s" in answer.message
    assert read_content(tmp_path / "map" / "map.mcap") == newest.content
    assert load_map(tmp_path / "map" / "map.mcap").walls


# --- in time ---


def test_a_save_does_not_wait_for_a_solution_that_takes_long(ros, tmp_path):
    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    robot.play(recording(2, tilt=False), node)
    assert trigger(ros, "/surface_slam/save_map").success
    os.kill(node.solver.pid, signal.SIGSTOP)
    robot.play(recording(1, tilt=False, start_ns=START_NS + 5 * SECOND), node)
    answer = trigger(ros, "/surface_slam/save_map")
    os.kill(node.solver.pid, signal.SIGCONT)
    assert answer.success
    assert "s of records are not in it" in answer.message


def test_wait_of_a_save_is_bounded_if_solutions_take_minutes():
    assert patience_s(0.5) == pytest.approx(2.2)
    assert patience_s(230.0) == 10.0


def test_last_view_older_than_the_solution_is_solved(ros, tmp_path):
    node, robot = slam(ros, save__directory=str(tmp_path / "map")), ros.robot()
    robot.play(recording(2, tilt=False), node)
    assert trigger(ros, "/surface_slam/save_map").success
    os.kill(node.solver.pid, signal.SIGSTOP)
    points = np.array([[x, y, 0.7] for x in (0.8, 0.9) for y in (-0.1, 0.1)], np.float32)
    view = SurfaceCloud(START_NS, "base", points, np.zeros(4, np.uint32))
    node.worker.wait(lambda: node.process_event(view))
    answer = trigger(ros, "/surface_slam/save_map")
    os.kill(node.solver.pid, signal.SIGCONT)
    assert "the newest records are not in it" in answer.message
    save_until(ros, lambda answer: "not in it" not in answer.message)
    assert node.solver.newest.content.views == 1


def test_poses_go_on_while_a_solution_takes_long(ros):
    node, robot = slam(ros), ros.robot()
    robot.play(recording(1, tilt=False), node)
    os.kill(node.solver.pid, signal.SIGSTOP)
    before = node.processor.counts["level scans"]
    robot.play(recording(20, tilt=False, start_ns=START_NS + 5 * SECOND), node)
    os.kill(node.solver.pid, signal.SIGCONT)
    assert node.processor.counts["level scans"] >= before + 190
    assert not node.overload


def test_an_answer_of_the_worker_wakes_its_executor(ros, tmp_path):
    """An executor that waits for nothing else has the answer as soon as the work is done."""
    node = slam(ros, save__directory=str(tmp_path / "map"))
    ros.executor.remove_node(node)
    for timer in list(node.timers):
        node.destroy_timer(timer)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    is_done = threading.Event()

    def spin():
        while not is_done.is_set():
            executor.spin_once(timeout_sec=LONG_S)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    start = time.monotonic()
    for name in ("reset", "save_map", "reset"):
        trigger(ros, f"/surface_slam/{name}")
    elapsed = time.monotonic() - start
    executor.create_task(is_done.set)
    thread.join()
    ros.executor.add_node(node)
    assert elapsed < LONG_S


# --- left alone ---


@pytest.mark.parametrize("is_time_standing", [False, True])
def test_last_records_are_solved_after_the_end_of_input(ros, is_time_standing):
    """Also where nobody publishes /clock, and ROS time stands."""
    node, robot = slam(ros, use_sim_time=is_time_standing), ros.robot()
    robot.play(recording(1, tilt=False), node)
    last_ns = node.session.newest_ns
    ros.spin_until(
        lambda: node.solver.newest is not None and node.solver.newest.stamp_ns == last_ns,
        what="a solution with all that has come",
    )
    assert node.solver.newest.stamp_ns == last_ns
