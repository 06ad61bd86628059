"""A node serves while its kernels are compiled, and keeps what comes meanwhile."""

import threading

from live_robot import Listener, recording, tccm
from processes import read_until, settings, started
from rcl_interfaces.srv import GetParameters

from tccm_ros.nodes.intake import shared_robot
from tccm_ros.nodes.process import kernel_loader
from tccm_ros.nodes.process.kernel_loader import KernelLoader


def test_parameters_are_answered_while_kernels_are_compiled(ros, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    with started(ros.domain, "tccm_node", *settings(qos__silence=60.0)) as process:
        caller = Listener(ros).node
        client = caller.create_client(GetParameters, "/tccm/get_parameters")
        answer = ros.call(client, GetParameters.Request(names=["map.cell_size"]))
        assert answer.values[0].double_value == 0.02
        ros.spin_until(lambda: caller.count_subscribers("/tilt_scan") == 1)
        text = read_until(process, r"compiled, once: \d+ s; 0 records wait")
        # Asked again in the midst of it.
        ros.call(client, GetParameters.Request(names=["map.cell_size"]))
        assert "ready" not in text
        process.kill()


class Held:
    """A node whose kernels are loaded when the test says so."""

    def __init__(self, monkeypatch):
        self.gate = threading.Event()
        plain = kernel_loader.warm_up
        monkeypatch.setattr(kernel_loader, "warm_up", lambda *a: (self.gate.wait(), plain(*a)))

    def node(self, ros, monkeypatch, **values):
        with monkeypatch.context() as patch:  # the helper waits until a node is ready
            patch.setattr(KernelLoader, "is_done", True)
            return tccm(ros, **values)


def test_records_before_the_kernels_are_loaded_are_used_afterwards(ros, monkeypatch, capfd):
    held = Held(monkeypatch)
    node, robot = held.node(ros, monkeypatch), ros.robot()
    records = list(recording(4))
    for topic, record in records:
        if topic != "scan":
            robot.publish(topic, robot.message(record), node)
    sent = sum(topic != "scan" for topic, _ in records) + 1
    ros.spin_until(lambda: node.robot.early >= sent)
    assert node.processor.counts["scans used"] == 0
    held.gate.set()
    ros.spin_until(lambda: node.kernels.is_done)
    ros.spin_until(lambda: node.processor.counts["cycles"] >= 3)
    assert not node.overload
    assert not node.dropped["before the start"]
    text = capfd.readouterr().err
    (line,) = (line for line in text.splitlines() if "ready" in line)
    for word in ("tilt_scan on base 'base'", "joint 'tilt'", "odometry in 'odom'"):
        assert word in line


def test_records_beyond_the_queue_are_counted(ros, monkeypatch):
    monkeypatch.setattr(shared_robot, "MAX_EARLY", 30)
    held = Held(monkeypatch)
    node, robot = held.node(ros, monkeypatch), ros.robot()
    scans = [r for t, r in recording(3) if t == "tilt_scan"]
    for scan in scans:
        robot.publish("tilt_scan", robot.message(scan), node)
    ros.spin_until(lambda: node.inputs.counts()["/tilt_scan"] == len(scans))
    assert node.robot.early <= 31
    assert node.dropped["before the start"] >= len(scans) - 30
    held.gate.set()
    ros.spin_until(lambda: node.kernels.is_done)


def test_ready_line_names_the_awaited_inputs(ros, capfd):
    tccm(ros)
    line = next(t for t in capfd.readouterr().err.splitlines() if "ready" in t)
    assert "waits for /tilt_scan, /odom, /joint_states" in line
