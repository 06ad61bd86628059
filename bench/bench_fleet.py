"""A fleet of recordings of random flats: two workers against one, cost of a recording, empty tasks.

Usage: python bench/bench_fleet.py [--recordings 100 --flats 10 --runs 3]

Recordings are made once, in ``--folder``. Each run begins with an empty result; the ratio is that
of the best runs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import psutil
from distributed import Client, LocalCluster, wait
from random_flats import random_flat

from tccm_ros.config import Config
from tccm_ros.fleet.cluster import Workers
from tccm_ros.fleet.layout import FleetFolder
from tccm_ros.fleet.record import read_record
from tccm_ros.fleet.run import run_fleet
from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.recording import simulate
from tccm_ros.pipeline.sim.worlds import WORLDS


def write_recordings(folder: Path, recordings: int, flats: int) -> None:
    """Write recordings of random flats, each with noise of its own; those there are left."""
    for k in range(recordings):
        path = folder / f"flat_{k % flats:02d}_robot_{k // flats:02d}"
        if not path.exists():
            WORLDS["random flat"] = partial(random_flat, k % flats), ""
            simulate("random flat", path, seed=k, options=Options())


def measure(folder: Path, workers: int) -> float:
    """Return the duration of a run, s; print the cost of a recording."""
    with tempfile.TemporaryDirectory() as out:
        summary = run_fleet([str(folder)], out, Config(), workers=Workers(workers), pictures=False)
        if summary.failures:
            raise SystemExit(summary.text())
        paths = FleetFolder(Path(out)).recordings.iterdir()
        costs = [record.cost for record in map(read_record, paths) if record is not None]
        columns = {
            "processor, s": [c.processor_seconds for c in costs],
            "peak memory, MB": [1e-6 * c.peak_memory for c in costs],
            "recording, MB": [1e-6 * c.bytes_read for c in costs],
            "results, MB": [1e-6 * c.bytes_written for c in costs],
        }
        cells = ", ".join(
            f"{name} {np.median(values):.1f} (max {max(values):.1f})"
            for name, values in columns.items()
        )
        print(f"{workers} workers: {summary.seconds:.1f} s; {cells}", flush=True)
        return summary.seconds


def empty_tasks(count: int) -> None:
    """Print what the scheduler's process takes for tasks that do nothing."""
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        Client(cluster) as client,
    ):
        process = psutil.Process()  # the scheduler and the client are in this process
        start, busy = time.perf_counter(), sum(process.cpu_times()[:2])
        before = process.memory_info().rss
        wait([client.submit(int, k, pure=False) for k in range(count)])
        seconds = time.perf_counter() - start
        busy = sum(process.cpu_times()[:2]) - busy
        grown = process.memory_info().rss - before
        print(
            f"{count} empty tasks: {seconds:.1f} s, {1e3 * busy / count:.2f} ms of the scheduler's "
            f"and client's processor and {1e-3 * grown / count:.1f} kB each"
        )


def main() -> None:
    """Run the measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=4)
    parser.add_argument("--flats", type=int, default=2)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--tasks", type=int, default=5000)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "tccm_fleet")
    arguments = parser.parse_args()
    empty_tasks(arguments.tasks)
    write_recordings(arguments.folder, arguments.recordings, arguments.flats)
    best = {
        workers: min(measure(arguments.folder, workers) for _ in range(arguments.runs))
        for workers in (1, 2)
    }
    print(f"two workers are {best[1] / best[2]:.2f} x as fast as one")


if __name__ == "__main__":
    main()
