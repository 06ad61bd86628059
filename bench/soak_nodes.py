"""Both nodes as processes, bags that are played into them, and a client that watches both.

`soak.py bag` plays a bag in real time: pauses, drops, memory, saves, live = offline. `soak.py day`
plays flat after flat at random, with people, stops and faults, and scores each map.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from soak_flats import FAULTS
from std_srvs.srv import Trigger

from tccm_ros.bags.reader import BagReader
from tccm_ros.errors import TccmError
from tccm_ros.evaluate.score import score_trajectory
from tccm_ros.evaluate.surfaces import score_surfaces

NODES = {"tccm": "tccm_node", "surface_slam": "slam_node"}
SENSORS = {"tccm": "/tilt_scan", "surface_slam": "/scan"}
SERVICES = ("save_map", "reset", "load_map")
EQUAL = (
    "surfaces.json",
    "surfaces.ply",
    "walls.json",
    "signs.json",
    "graph.json",
    "trajectory.tum",
    "cuboids.npz",
)
SAVES = 0.4, 0.7
"""Fractions of a drive after which a map is saved."""

WAIT_S = 600.0
MEMORY_PERIOD_S = 5.0
PSS_PERIOD_S = 60.0

PAUSE_S = 0.1
"""Pauses of `/pose` longer than this are logged, s."""

GOES_BACK = 6
"""Every sixth flat, stamps go back to those of the first instead of a reset."""

LONG_AT, LAPS = 1, 2
"""Number of the long flat, and laps of the others."""

BETWEEN_S = 600.0
"""Time between the first stamps of two flats, s, for each `LAPS` laps."""


class Watch(Node):
    """Hears poses and diagnostics, and calls services."""

    def __init__(self) -> None:
        super().__init__("watch")
        self.poses: list[tuple[float, float]] = []
        self.reports: dict[str, dict[str, str]] = {}
        self.messages: dict[str, str] = {}
        self.periodic: Callable[[], None] = lambda: None
        self.on_timeout: Callable[[str], None] = sys.exit
        self.create_subscription(PoseWithCovarianceStamped, "/pose", self._on_pose, 200)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 10)
        pairs = [(node, what) for node in NODES for what in SERVICES]
        self.triggers = {p: self.create_client(Trigger, f"/{p[0]}/{p[1]}") for p in pairs}

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        stamp = message.header.stamp
        self.poses.append((time.monotonic(), stamp.sec + 1e-9 * stamp.nanosec))

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.reports[status.name] = {v.key: v.value for v in status.values}
            self.messages[status.name] = status.message

    def spin_until(
        self, predicate: Callable[[], object], what: str, timeout_s: float = WAIT_S
    ) -> None:
        """Spin until a condition holds; call `on_timeout` if that takes too long."""
        end = time.monotonic() + timeout_s
        while not predicate():
            if time.monotonic() > end:
                return self.on_timeout(f"timed out: {what}")
            rclpy.spin_once(self, timeout_sec=0.02)
            self.periodic()

    def call(self, node: str, what: str) -> tuple[float, str]:
        """Call a service; return its duration, s, and its message."""
        start_s = time.monotonic()
        future = self.triggers[node, what].call_async(Trigger.Request())
        self.spin_until(future.done, f"{node} {what}", 60.0)
        said = future.result().message if future.done() else "no answer"
        return time.monotonic() - start_s, said

    def save_all(self) -> tuple[float, str]:
        """Save with both nodes until the map contains everything; return as `call`."""
        self.call("tccm", "save_map")
        for _ in range(30):
            saved = self.call("surface_slam", "save_map")
            if "not in it" not in saved[1]:
                break
            again_s = time.monotonic() + 1.0
            self.spin_until(lambda s=again_s: time.monotonic() > s, "a second")
        return saved

    def hear_again(self, *names: str) -> None:
        """Wait for diagnostics of nodes that were written after now."""
        for _ in range(2):  # one may be on its way
            old = {name: self.reports.get(name) for name in names}
            self.spin_until(
                lambda o=old: all(self.reports.get(n) is not o[n] for n in o), "reports"
            )

    def has_last_cycle(self) -> bool:
        """Return whether the map has received all cycles of tccm_node."""
        cycles, received = self.reports["tccm"]["cycles"], self.reports["surface_slam"]
        return all(received[part] == cycles for part in ("clouds", "views", "boxes"))

    def pauses(self, away: Sequence[tuple[float, float]] = ()) -> list[float]:
        """Return the times between poses less those of their stamps, s, outside of `away`."""
        return [
            b[0] - a[0] - max(b[1] - a[1], 0.0)
            for a, b in zip(self.poses, self.poses[1:])
            if not any(a[0] <= end and begin <= b[0] for begin, end in away)
        ]


class Nodes:
    """The nodes as processes, which can be restarted."""

    def __init__(self, watch: Watch, words: Sequence[str], modules: dict[str, str] = NODES) -> None:
        self._watch, self._words, self._modules = watch, words, modules
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start_all(self, files: dict[str, TextIO] | None = None) -> None:
        """Start all nodes, and wait until they report."""
        self._files = files or {}
        for name in self._modules:
            self.start(name)
        self._watch.spin_until(lambda: set(NODES) <= set(self._watch.reports), "the nodes")

    def start(self, name: str) -> None:
        """Start a node, or start it again."""
        self.processes[name] = start(self._modules[name], *self._words, out=self._files.get(name))

    def stop(self, name: str) -> tuple[int, float]:
        """Stop a node; return its exit status and how long that took, s."""
        begin, process = time.monotonic(), self.processes[name]
        process.send_signal(signal.SIGINT)
        self._watch.spin_until(lambda: process.poll() is not None, f"the end of {name}")
        return process.wait(), time.monotonic() - begin

    def memory(self, of: Callable[[int], float]) -> dict[str, float]:
        """Return the memory of each running node, and of its children together, MB."""
        found = {}
        for name, process in self.processes.items():
            if process.poll() is None:
                found[name] = of(process.pid)
                found[f"children of {name}"] = sum(map(of, children_of(process.pid)))
        return {name: round(mb) for name, mb in found.items()}


def start(module: str, *words: str, out: TextIO | None = None) -> subprocess.Popen[bytes]:
    """Start a node; its output goes to a file, if any."""
    code = f"from tccm_ros.nodes.start import {module}; {module}()"
    command = [sys.executable, "-c", code, "--ros-args", *words]
    return subprocess.Popen(command, stdout=out, stderr=out and subprocess.STDOUT)


def play(
    watch: Watch, bag: Path, rate: float, acts: Sequence[tuple[float, Callable[[], object]]] = ()
) -> float:
    """Play a bag, and call functions at their times after the first pose, s; return the start."""
    words = f"bag:={bag}", f"rate:={rate}", "reliable:=true", "wait_for_subscribers:=60.0"
    player = start("player_node", *(w for word in words for w in ("-p", word)))
    try:
        watch.spin_until(lambda: watch.poses, "the first pose", 120.0)
        begin = watch.poses[0][0]
        for due_s, act in sorted(acts, key=lambda pair: pair[0]):
            watch.spin_until(
                lambda s=due_s: player.poll() is not None or time.monotonic() > begin + s,
                "the player",
                3600.0,
            )
            if player.poll() is None:
                act()
        watch.spin_until(lambda: player.poll() is not None, "the end of the bag", 3600.0)
    finally:
        player.kill()
    return begin


def children_of(pid: int) -> list[int]:
    """Return the processes that a process started."""
    return [int(c) for c in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def resident_mb(pid: int, *, highest: bool = False) -> float:
    """Return the resident memory of a process, now or at its highest, MB; 0 when it has ended."""
    return _kilobytes(pid, "status", "VmHWM" if highest else "VmRSS") * 1.024e-3


def pss_mb(pid: int) -> float:
    """Return the memory of a process, MB; memory common to n processes counts as an n-th."""
    return _kilobytes(pid, "smaps_rollup", "Pss:") * 1.024e-3


def _kilobytes(pid: int, file: str, key: str) -> int:
    try:
        lines = Path(f"/proc/{pid}/{file}").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith(key)), 0)


def duration(bag: Path) -> float:
    """Return the duration of a bag, s."""
    with BagReader(bag) as reader:
        return reader.duration


def saving(folder: Path) -> list[str]:
    """Return the arguments of nodes that save to a folder."""
    words = f"save.directory:={folder}", "qos.reliability:=reliable"
    return [w for word in words for w in ("-p", word)]


# --- one bag ---


def soak_bag(
    bag: Path, rate: float, remaps: Sequence[str], *, one_process: bool, compare: bool
) -> None:
    """Play a bag into the nodes, whose topics are remapped, and print figures."""
    with tempfile.TemporaryDirectory() as folder:
        live, offline = Path(folder) / "live", Path(folder) / "offline"
        rules = [word for rule in remaps for word in ("-r", rule)]
        modules = {"both": "all_in_one"} if one_process else NODES
        # The end of a session is solved as a batch, as a replay is; a save before it may not be.
        words = [*rules, *saving(live), "-p", "save.on_shutdown:=true"]
        _drive(bag, rate, words, modules)
        if not compare:
            return
        options = [word for rule in remaps for word in ("--remap", rule)]
        tccm = str(Path(sys.executable).with_name("tccm"))
        command = [tccm, "replay", str(bag), "--out", str(offline), "--no-pictures", "--quiet"]
        subprocess.run([*command, *options], check=True)
        for name in EQUAL:
            is_equal = (live / name).read_bytes() == (offline / name).read_bytes()
            print(f"{name}: {'equal' if is_equal else 'DIFFERS'}")


def _drive(bag: Path, rate: float, words: Sequence[str], modules: dict[str, str]) -> None:
    watch = Watch()
    nodes = Nodes(watch, words, modules)

    def print_save() -> None:
        print("save: {:.2f} s, {}".format(*watch.call("surface_slam", "save_map")), flush=True)

    def print_pss() -> None:
        parts = nodes.memory(pss_mb)
        print(f"PSS: {sum(parts.values())} MB ({parts})", flush=True)

    try:
        nodes.start_all()
        seconds = duration(bag) / rate
        acts = [(fraction * seconds, print_save) for fraction in SAVES]
        acts += [(s, print_pss) for s in np.arange(0.0, seconds, PSS_PERIOD_S)]
        play(watch, bag, rate, acts)
        print(f"longest pause of /pose: {max(watch.pauses()):.3f} s")
        watch.hear_again(*NODES)
        watch.spin_until(watch.has_last_cycle, "the last cycle's view")
        print("save: {:.2f} s, {}".format(*watch.save_all()))
        watch.hear_again(*NODES)
        print_pss()
        for name in NODES:
            values = watch.reports[name]
            print(name, {k: v for k, v in values.items() if not k.startswith("received")})
        print("peak memory, MB:", nodes.memory(lambda pid: resident_mb(pid, highest=True)))
    finally:
        for name in nodes.processes:
            print("exit status", nodes.stop(name)[0])


# --- a day ---


class Day:
    """Drives through flats until the time is over."""

    def __init__(self, out: Path, first: int, long: int) -> None:
        self._out, self._first, self._long = out, first, long
        self._map = out / "map"
        self._log_file, self._begin = (out / "log.jsonl").open("w"), time.monotonic()
        self._watch = Watch()
        self._watch.periodic = self._note
        self._watch.on_timeout = lambda what: self._log("timeout", what=what)
        words = [*saving(self._map), "-p", "save.on_shutdown:=true"]
        self._nodes = Nodes(self._watch, words)
        self._memory_due_s = 0.0
        self._said: Counter[str] = Counter()
        self._rows: list[str] = []

    def run(self, minutes: float) -> None:
        """Drive for so many minutes, and to the end of the flat; stop the nodes in the end."""
        end, number, making = time.monotonic() + 60.0 * minutes, 0, self._make(0)
        try:
            self._nodes.start_all({name: (self._out / f"{name}.txt").open("w") for name in NODES})
            while number == 0 or time.monotonic() < end:
                self._watch.spin_until(lambda m=making: m.poll() is not None, "a bag", 1200.0)
                if making.returncode:
                    raise SystemExit(f"flat {number} could not be made")
                making = self._make(number + 1)
                self._drive(number)
                number += 1
        finally:
            making.kill()
            for name in self._nodes.processes:
                status, taken_s = self._nodes.stop(name)
                self._rows.append(f"\n{name} stopped with status {status} in {taken_s:.1f} s")
            self._write_summary()

    def _make(self, number: int) -> subprocess.Popen[bytes]:
        """Make the bag of a flat in another process."""
        laps = self._long if number == LONG_AT else LAPS
        factor = number + (self._long // LAPS if number > LONG_AT else 0)
        later_s = 0.0 if self._goes_back(number) else BETWEEN_S * factor
        words = [str(self._folder(number)), "--seed", str(self._first + number)]
        words += ["--laps", str(laps), "--later", str(later_s), "--fault", self._fault(number)]
        script = str(Path(__file__).with_name("soak_flats.py"))
        return subprocess.Popen([sys.executable, script, *words])

    def _fault(self, number: int) -> str:
        return FAULTS[number % len(FAULTS)]

    def _folder(self, number: int) -> Path:
        return self._out / f"flat_{number}"

    def _goes_back(self, number: int) -> bool:
        return number > 0 and number % GOES_BACK == 0

    def _drive(self, number: int) -> None:
        folder, fault, watch = self._folder(number), self._fault(number), self._watch
        about = json.loads((folder / "about.json").read_text())
        self._log("flat", number=number, **about)
        shutil.rmtree(self._map, ignore_errors=True)
        if number and not self._goes_back(number):
            for name in NODES:
                self._call(name, "reset")
        watch.hear_again(*NODES)
        watch.poses.clear()
        before = {name: Counter(self._numbers(name)) for name in NODES}
        saves: list[tuple[float, str]] = []
        away: list[tuple[float, float]] = []

        def save() -> None:
            saves.append(self._call("surface_slam", "save_map"))

        def restart() -> None:
            begin = time.monotonic()
            if self._restart(fault) == "surface_slam":
                away.append((begin, time.monotonic()))

        acts = [(f * about["duration_s"], save) for f in SAVES]
        if fault.endswith("restarts"):
            acts.append((about["middle_s"] + 1.0, restart))
        play(watch, folder, 1.0, acts)
        pauses = watch.pauses(away)
        self._log("pauses", s=[round(s, 3) for s in pauses if s > PAUSE_S])
        saves.append(watch.save_all())
        watch.hear_again(*NODES)
        if self._map.exists():
            shutil.copytree(self._map, folder / "map")
        self._report(number, about, before, max(pauses), saves)

    def _restart(self, fault: str) -> str:
        """Restart the node of a fault, slam_node with its map; return its name."""
        name = "tccm" if fault.startswith("tccm") else "surface_slam"
        watch, begin = self._watch, time.monotonic()
        if name == "surface_slam":
            self._call(name, "save_map")
        self._nodes.stop(name)
        self._nodes.start(name)
        saver = watch.triggers[name, "save_map"]
        watch.spin_until(lambda: not saver.service_is_ready(), f"{name} to be gone", 10.0)
        watch.spin_until(saver.service_is_ready, f"{name} again", 120.0)
        watch.hear_again(name)
        if name == "surface_slam":
            self._call(name, "load_map")
            poses = len(watch.poses)
            watch.spin_until(lambda: len(watch.poses) > poses, "poses again", 60.0)
        self._log("restarted", node=name, s=time.monotonic() - begin)
        return name

    def _call(self, node: str, what: str) -> tuple[float, str]:
        taken_s, said = self._watch.call(node, what)
        self._log("service", node=node, what=what, s=round(taken_s, 3), said=said)
        return taken_s, said

    def _log(self, kind: str, **values: Any) -> None:
        row = {"t": round(time.monotonic() - self._begin, 2), "kind": kind, **values}
        print(json.dumps(row), file=self._log_file, flush=True)

    def _note(self) -> None:
        """Log memory and statuses that are not ok, every few seconds."""
        if time.monotonic() < self._memory_due_s:
            return
        self._memory_due_s = time.monotonic() + MEMORY_PERIOD_S
        self._log("memory", **self._nodes.memory(resident_mb), load=os.getloadavg()[0])
        for name, message in self._watch.messages.items():
            if message != "ok":
                self._said[f"{name}: {message}"] += 1

    def _numbers(self, name: str) -> dict[str, int]:
        """Return the counts of a node and of its laser."""
        values = {**self._watch.reports.get(name, {})}
        sensor = self._watch.reports.get(f"{name}: {SENSORS[name]}", {})
        values |= {f"sensor {key}": value for key, value in sensor.items()}
        return {key: int(value) for key, value in values.items() if value.isdigit()}

    def _report(
        self,
        number: int,
        about: dict[str, Any],
        before: dict[str, Counter[str]],
        pause_s: float,
        saves: list[tuple[float, str]],
    ) -> None:
        """Add the row of a flat to the summary."""
        cells = [str(number), about["fault"], f"{about['duration_s']:.0f}", f"{pause_s:.3f}"]
        for name, topic in SENSORS.items():
            now = self._numbers(name)
            has_restarted = any(now.get(k, 0) < n for k, n in before[name].items())
            base = Counter() if has_restarted else before[name]
            new = {key: n - base[key] for key, n in now.items()}
            dropped = {
                k.removeprefix("dropped: "): n
                for k, n in new.items()
                if k.startswith(("dropped", "lost", "refused")) and n
            }
            used, sent = new.get("sensor used", 0), about["sent"].get(topic, 0)
            cells += [f"{used} of {sent}", ", ".join(f"{k} {n}" for k, n in dropped.items()) or "-"]
            cells.append(self._watch.reports[name].get("longest step [s]", "?"))
            self._log("counts", node=name, new=new)
        cells.append(self._watch.reports["surface_slam"].get("solved in [s]", "?"))
        cells.append(", ".join(f"{s:.2f}" for s, _ in saves))
        memory = self._nodes.memory(resident_mb)
        cells.append("; ".join(f"{k} {v}" for k, v in memory.items()))
        cells += _score(self._folder(number), np.array(about["T_truth_map"]))
        self._rows.append("| " + " | ".join(cells) + " |")
        self._write_summary()

    def _write_summary(self) -> None:
        head = (
            "| flat | fault | s | pause, s | tilting scans used | dropped | step, s | "
            "level scans used | dropped | step, s | solution, s | saves, s | memory, MB | "
            "surfaces found | false | rms, m |"
        )
        lines = [head, "|" + "---|" * 16, *self._rows, "", "Statuses that were not ok, in s:", ""]
        lines += [f"- {n * MEMORY_PERIOD_S:.0f}: {said}" for said, n in self._said.most_common()]
        (self._out / "summary.md").write_text("\n".join(lines) + "\n")


def _score(folder: Path, T_truth_map: np.ndarray) -> list[str]:
    """Return the cells of surfaces found, false ones, and the error of the trajectory."""
    try:
        content = json.loads((folder / "map" / "surfaces.json").read_text())
        for surface in content["surfaces"]:
            for ring in (surface["boundary"], *surface["holes"]):
                xyz = np.array(ring).reshape(-1, 3)
                ring[:] = (xyz @ T_truth_map[:3, :3].T + T_truth_map[:3, 3]).tolist()
        moved = folder / "surfaces_in_truth.json"
        moved.write_text(json.dumps(content))
        found = score_surfaces(moved, folder / "truth.json")
        errors = score_trajectory(folder / "map", folder / "truth.tum").errors
        rms = float(np.sqrt(np.mean(errors["absolute, aligned"].translation ** 2)))
    except (OSError, TccmError, KeyError, ValueError) as problem:
        return [f"{type(problem).__name__}: {problem}", "?", "?"]
    return [f"{found.found} of {len(found.matches)}", str(len(found.false)), f"{rms:.3f}"]
