"""A fleet of recordings of random flats: two workers against one, cost of a recording, empty tasks.

Usage: python bench/bench_fleet.py [--recordings 100 --runs 3]

In each recording a robot scans one place in one of ten flats. The recordings are made once, in
``--folder``. Each run begins with an empty result; runs of one and of two workers take turns, and
the best of each count. Where other work shares the machine, only the times of the processors tell
something: the last but one line is made from them.
"""

from __future__ import annotations

import argparse
import hashlib
import resource
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from distributed import Client, LocalCluster, wait
from random_flats import random_flat

from tccm_ros.config import Config
from tccm_ros.fleet.cluster import Workers
from tccm_ros.fleet.layout import FleetFolder
from tccm_ros.fleet.record import Cost, DoneRecord
from tccm_ros.fleet.recordings import find_recordings
from tccm_ros.fleet.run import run_fleet
from tccm_ros.replay.replay import replay
from tccm_ros.results.folder_reader import read_json_or_none
from tccm_sim.engine import Simulation
from tccm_sim.options import Options
from tccm_sim.recording import record

FLATS = 10
STOPS = 1
MIN_STOPS = 5
"""Of the route through the smallest flat."""

SINGLE = 3
"""Recordings that are replayed by themselves, too, to compare the bytes."""

VARYING = {"timing.json", "report.html", "fleet.json"}
"""Files that hold times of the clock."""


@dataclass(frozen=True, slots=True)
class Run:
    """What a run took.

    Attributes
    ----------
    seconds
        On the clock.
    workers_s, client_s
        Of the processors: of all workers, and of the process with client and scheduler.
    costs
        Of the recordings.
    digests
        Of the results of each recording, by its name.
    """

    seconds: float
    workers_s: float
    client_s: float
    costs: list[Cost]
    digests: dict[str, str]


def write_recordings(folder: Path, count: int) -> None:
    """Write recordings, each with noise of its own; those that are there are left."""
    with ProcessPoolExecutor() as pool:
        for _ in pool.map(_write_recording, [folder] * count, range(count)):
            pass


def _write_recording(folder: Path, number: int) -> None:
    flat, robot = number % FLATS, number // FLATS
    path = folder / f"flat_{flat:02d}_robot_{robot:02d}"
    if not path.exists():
        first = robot % (MIN_STOPS - STOPS + 1)
        world = random_flat(flat, stops=slice(first, first + STOPS))
        record(Simulation(world, number, Options()), path)


def measure(recordings: Sequence[str], workers: int) -> Run:
    """Replay the recordings, and print what that took."""
    with tempfile.TemporaryDirectory() as out:
        client, children = time.process_time(), _children_s()
        summary = run_fleet(recordings, out, Config(), workers=Workers(workers), pictures=False)
        client, children = time.process_time() - client, _children_s() - children
        if summary.failures:
            raise SystemExit(summary.text())
        paths = sorted(FleetFolder(Path(out)).recordings.iterdir())
        found = (read_json_or_none(path, DoneRecord) for path in paths)
        costs = [record.cost for record in found if record is not None]
        digests = {path.name: digest(path) for path in paths}
    row = f"{summary.seconds:.1f} | {children:.1f} | {client:.1f}"
    print(f"| {workers} | {row} | {children / len(costs):.2f} |", flush=True)
    return Run(summary.seconds, children, client, costs, digests)


def _children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def digest(folder: Path) -> str:
    """Return the checksum of the files that are the same in each replay."""
    made = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        if path.name not in VARYING:
            made.update(path.name.encode() + path.read_bytes())
    return made.hexdigest()


def compare_bytes(recordings: Sequence[str], runs: Sequence[Run]) -> None:
    """Stop where two runs, or a replay of one recording by itself, differ."""
    for run in runs[1:]:
        if run.digests != runs[0].digests:
            raise SystemExit("two runs wrote different bytes")
    for recording in find_recordings(recordings)[:SINGLE]:
        with tempfile.TemporaryDirectory() as out:
            replay(recording.source, Path(out) / "out", Config(), pictures=False)
            if digest(Path(out) / "out") != runs[0].digests[recording.name]:
                raise SystemExit(f"{recording.source}: a single replay writes other bytes")
    print(f"\nthe same bytes in {len(runs)} runs and {SINGLE} single replays")


def print_costs(costs: Sequence[Cost]) -> None:
    """Print what a recording takes."""
    columns = {
        "processor, s": [cost.processor_seconds for cost in costs],
        "peak memory, MB": [1e-6 * cost.peak_memory for cost in costs],
        "recording, MB": [1e-6 * cost.bytes_read for cost in costs],
        "results, MB": [1e-6 * cost.bytes_written for cost in costs],
    }
    print("\n| of a recording | median | max |\n|---|---|---|")
    for name, values in columns.items():
        print(f"| {name} | {np.median(values):.2f} | {max(values):.2f} |")


def empty_tasks(count: int) -> None:
    """Print what the scheduler's process takes for tasks that do nothing."""
    cluster = LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
    )
    with cluster, Client(cluster) as client:
        process = psutil.Process()  # the scheduler and the client are in this process
        start, busy = time.perf_counter(), time.process_time()
        before = process.memory_info().rss
        futures = [client.submit(int, k, pure=False) for k in range(count)]
        wait(futures)
        seconds, busy = time.perf_counter() - start, time.process_time() - busy
        grown = process.memory_info().rss - before
    print(
        f"{count} empty tasks: {seconds:.1f} s, {1e3 * busy / count:.2f} ms of the scheduler's "
        f"and client's processor and {1e-3 * grown / count:.1f} kB each\n",
        flush=True,
    )


def main() -> None:
    """Run the measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=10)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--tasks", type=int, default=5000)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "tccm_fleet")
    arguments = parser.parse_args()
    empty_tasks(arguments.tasks)
    folder = arguments.folder / f"{arguments.recordings}"
    write_recordings(folder, arguments.recordings)
    print("| workers | s | workers' processor, s | client's, s | workers' for a recording, s |")
    print("|---|---|---|---|---|")
    order = [workers for _ in range(arguments.runs) for workers in (1, 2)]
    runs = [(workers, measure([str(folder)], workers)) for workers in order]
    print_costs([cost for _, run in runs for cost in run.costs])
    compare_bytes([str(folder)], [run for _, run in runs])
    one, two = ([run for workers, run in runs if workers == count] for count in (1, 2))
    busy_one = min(run.workers_s for run in one)
    busy_two = min(run.workers_s + run.client_s for run in two)
    print(f"\nby the processors' times, two could be {2 * busy_one / busy_two:.2f} x as fast")
    fastest = [min(run.seconds for run in group) for group in (one, two)]
    print(f"two workers are {fastest[0] / fastest[1]:.2f} x as fast as one")


if __name__ == "__main__":
    main()
