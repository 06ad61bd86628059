"""A day on the robot: hours of simulated driving in real time through both nodes as processes.

    setsid sh -c 'echo -15 > /proc/self/autogroup; exec python bench/soak_day.py DIR'
        [--minutes 120] [--first 1] [--long 5]

Flat after flat at random (`soak_flats.py`, made while the one before is driven), with people and
stops. Between two flats both nodes are reset by their service; each sixth flat has the stamps of
the first again instead, which the nodes must notice themselves. In the middle of each flat comes
one of the faults of `soak_flats.py`. Each flat's map is saved twice on the way and at its end.

The first line of the command keeps other work on the machine from disturbing the nodes, where the
scheduler groups processes by session. DIR then has
- `summary.md`, a row for each flat, and what nobody has explained: warnings of the nodes;
- `log.jsonl`, with memory every 5 s, each pause of `/pose` over 0.1 s, each save, each status;
- `tccm.txt`, `slam.txt`, `player.txt`: what the nodes said;
- `flat_N/`: bag, truth and the map that was saved at its end.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import rclpy
from soak_flats import FAULTS
from soak_nodes import Watch, children_of, resident_mb
from std_srvs.srv import Trigger

from tccm_ros.errors import TccmError
from tccm_ros.evaluate.score import score_trajectory
from tccm_ros.evaluate.surfaces import score_surfaces

MODULES = {"tccm": "tccm_node", "surface_slam": "slam_node"}
SENSORS = {"tccm": "/tilt_scan", "surface_slam": "/scan"}
MEMORY_PERIOD_S = 5.0
PAUSE_S = 0.1
"""Pauses of `/pose` longer than this are logged, s."""

GOES_BACK = 6
"""Each so many flats, stamps go back to those of the first instead of a reset."""

LONG_AT = 1
"""Number of the flat that is driven for so many laps."""

LAPS = 2
BETWEEN_S = 600.0
"""Between the first stamps of two flats, s, for each `LAPS` laps."""

FACTOR_SAVES = 0.3, 0.8
"""Fractions of a drive after which its map is saved."""


class Log:
    """Writes one JSON object a line, flushed."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w")
        self._begin = time.monotonic()

    def write(self, kind: str, **values: Any) -> None:
        """Write what happened."""
        row = {"t": round(time.monotonic() - self._begin, 2), "kind": kind, **values}
        print(json.dumps(row), file=self._file, flush=True)


class Nodes:
    """The two nodes as processes, which can be restarted."""

    def __init__(self, out: Path, map_folder: Path, log: Log) -> None:
        self._files: dict[str, TextIO] = {n: (out / f"{n}.txt").open("w") for n in MODULES}
        self._saving = [f"save.directory:={map_folder}", "qos.reliability:=reliable"]
        self._saving += ["save.on_shutdown:=true"]
        self._log = log
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str) -> None:
        """Start a node, or start it again."""
        words = [w for word in self._saving for w in ("-p", word)]
        self.processes[name] = start(MODULES[name], words, self._files[name])

    def stop(self, name: str, wait: Callable[[Callable[[], bool]], None]) -> tuple[int, float]:
        """Stop a node; return its status and how long that took, s; `wait` until something is."""
        begin = time.monotonic()
        process = self.processes[name]
        process.send_signal(signal.SIGINT)
        wait(lambda: process.poll() is not None)
        status = process.wait()
        self._log.write("stopped", node=name, status=status, s=time.monotonic() - begin)
        return status, time.monotonic() - begin

    def memory(self) -> dict[str, float]:
        """Return the resident memory of each node and of its children, MB."""
        found = {}
        for name, process in self.processes.items():
            if process.poll() is None:
                found[name] = round(resident_mb(process.pid))
                found[f"{name} children"] = round(sum(map(resident_mb, children_of(process.pid))))
        return found


def start(module: str, words: list[str], out: TextIO) -> subprocess.Popen[bytes]:
    code = f"from tccm_ros.nodes.start import {module}; {module}()"
    words = [sys.executable, "-c", code, "--ros-args", *words]
    return subprocess.Popen(words, stdout=out, stderr=subprocess.STDOUT)


class Day:
    """Drives through flats until the time is over."""

    def __init__(self, out: Path, first: int, long: int) -> None:
        self._out, self._first, self._long = out, first, long
        self._map = out / "map"
        self._log = Log(out / "log.jsonl")
        self._nodes = Nodes(out, self._map, self._log)
        self._watch = Watch()
        self._triggers = {
            (node, what): self._watch.create_client(Trigger, f"/{node}/{what}")
            for node in MODULES
            for what in ("save_map", "reset", "load_map")
        }
        self._player_file = (out / "player.txt").open("w")
        self._player: subprocess.Popen[bytes] | None = None
        self._memory_due_s = 0.0
        self._seen = 0
        self._is_fault = False
        self._counted: dict[str, Counter[str]] = {}
        self._said: Counter[str] = Counter()
        self._rows: list[str] = []

    def run(self, minutes: float) -> None:
        """Drive for so many minutes, and to the end of the flat; stop the nodes in the end."""
        end = time.monotonic() + 60.0 * minutes
        making = self._make(0)
        for name in MODULES:
            self._nodes.start(name)
        try:
            self._wait(lambda: set(MODULES) <= set(self._watch.reports), 600.0, "the nodes")
            self._wait(lambda: making.poll() is not None, 600.0, "the first bag")
            number = 0
            while True:
                if making.wait():
                    raise SystemExit(f"flat {number} could not be made")
                making = self._make(number + 1)
                self._drive(number)
                number += 1
                if time.monotonic() > end:
                    break
                self._wait(lambda m=making: m.poll() is not None, 1200.0, "the next bag")
            making.kill()
        finally:
            if self._player is not None and self._player.poll() is None:
                self._player.kill()
            for name in MODULES:
                status, taken_s = self._nodes.stop(name, self._wait_for_end)
                self._rows.append(f"\n{name} stopped with status {status} in {taken_s:.1f} s")
            self._write_summary()

    # --- one flat ---

    def _fault(self, number: int) -> str:
        return FAULTS[number % len(FAULTS)]

    def _folder(self, number: int) -> Path:
        return self._out / f"flat_{number}"

    def _goes_back(self, number: int) -> bool:
        return number > 0 and number % GOES_BACK == 0

    def _make(self, number: int) -> subprocess.Popen[bytes]:
        laps = self._long if number == LONG_AT else LAPS
        factor = number + (self._long // LAPS if number > LONG_AT else 0)
        later_s = 0.0 if self._goes_back(number) else BETWEEN_S * factor
        words = [str(self._folder(number)), "--seed", str(self._first + number)]
        words += ["--laps", str(laps), "--later", str(later_s), "--fault", self._fault(number)]
        script = Path(__file__).with_name("soak_flats.py")
        return subprocess.Popen([sys.executable, str(script), *words])

    def _drive(self, number: int) -> None:
        folder, fault = self._folder(number), self._fault(number)
        about = json.loads((folder / "about.json").read_text())
        self._log.write("flat", number=number, **about)
        shutil.rmtree(self._map, ignore_errors=True)
        if number and not self._goes_back(number):
            for name in MODULES:
                self._call(name, "reset")
        self._hear_again(*MODULES)
        self._watch.poses.clear()
        self._seen = 0
        before = {name: Counter(self._numbers(name)) for name in MODULES}
        begin = time.monotonic()
        words = [f"bag:={folder}", "reliable:=true", "wait_for_subscribers:=60.0"]
        words = [w for word in words for w in ("-p", word)]
        self._player = start("player_node", words, self._player_file)
        self._wait(lambda: self._watch.poses, 120.0, "the first pose")
        begin = time.monotonic()
        saves, pauses = [], []
        for at_s, act in self._plan(about):
            self._wait(lambda t=at_s: time.monotonic() > begin + t or self._is_over(), 3600.0, "")
            pauses.append(self._note_pauses())
            if act == "save":
                saves.append(self._call("surface_slam", "save_map"))
            else:
                self._do(fault)
        self._wait(self._is_over, 3600.0, "the end of the bag")
        pauses.append(self._note_pauses())
        self._call("tccm", "save_map")
        for _ in range(30):
            taken_s, said = self._call("surface_slam", "save_map")
            if "not in it" not in said:
                break
            again_s = time.monotonic() + 1.0
            self._wait(lambda t=again_s: time.monotonic() > t, 5.0, "")
        self._hear_again(*MODULES)
        if self._map.exists():
            shutil.copytree(self._map, folder / "map")
        self._report(number, about, before, max(pauses), [*saves, (taken_s, said)])

    def _hear_again(self, *names: str) -> None:
        """Wait for diagnostics of nodes that were written after now."""
        for _ in range(2):  # one may be on its way
            at = {name: self._watch.reports.get(name) for name in names}
            self._wait(lambda a=at: self._has_heard_since(a), 120.0, "reports")

    def _has_heard_since(self, at: dict[str, Any]) -> bool:
        return all(self._watch.reports.get(name) is not old for name, old in at.items())

    def _plan(self, about: dict[str, Any]) -> list[tuple[float, str]]:
        plan = [(f * about["duration_s"], "save") for f in FACTOR_SAVES]
        return sorted([*plan, (about["middle_s"] + 1.0, "fault")])

    def _is_over(self) -> bool:
        return self._player is not None and self._player.poll() is not None

    def _do(self, fault: str) -> None:
        """Restart a node, if that is the fault."""
        name = {"tccm_node restarts": "tccm", "slam_node restarts": "surface_slam"}.get(fault)
        if name is None:
            return
        if name == "surface_slam":
            self._call(name, "save_map")
        self._nodes.stop(name, self._wait_for_end)
        self._nodes.start(name)
        begin, poses = time.monotonic(), len(self._watch.poses)
        saver = self._triggers[name, "save_map"]
        self._wait(lambda: not saver.service_is_ready(), 10.0, f"{name} to be gone")
        self._wait(saver.service_is_ready, 120.0, f"{name} again")
        self._hear_again(name)
        said = self._call(name, "load_map")[1] if name == "surface_slam" else ""
        if name == "surface_slam":
            self._wait(lambda: len(self._watch.poses) > poses, 60.0, "poses again")
            self._seen = len(self._watch.poses)
        self._log.write("restarted", node=name, s=time.monotonic() - begin, said=said)

    # --- watching ---

    def _wait(self, predicate: Any, timeout_s: float, what: str) -> None:
        """Spin until something holds, or until it is too late, which is logged."""
        end = time.monotonic() + timeout_s
        while not predicate():
            if time.monotonic() > end:
                self._log.write("timeout", what=what)
                return
            rclpy.spin_once(self._watch, timeout_sec=0.05)
            if time.monotonic() > self._memory_due_s:
                self._memory_due_s = time.monotonic() + MEMORY_PERIOD_S
                self._log.write("memory", **self._nodes.memory(), load=os.getloadavg()[0])
                self._note_warnings()

    def _wait_for_end(self, has_ended: Callable[[], bool]) -> None:
        """Spin meanwhile: poses that come then are not late."""
        self._wait(has_ended, 60.0, "the end of a node")

    def _call(self, node: str, what: str) -> tuple[float, str]:
        """Call a service; return how long that took and what it said."""
        begin = time.monotonic()
        future = self._triggers[node, what].call_async(Trigger.Request())
        self._wait(future.done, 60.0, f"{node} {what}")
        taken_s = time.monotonic() - begin
        answer = future.result() if future.done() else None
        said = "no answer" if answer is None else f"{answer.success}: {answer.message}"
        self._log.write("service", node=node, what=what, s=round(taken_s, 3), said=said)
        return taken_s, said

    def _note_pauses(self) -> float:
        """Log long pauses since the last look; return the longest, s."""
        poses, longest = self._watch.poses, 0.0
        for (t0, s0), (t1, s1) in zip(poses[self._seen :], poses[self._seen + 1 :]):
            pause_s = t1 - t0 - max(s1 - s0, 0.0)
            longest = max(longest, pause_s)
            if pause_s > PAUSE_S:
                self._log.write("pause", s=round(pause_s, 3), stamp=s0)
        self._seen = max(len(poses) - 1, 0)
        return longest

    def _note_warnings(self) -> None:
        for name, values in self._watch.messages.items():
            if values != "ok" and self._said[f"{name}: {values}"] == 0:
                self._log.write("status", name=name, message=values)
            if values != "ok":
                self._said[f"{name}: {values}"] += 1

    def _numbers(self, name: str) -> dict[str, int]:
        """Return what a node has counted."""
        values = {**self._watch.reports.get(name, {})}
        sensor = self._watch.reports.get(f"{name}: {SENSORS[name]}", {})
        values |= {f"sensor {key}": value for key, value in sensor.items()}
        return {key: int(value) for key, value in values.items() if value.isdigit()}

    # --- figures ---

    def _report(
        self,
        number: int,
        about: dict[str, Any],
        before: dict[str, Counter[str]],
        pause_s: float,
        saves: list[tuple[float, str]],
    ) -> None:
        """Write a flat's row and what its numbers are."""
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
            longest = self._watch.reports.get(name, {}).get("longest step [s]", "?")
            used, sent = new.get("sensor used", 0), about["sent"].get(topic, 0)
            cells += [f"{used} of {sent}", ", ".join(f"{k} {n}" for k, n in dropped.items()) or "-"]
            cells.append(longest)
            self._log.write("counts", node=name, new=new, all=self._watch.reports.get(name, {}))
        slam = self._watch.reports.get("surface_slam", {})
        cells.append(slam.get("solved in [s]", "?"))
        cells.append(", ".join(f"{s:.2f}" for s, _ in saves))
        memory = self._nodes.memory()
        cells.append("; ".join(f"{k} {v:.0f}" for k, v in memory.items()))
        cells += self._score(self._folder(number), np.array(about["T_truth_map"]))
        self._rows.append("| " + " | ".join(cells) + " |")
        self._log.write("row", cells=cells)
        self._write_summary()

    def _score(self, folder: Path, T_truth_map: np.ndarray) -> list[str]:
        try:
            content = json.loads((folder / "map" / "surfaces.json").read_text())
            for surface in content["surfaces"]:
                for ring in (surface["boundary"], *surface["holes"]):
                    xyz = np.array(ring).reshape(-1, 3)
                    ring[:] = (xyz @ T_truth_map[:3, :3].T + T_truth_map[:3, 3]).tolist()
            moved = folder / "surfaces_in_truth.json"
            moved.write_text(json.dumps(content))
            found = score_surfaces(moved, folder / "truth.json")
            error = score_trajectory(folder / "map", folder / "truth.tum").errors[
                "absolute, aligned"
            ]
            rms = float(np.sqrt(np.mean(error.translation**2)))
        except (OSError, TccmError, KeyError, ValueError) as problem:
            return [f"{type(problem).__name__}: {problem}", "?", "?"]
        return [f"{found.found} of {len(found.matches)}", str(len(found.false)), f"{rms:.3f}"]

    def _write_summary(self) -> None:
        head = (
            "| flat | fault | s | pause, s | tilting scans used | dropped | step, s | "
            "level scans used | dropped | step, s | solution, s | saves, s | memory, MB | "
            "surfaces found | false | rms, m |"
        )
        lines = [head, "|" + "---|" * 16, *self._rows, "", "Statuses that were not ok, in s:", ""]
        lines += [f"- {n * MEMORY_PERIOD_S:.0f}: {said}" for said, n in self._said.most_common()]
        (self._out / "summary.md").write_text("\n".join(lines) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--first", type=int, default=1, help="seed of the first flat")
    parser.add_argument("--long", type=int, default=5, help="laps of the second flat")
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "97")
    arguments.out.mkdir(parents=True)
    rclpy.init()
    Day(arguments.out, arguments.first, arguments.long).run(arguments.minutes)
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
