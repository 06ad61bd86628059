"""`tccm fleet`: replay many recordings, each atomically, and continue an interrupted run."""

from __future__ import annotations

import time
import uuid
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from distributed import Client, Future, wait
from distributed.scheduler import KilledWorker

from tccm_ros.atomic import remove_unfinished
from tccm_ros.config import Config
from tccm_ros.errors import FleetError, OutputError, one_line
from tccm_ros.fleet.catalogue import Catalogue
from tccm_ros.fleet.cluster import Workers, connected
from tccm_ros.fleet.layout import FleetFolder
from tccm_ros.fleet.page import write_page
from tccm_ros.fleet.record import Failure
from tccm_ros.fleet.recordings import Recording, find_recordings
from tccm_ros.fleet.task import Job, JobStatus, TaskResult, is_done, process
from tccm_ros.progress import Bars
from tccm_ros.results.numbers import write_json

LOOK_S = 5.0
"""Period for checking the set of workers while no task ends, s. Chosen."""


@dataclass(slots=True)
class FleetSummary:
    """Outcome of a run.

    Attributes
    ----------
    out
        Folder of the fleet.
    counts
        Number of recordings by outcome.
    failures
        Failures by name of the recording.
    seconds
        Duration of the run, s.
    """

    out: Path
    counts: Counter[JobStatus] = field(default_factory=Counter)
    failures: dict[str, Failure] = field(default_factory=dict)
    seconds: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as plain data."""
        failures = [{"source": f.source, "reason": f.reason} for f in self.failures.values()]
        counts = {outcome.value: self.counts[outcome] for outcome in JobStatus}
        return {"out": str(self.out), **counts, "seconds": self.seconds, "failures": failures}

    def text(self) -> str:
        """Return the outcome as lines for a terminal."""
        folder, counts = FleetFolder(self.out), self.counts
        lines = [f"failed    {f}" for f in self.failures.values()]
        lines.append(
            f"{counts[JobStatus.DONE]} replayed, {counts[JobStatus.UNCHANGED]} unchanged, "
            f"{counts[JobStatus.FAILED]} failed in {self.seconds:.0f} s"
        )
        lines.append(f"results   {folder.recordings}")
        lines.append(f"page      {folder.page}  (open it in a browser)")
        return "\n".join(lines)


def run_fleet(
    sources: Iterable[str],
    out: Path | str,
    config: Config,
    *,
    workers: Workers | None = None,
    remap: Sequence[str] = (),
    pictures: bool = True,
    bars: Bars | None = None,
) -> FleetSummary:
    """Replay recordings as tasks.

    Parameters
    ----------
    sources
        Paths, folders, patterns or URLs (see `find_recordings`).
    out
        Folder of the fleet. Workers on other machines must see it under the same path.
    config
        Configuration of the replays.
    workers
        Workers to use; one if None.
    remap, pictures
        As in `replay`.
    bars
        Progress bars.

    Raises
    ------
    FleetError
        If there is no recording, or no worker.
    OutputError
        If the folder cannot be written.
    """
    begin, bars, workers = time.monotonic(), bars or Bars(), workers or Workers()
    summary = FleetSummary(Path(out).absolute())
    folder = FleetFolder(summary.out)
    recordings = find_recordings(sources)
    _prepare(folder)
    bars.start("fleet", float(len(recordings)), "recordings")
    jobs: deque[Job] = deque()
    for recording in recordings:
        job = Job(recording, folder.path, config, tuple(remap), pictures)
        if is_done(job):
            _note(summary, recording, TaskResult(JobStatus.UNCHANGED), bars)
        else:
            jobs.append(job)
    try:
        if jobs:
            with connected(workers) as client:
                _run(client, jobs, summary, bars)
    finally:
        with suppress(OSError):
            remove_unfinished(folder.recordings)
        write_page(folder)
    summary.seconds = round(time.monotonic() - begin, 3)
    return summary


def _prepare(folder: FleetFolder) -> None:
    """Create the folders and remove unfinished results of killed tasks."""
    try:
        for path in (folder.recordings, folder.failures):
            path.mkdir(parents=True, exist_ok=True)
        remove_unfinished(folder.recordings)
    except OSError as error:
        raise OutputError(f"{folder.path}: cannot be written ({one_line(error)})") from None


def _run(client: Client, jobs: deque[Job], summary: FleetSummary, bars: Bars) -> None:
    """Keep every worker busy with exactly one task until all jobs are done."""
    running: dict[Future, Job] = {}
    try:
        while jobs or running:
            free = max(len(client.nthreads()), 1) - len(running)
            for _ in range(min(free, len(jobs))):
                job = jobs.popleft()
                # A unique key for each run, because the scheduler may know an earlier one.
                key = f"{job.recording.name}-{uuid.uuid4().hex}"
                running[client.submit(process, job, key=key, pure=False)] = job
            with suppress(TimeoutError, CancelledError):
                wait(list(running), timeout=LOOK_S, return_when="FIRST_COMPLETED")
            ended = [future for future in running if future.done()]
            if client.status != "running" or any(future.cancelled() for future in ended):
                raise FleetError("the scheduler ended; run the same command again to go on")
            for future in ended:
                _note(summary, running.pop(future).recording, _result(future), bars)
            if ended:
                Catalogue(FleetFolder(summary.out).catalogue).gather()
    except BaseException:
        with suppress(Exception):
            client.cancel(list(running))
        raise


def _result(future: Future) -> TaskResult:
    """Return the result of a task, or a failure if the task raised."""
    try:
        result: TaskResult = future.result()
        return result
    except KilledWorker as error:
        tries = error.allowed_failures + 1
        return TaskResult(JobStatus.FAILED, f"its worker died, {tries} times: memory or a crash?")
    except Exception as error:  # includes the cluster's errors for lost tasks
        return TaskResult(JobStatus.FAILED, f"{type(error).__name__}: {one_line(error)}")


def _note(summary: FleetSummary, recording: Recording, result: TaskResult, bars: Bars) -> None:
    """Count a result, and write or remove its failure file."""
    path = FleetFolder(summary.out).failure(recording.name)
    summary.counts[result.outcome] += 1
    if result.outcome is JobStatus.FAILED:
        failure = summary.failures[recording.name] = Failure(recording.source, result.reason)
        write_json(path, failure)
    else:
        path.unlink(missing_ok=True)
    bars.advance(1.0)
