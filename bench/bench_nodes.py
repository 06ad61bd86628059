"""Load of the live nodes: the heaviest robot in real time, into real processes.

    python bench/bench_nodes.py [--seconds 20] [--standing | --camera 30 [--stand "at the worktop"]]
                                [--speed 1] [--busy 2]

Prints, for each node, its fraction of a core and that of the process it started, its memory, its
longest step and the records lost;
and how long after a cycle's last measurement its planes are out. With `--busy`, so many other
processes want a whole core each. The simulator's world `load`
(1,081 beams at 40 Hz tilting, 361 at 12.5 Hz level), or with `--camera` a depth camera of 640 x 480
pixels at so many images a second beside a level laser (`depth_kitchen`), is computed before the
clock starts. On a busy machine `--speed 0.2` publishes five times slower, with the same stamps:
processor time counts per second of the recording.
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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from depth_kitchen import DEPTH, SCAN, STANDS, samples
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records import (
    CameraInfo,
    DepthImage,
    JointSample,
    Odometry,
    RobotDescription,
    Scan,
)
from tccm_ros.ros.writing import scan_message
from tccm_sim.engine import Simulation
from tccm_sim.options import Options
from tccm_sim.sensor_messages import (
    camera_info_message,
    depth_image_message,
    joint_sample_message,
    odometry_message,
    robot_description_message,
)
from tccm_sim.worlds import build_world

NODES = ("tccm_node", "slam_node")
WAIT_S = 300.0
BUILDERS = {
    Scan: scan_message,
    JointSample: joint_sample_message,
    Odometry: odometry_message,
    RobotDescription: robot_description_message,
    DepthImage: depth_image_message,
    CameraInfo: camera_info_message,
}


class Planned(NamedTuple):
    """A record that is published: when, on which topic, and its message."""

    log_ns: int
    topic: str
    record: Any
    message: Any

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the record; None where it has none."""
        return getattr(self.record, "stamp_ns", None)


class Recording(NamedTuple):
    """What is published, and what is looked at: the topic that is mapped, and that of walls."""

    planned: list[Planned]
    mapped: str
    level: str


def of_lasers(seconds: float) -> Recording:
    """Return the world `load`."""
    types, options = RosidlMessages(), Options(laps=max(1, int(np.ceil(seconds / 20.0))))
    simulation = Simulation(build_world("load", options), 0, options)
    found = []
    for published in simulation.run():
        record = published.records[0]
        if type(record) in BUILDERS and published.log_ns - simulation.start_ns < seconds * 1e9:
            message = BUILDERS[type(record)](types, record)
            found.append(Planned(published.log_ns, published.topic, record, message))
    return Recording(found, "/tilt_scan", "/scan")


def of_camera(stand: str, rate: float, seconds: float) -> Recording:
    """Return the kitchen; images that repeat share a message."""
    types, found, images = RosidlMessages(), [], {}
    for log_ns, topic, record in samples(stand, rate, seconds):
        if type(record) not in BUILDERS:
            continue
        key = id(record.depth) if isinstance(record, DepthImage) else None
        message = images.get(key)
        if message is None:
            message = BUILDERS[type(record)](types, record)
        if key is not None:
            images[key] = message
        found.append(Planned(log_ns, f"/{topic}", record, message))
    return Recording(found, f"/{DEPTH}", f"/{SCAN}")


def of_standing_robot(seconds: float) -> Recording:
    """Return the world `load` with all that moves standing as it does at the beginning."""
    recording = of_lasers(20.0)
    drive, found = recording.planned, []
    start_ns = drive[0].log_ns
    for topic in {each.topic for each in drive}:
        times = [each.log_ns for each in drive if each.topic == topic]
        first = next(each for each in drive if each.topic == topic)
        period = int(np.median(np.diff(times))) if len(times) > 1 else round(seconds * 1e9)
        for log_ns in range(start_ns, start_ns + round(seconds * 1e9), period):
            record = first.record
            if hasattr(record, "stamp_ns"):
                record = replace(record, stamp_ns=log_ns)
            found.append(Planned(log_ns, topic, record, first.message))
    return Recording(sorted(found, key=lambda each: each.log_ns), recording.mapped, recording.level)


def children_of(pid: int) -> list[int]:
    """Return the processes that a process started."""
    return [int(c) for c in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def cpu_seconds(pid: int) -> float:
    """Return the processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cpu_of_children(pid: int) -> float:
    """Return the processor time of the processes that a process started, s."""
    return sum(cpu_seconds(child) for child in children_of(pid))


def memory_mb(pid: int) -> tuple[int, int]:
    """Return what of a process is in memory, and that less what others share, MB."""
    lines = [line.split() for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()]
    kilobytes = {line[0]: int(line[1]) for line in lines[1:]}
    return kilobytes["Rss:"] // 1024, kilobytes["Pss:"] // 1024


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Run processes that want a whole core each."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


class Driver(Node):
    """Publishes in real time and hears what comes back."""

    def __init__(self, planned: list[Planned], speed: float):
        super().__init__("driver")
        self.planned, self.speed = planned, speed
        self.published: dict[tuple[str, int], float] = {}
        self.sent: Counter[str] = Counter()
        self.planes: list[tuple[float, int]] = []
        self.reports: dict[str, dict[str, str]] = {}
        examples = {each.topic: each.message for each in planned}
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
            depth=10 if isinstance(message, Image) else 200,
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
        """Publish everything when it is due; at full speed with stamps of now."""
        begin, first = time.time_ns() + 200_000_000, self.planned[0].log_ns
        self.shift_ns = begin - first
        for each in self.planned:
            due = begin + round((each.log_ns - first) / self.speed)
            while (left := due - time.time_ns()) > 0:
                rclpy.spin_once(self, timeout_sec=min(left * 1e-9, 0.002))
            if hasattr(each.message, "header"):
                header, stamp = each.message.header, each.stamp_ns + self.shift_ns
                header.stamp.sec, header.stamp.nanosec = divmod(stamp, 10**9)
                self.published[each.topic, each.stamp_ns] = time.time()
            self.pubs[each.topic].publish(each.message)
            self.sent[each.topic] += 1
        end = time.monotonic() + 2.5
        while time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.05)


def latencies(driver: Driver, cycles: list[tuple[int, int]], mapped: str) -> list[float]:
    """Return for each message of planes the time since its cycle's last measurement, ms.

    Of lasers that is the time of the last beam, of a camera when the last image was published.
    """
    ends, found = dict(cycles), []
    for at, stamp in driver.planes:
        end = ends.get(stamp - driver.shift_ns)
        if end is not None:
            begin = driver.published.get((mapped, end), (end + driver.shift_ns) * 1e-9)
            found.append(1e3 * (at - begin))
    return found


def offline_cycles(recording: Recording) -> list[tuple[int, int]]:
    """Return (stamp, last measurement) of each cycle, as a processor has them without any nodes."""
    from tccm_ros.config import Config
    from tccm_ros.mapping.tccm import TccmProcessor
    from tccm_ros.robot import Robot
    from tccm_ros.sensors.registry import default_streams

    robot = Robot(Config(), default_streams(), expects_odometry=True)
    processor, results = TccmProcessor(Config()), []
    for each in recording.planned:
        if each.topic != recording.level:
            for event in robot.add(each.topic.lstrip("/"), each.record):
                results += processor.add(event)
    return [(r.stamp_ns, r.end_ns) for r in results]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--camera", type=float, help="images per second of a depth camera")
    parser.add_argument("--stand", choices=STANDS, default="at the worktop", help="of the camera")
    parser.add_argument("--standing", action="store_true", help="lasers of a robot at rest")
    parser.add_argument("--speed", type=float, default=1.0, help="of real time")
    parser.add_argument("--busy", type=int, default=0, help="number of busy processes beside")
    args = parser.parse_args()
    if args.standing:
        recording = of_standing_robot(args.seconds)
    elif args.camera is None:
        recording = of_lasers(args.seconds)
    else:
        recording = of_camera(args.stand, args.camera, args.seconds)
    cycles = offline_cycles(recording)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "100")
    run = "from tccm_ros.nodes.start import {0}; {0}()"
    processes = [subprocess.Popen([sys.executable, "-c", run.format(n)]) for n in NODES]
    try:
        measure(recording, cycles, processes, args)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait()


def measure(recording: Recording, cycles, processes, args) -> None:
    rclpy.init()
    driver, mapped, level = Driver(recording.planned, args.speed), recording.mapped, recording.level
    driver.spin_until(lambda: driver.pubs[mapped].get_subscription_count() == 2)
    driver.spin_until(lambda: driver.pubs[level].get_subscription_count() == 1)
    for name in ("tccm", "surface_slam"):
        driver.spin_until(lambda n=name: driver.reports.get(n, {}).get("ready") == "True")
    before = [(cpu_seconds(p.pid), cpu_of_children(p.pid)) for p in processes]
    with busy(args.busy):
        driver.play()
    after = [(cpu_seconds(p.pid), cpu_of_children(p.pid)) for p in processes]
    elapsed = np.subtract(after, before) / args.seconds
    late = latencies(driver, cycles, mapped)
    print(
        "\n| node | of a core | its child | RSS, PSS | longest step | records received / sent "
        "| dropped |"
    )
    print("|---" * 7 + "|")
    memory = ["{} MB, {} MB".format(*memory_mb(p.pid)) for p in processes]
    for name, topic, used, held in zip(("tccm", "surface_slam"), (mapped, level), elapsed, memory):
        values = driver.reports[name]
        dropped = {k: v for k, v in values.items() if k.startswith(("dropped", "lost"))}
        print(
            f"| {name} | {used[0]:.1%} | {used[1]:.1%} | {held} | {values['longest step [s]']} s | "
            f"{values[f'received {topic}']} / {driver.sent[topic]} | {dropped or 'none'} |"
        )
    if late:
        median, p95, p99 = np.percentile(late, [50.0, 95.0, 99.0])
        print(
            f"\nplanes after a cycle's last measurement: median {median:.0f} ms, 95 % within "
            f"{p95:.0f} ms, 99 % within {p99:.0f} ms, {len(late)} of {len(cycles)} cycles"
        )
    driver.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
