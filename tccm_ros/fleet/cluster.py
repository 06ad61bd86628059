"""Workers of a fleet: processes of this machine, or those of a running scheduler."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from tempfile import TemporaryDirectory

import dask
from distributed import Client, LocalCluster

from tccm_ros.errors import FleetError, one_line

MAX_DEATHS = 2
"""Number of workers that may die on a recording before it is counted as failed."""

START_TIMEOUT_S = 60.0
"""Timeout for a scheduler's first worker, s. Chosen."""

SETTINGS = {
    "distributed.scheduler.allowed-failures": MAX_DEATHS,
    # One task per worker: a task queued on a worker that dies would also be blamed.
    "distributed.scheduler.worker-saturation": 1.0,
    # A solver may hold the interpreter for minutes: a silent worker is not dead.
    "distributed.scheduler.worker-ttl": None,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.comm.timeouts.connect": "30s",
    "distributed.worker.preload": ["tccm_ros.fleet.worker_setup"],
}
"""Configuration of a cluster on this machine."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Choice of workers.

    Attributes
    ----------
    count
        Number of processes on this machine.
    memory
        Memory limit of each, in Dask's format (``4GiB``; ``auto``: an equal part of the machine's).
    scheduler
        Address of a running scheduler to use instead; empty for none.
    """

    count: int = 1
    memory: str = "auto"
    scheduler: str = ""


@contextmanager
def connected(workers: Workers) -> Iterator[Client]:
    """Yield a client; a cluster started for it ends with it.

    Parameters
    ----------
    workers
        Workers to use.

    Raises
    ------
    FleetError
        If the scheduler does not answer or has no workers, or if the memory limit is invalid.
    """
    _silence()
    if workers.scheduler:
        with _running(workers.scheduler) as client:
            yield client
        return
    with dask.config.set(SETTINGS), TemporaryDirectory(prefix="tccm-workers-") as folder:
        try:
            cluster = LocalCluster(
                n_workers=workers.count,
                threads_per_worker=1,
                memory_limit=workers.memory,
                dashboard_address="127.0.0.1:0",  # any port: another fleet may run on this machine
                local_directory=folder,
                silence_logs=logging.CRITICAL,
            )
        except (ValueError, TypeError) as error:
            raise FleetError(f"memory limit '{workers.memory}': {one_line(error)}") from None
        with cluster, Client(cluster) as client:
            yield client


def _silence() -> None:
    """Silence the library's loggers; errors are reported once, in one line.

    Some of its loggers have a level of their own.
    """
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextmanager
def _running(address: str) -> Iterator[Client]:
    try:
        client = Client(address, timeout=START_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise FleetError(f"{address}: no scheduler answers ({one_line(error)})") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=START_TIMEOUT_S)
        except TimeoutError:
            raise FleetError(f"{address}: no workers; start some: dask worker {address}") from None
        yield client
