"""A drive in real time through the nodes as processes: pauses, drops, memory, live = offline.

    tccm simulate flat DIR --set laps=2 --set always=true --set cycle_period=3.1
    python bench/soak_nodes.py DIR [--rate 1] [--remap NAME:=TOPIC]... [--no-replay] [--one]

Plays a bag into tccm_node and slam_node and prints each node's longest step, the longest pause of
`/pose`, what was dropped, the time of two saves in the midst of the drive and of one at the end,
the memory of each process and, once a minute, of the nodes and the processes that they started
together (PSS: what several have in common is divided among them), and whether the saved files are
those of a replay.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from std_srvs.srv import Trigger

from tccm_ros.bags.reader import BagReader

NODES = {"tccm": "tccm_node", "surface_slam": "slam_node"}
EQUAL = (
    "surfaces.json",
    "surfaces.ply",
    "walls.json",
    "signs.json",
    "graph.json",
    "trajectory.tum",
    "cuboids.npz",
)
SAVES = (0.4, 0.7)
"""Fractions of the drive after which a map is saved."""

WAIT_S = 600.0
MEMORY_PERIOD_S = 60.0


class Watch(Node):
    """Hears poses and diagnostics, and asks for saves."""

    def __init__(self) -> None:
        super().__init__("watch")
        self.poses: list[tuple[float, float]] = []
        self.reports: dict[str, dict[str, str]] = {}
        self.messages: dict[str, str] = {}
        self.create_subscription(PoseWithCovarianceStamped, "/pose", self._on_pose, 200)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 10)
        self._savers = {n: self.create_client(Trigger, f"/{n}/save_map") for n in NODES}

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        stamp = message.header.stamp
        self.poses.append((time.monotonic(), stamp.sec + 1e-9 * stamp.nanosec))

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.reports[status.name] = {v.key: v.value for v in status.values}
            self.messages[status.name] = status.message

    def spin_until(self, predicate: Callable[[], object], what: str) -> None:
        """Spin until something holds, or give up."""
        end = time.monotonic() + WAIT_S
        while not predicate():
            if time.monotonic() > end:
                raise SystemExit(f"timed out: {what}")
            rclpy.spin_once(self, timeout_sec=0.02)

    def save(self, name: str) -> tuple[float, str]:
        """Have a node save; return how long that took and what it said."""
        start = time.monotonic()
        future = self._savers[name].call_async(Trigger.Request())
        self.spin_until(future.done, f"{name} to save")
        return time.monotonic() - start, future.result().message

    def has_last_cycle(self) -> bool:
        """Return whether the map has heard all that tccm_node told of its cycles."""
        if not set(NODES) <= set(self.reports):
            return False
        cycles = self.reports["tccm"]["cycles"]
        heard = self.reports["surface_slam"]
        return all(heard[part] == cycles for part in ("clouds", "views", "boxes"))

    def pause(self) -> float:
        """Return the longest time between two poses, beyond that between their stamps, s."""
        pairs = zip(self.poses, self.poses[1:])
        return max((b[0] - a[0] - max(b[1] - a[1], 0.0) for a, b in pairs), default=0.0)


def start(module: str, *words: str) -> subprocess.Popen[bytes]:
    """Start a node."""
    code = f"from tccm_ros.nodes.start import {module}; {module}()"
    return subprocess.Popen([sys.executable, "-c", code, "--ros-args", *words])


def children_of(pid: int) -> list[int]:
    """Return the processes that a process started."""
    return [int(c) for c in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def resident_mb(pid: int, *, highest: bool = False) -> float:
    """Return the resident memory of a process, now or at its highest, MB; 0 when it has ended."""
    key = "VmHWM" if highest else "VmRSS"
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) * 1.024e-3 for line in lines if line.startswith(key)), 0.0)


def memory_mb(pid: int) -> tuple[float, float]:
    """Return the highest resident memory of a process and of its children, MB."""
    return resident_mb(pid, highest=True), sum(
        resident_mb(child, highest=True) for child in children_of(pid)
    )


def pss_mb(pid: int) -> float:
    """Return the memory of a process, MB; what n processes have in common counts as an n-th."""
    try:
        rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return 0.0
    kilobytes = next(line.split()[1] for line in rollup.splitlines() if line.startswith("Pss:"))
    return int(kilobytes) * 1.024e-3


def print_pss(minutes: float, processes: dict[str, subprocess.Popen[bytes]]) -> None:
    """Print the PSS of nodes, of the processes that they started, and of all together."""
    pids = {name: process.pid for name, process in processes.items()}
    children = {f"children of {name}": children_of(pid) for name, pid in pids.items()}
    each = {name: pss_mb(pid) for name, pid in pids.items()}
    each |= {name: sum(map(pss_mb, found)) for name, found in children.items() if found}
    parts = ", ".join(f"{name} {mb:.0f}" for name, mb in each.items())
    print(f"PSS after {minutes:.1f} min: {sum(each.values()):.0f} MB ({parts})", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("--rate", type=float, default=1.0)
    parser.add_argument("--remap", action="append", default=[], metavar="NAME:=TOPIC")
    parser.add_argument("--one", action="store_true", help="both nodes in one process: all_in_one")
    parser.add_argument("--no-replay", action="store_true", help="compare no files")
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "98")
    with tempfile.TemporaryDirectory() as folder:
        live, offline = Path(folder) / "live", Path(folder) / "offline"
        drive(arguments, live)
        if arguments.no_replay:
            return
        remaps = [word for remap in arguments.remap for word in ("--remap", remap)]
        command = ["tccm", "replay", str(arguments.bag), "--out", str(offline), "--no-pictures"]
        subprocess.run([*command, "--quiet", *remaps], check=True)
        for name in EQUAL:
            is_equal = (live / name).read_bytes() == (offline / name).read_bytes()
            print(f"{name}: {'equal' if is_equal else 'DIFFERS'}")


def drive(arguments: argparse.Namespace, folder: Path) -> None:
    """Play a bag into the nodes, whose topics are remapped, and print what they did."""
    bag, rate = arguments.bag, arguments.rate
    rclpy.init()
    watch = Watch()
    rules = [word for rule in arguments.remap for word in ("-r", rule)]
    saving = ("-p", f"save.directory:={folder}", "-p", "qos.reliability:=reliable")
    modules = {"both": "all_in_one"} if arguments.one else NODES
    processes = {name: start(module, *rules, *saving) for name, module in modules.items()}
    try:
        watch.spin_until(lambda: set(NODES) <= set(watch.reports), "the nodes")
        words = f"bag:={bag}", f"rate:={rate}", "reliable:=true", "wait_for_subscribers:=60.0"
        player = start("player_node", *(w for word in words for w in ("-p", word)))
        watch.spin_until(lambda: watch.poses, "the first pose")
        duration_s = duration(bag) / rate
        begin = watch.poses[0][0]
        due_s, memory_s = [begin + fraction * duration_s for fraction in SAVES], begin
        while player.poll() is None:
            next_s = min([memory_s, *due_s])
            watch.spin_until(
                lambda s=next_s: player.poll() is not None or time.monotonic() > s, "the player"
            )
            now_s = time.monotonic()
            if now_s > memory_s:
                print_pss((now_s - begin) / 60.0, processes)
                memory_s += MEMORY_PERIOD_S
            if due_s and now_s > due_s[0]:
                due_s.pop(0)
                print("save: {:.2f} s, {}".format(*watch.save("surface_slam")), flush=True)
        print(f"longest pause of /pose: {watch.pause():.3f} s")
        watch.save("tccm")
        watch.reports.clear()
        watch.spin_until(watch.has_last_cycle, "the last cycle's view")
        said = "not in it"
        while "not in it" in said:
            save_s, said = watch.save("surface_slam")
            print(f"save: {save_s:.2f} s, {said}")
        before = dict(watch.reports)
        watch.spin_until(lambda: watch.reports["tccm"] is not before["tccm"], "diagnostics")
        print_pss((time.monotonic() - begin) / 60.0, processes)
        for name in NODES:
            values = watch.reports[name]
            print(name, {k: v for k, v in values.items() if not k.startswith("received")})
        for name, process in processes.items():
            print(
                "{}: peak memory {:.0f} MB, children {:.0f} MB".format(
                    name, *memory_mb(process.pid)
                )
            )
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGINT)
            print("exit status", process.wait())
        rclpy.try_shutdown()


def duration(bag: Path) -> float:
    """Return the duration of a bag, s."""
    with BagReader(bag) as reader:
        return reader.duration


if __name__ == "__main__":
    main()
