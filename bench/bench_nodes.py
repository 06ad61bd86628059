"""Load of the live nodes: the heaviest robot in real time, into real processes.

    python bench/bench_nodes.py [--seconds 20]

Prints, for each node, its fraction of a core, its memory, its longest step and the scans lost;
and how long after a cycle's last beam its planes are out. The simulator's world `load` (1,081
beams at 40 Hz tilting, 361 at 12.5 Hz level) is computed before the clock starts.
"""

from __future__ import annotations

import argparse
import os
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.pipeline.sim.engine import Simulation
from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.worlds import build_world
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan
from tccm_ros.records.building import stamp_ns_from_message
from tccm_ros.ros.writing import (
    joint_sample_message,
    odometry_message,
    robot_description_message,
    scan_message,
)

NODES = ("tccm_node", "slam_node")
WAIT_S = 120.0
BUILDERS = {
    Scan: scan_message,
    JointSample: joint_sample_message,
    Odometry: odometry_message,
    RobotDescription: robot_description_message,
}


def prepare(seconds: float) -> list[tuple[int, str, object]]:
    """Return (time of publication, topic, message) of the world `load`, stamped from 0."""
    types, options = RosidlMessages(), Options(laps=max(1, int(np.ceil(seconds / 20.0))))
    simulation = Simulation(build_world("load", options), 0, options)
    found = []
    for published in simulation.run():
        record = published.records[0]
        if type(record) in BUILDERS and published.log_ns - simulation.start_ns < seconds * 1e9:
            message = BUILDERS[type(record)](types, record)
            found.append((published.log_ns, published.topic, message))
    return found


def cpu_seconds(pid: int) -> float:
    """Return the processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pid: int) -> tuple[int, int]:
    """Return what of a process is in memory, and that less what others share, MB."""
    lines = [line.split() for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()]
    kilobytes = {line[0]: int(line[1]) for line in lines[1:]}
    return kilobytes["Rss:"] // 1024, kilobytes["Pss:"] // 1024


class Driver(Node):
    """Publishes in real time and hears what comes back."""

    def __init__(self, messages: list[tuple[int, str, object]]):
        super().__init__("driver")
        self.messages = messages
        self.sent: Counter[str] = Counter()
        self.planes: list[tuple[float, int]] = []
        self.reports: dict[str, dict[str, str]] = {}
        examples = {topic: message for _, topic, message in messages}
        self.pubs = {topic: self._publisher(topic, m) for topic, m in examples.items()}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        # As bytes: a message of some hundred markers takes Python longer than it is on its way.
        self.create_subscription(MarkerArray, "/tccm/planes", self._on_planes, latched, raw=True)
        self.create_subscription(PointCloud2, "/tccm/surfaces", lambda _: None, 50)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 10)
        self.shift_ns = 0

    def _publisher(self, topic: str, message: object):
        latched = topic == "/robot_description"
        profile = QoSProfile(
            depth=200,
            reliability=ReliabilityPolicy.RELIABLE if latched else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        return self.create_publisher(type(message), topic, profile)

    def _on_planes(self, data: bytes) -> None:
        now, (count, sec, nanosec) = time.time(), struct.unpack_from("<IiI", data, 4)
        if count:
            self.planes.append((now, sec * 10**9 + nanosec))

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.reports[status.name] = {v.key: v.value for v in status.values}

    def spin_until(self, predicate) -> None:
        """Spin until something holds, or give up."""
        end = time.monotonic() + WAIT_S
        while not predicate():
            if time.monotonic() > end:
                raise SystemExit("the nodes did not come up")
            rclpy.spin_once(self, timeout_sec=0.05)

    def play(self) -> None:
        """Publish everything when it is due, with stamps of now."""
        begin, first = time.time_ns() + 200_000_000, self.messages[0][0]
        self.shift_ns = begin - first
        for log_ns, topic, message in self.messages:
            due = log_ns + self.shift_ns
            while (left := due - time.time_ns()) > 0:
                rclpy.spin_once(self, timeout_sec=min(left * 1e-9, 0.002))
            if hasattr(message, "header"):
                stamp = stamp_ns_from_message(message.header.stamp) + self.shift_ns
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            self.pubs[topic].publish(message)
            self.sent[topic] += 1
        end = time.monotonic() + 2.5
        while time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.05)


def latencies(driver: Driver, cycles: list[tuple[int, int]]) -> list[float]:
    """Return for each message of planes the time since its cycle's last beam, ms."""
    ends = {stamp: end for stamp, end in cycles}
    return [
        1e3 * (at - (ends[stamp - driver.shift_ns] + driver.shift_ns) * 1e-9)
        for at, stamp in driver.planes
        if stamp - driver.shift_ns in ends
    ]


def offline_cycles(seconds: float) -> list[tuple[int, int]]:
    """Return (stamp, last beam) of each cycle, as a processor has them without any nodes."""
    from tccm_ros.config import Config
    from tccm_ros.mapping.tccm import TccmProcessor
    from tccm_ros.robot import Robot
    from tccm_ros.sensors.registry import default_streams

    options = Options(laps=max(1, int(np.ceil(seconds / 20.0))))
    simulation = Simulation(build_world("load", options), 0, options)
    robot = Robot(Config(), default_streams(), expects_odometry=True)
    processor, results = TccmProcessor(Config()), []
    for published in simulation.run():
        if published.topic != "/scan" and published.log_ns - simulation.start_ns < seconds * 1e9:
            for record in published.records:
                for event in robot.add(published.topic.lstrip("/"), record):
                    results += processor.add(event)
    return [(r.stamp_ns, r.end_ns) for r in results]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    messages, cycles = prepare(seconds), offline_cycles(seconds)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "100")
    run = "from tccm_ros.nodes.{} import main; main()"
    processes = [subprocess.Popen([sys.executable, "-c", run.format(n)]) for n in NODES]
    try:
        measure(messages, cycles, processes, seconds)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait()


def measure(messages, cycles, processes, seconds: float) -> None:
    rclpy.init()
    driver = Driver(messages)
    driver.spin_until(lambda: driver.pubs["/tilt_scan"].get_subscription_count() == 2)
    driver.spin_until(lambda: driver.pubs["/scan"].get_subscription_count() == 1)
    for name in ("tccm", "surface_slam"):
        driver.spin_until(lambda n=name: driver.reports.get(n, {}).get("ready") == "True")
    before = [cpu_seconds(p.pid) for p in processes]
    driver.play()
    elapsed = [cpu_seconds(p.pid) - b for p, b in zip(processes, before)]
    late = latencies(driver, cycles)
    print("\n| node | of a core | RSS, PSS | longest step | scans received / sent | dropped |")
    print("|---|---|---|---|---|---|")
    memory = ["{} MB, {} MB".format(*memory_mb(p.pid)) for p in processes]
    for name, topic, used, held in zip(
        ("tccm", "surface_slam"), ("/tilt_scan", "/scan"), elapsed, memory
    ):
        values = driver.reports[name]
        dropped = {k: v for k, v in values.items() if k.startswith(("dropped", "lost"))}
        print(
            f"| {name} | {used / seconds:.1%} | {held} | {values['longest step [s]']} s | "
            f"{values[f'received {topic}']} / {driver.sent[topic]} | {dropped or 'none'} |"
        )
    if late:
        print(
            f"\nplanes after a cycle's last beam: median {np.median(late):.0f} ms, "
            f"largest {max(late):.0f} ms, {len(late)} of {len(cycles)} cycles"
        )
    driver.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
