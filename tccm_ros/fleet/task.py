"""Task of one recording: fetch it, replay it, and write its results, record and catalogue rows.

It runs in a worker. A result folder appears atomically with its record; a worker that is killed
before leaves no folder.
"""

from __future__ import annotations

import re
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from tccm_ros.atomic import output_folder
from tccm_ros.config import Config
from tccm_ros.errors import TccmError, one_line
from tccm_ros.fleet.catalogue import Catalogue
from tccm_ros.fleet.layout import RECORD, FleetFolder
from tccm_ros.fleet.record import (
    Cost,
    DoneRecord,
    settings_checksum,
    software_checksum,
)
from tccm_ros.fleet.recordings import (
    FileState,
    Recording,
    content_checksum,
    file_states,
    local_copy,
)
from tccm_ros.replay.replay import Summary, replay
from tccm_ros.results.folder_reader import read_json_or_none
from tccm_ros.results.numbers import write_json
from tccm_ros.results.trajectory import read_tum
from tccm_ros.warm_up.compilation import compile_kernels
from tccm_ros.warm_up.parts import PARTS

ONE_AT_A_TIME = threading.Lock()
"""Lock that makes a worker with several threads replay one recording at a time."""


class JobStatus(StrEnum):
    """State of a recording after its task."""

    DONE = "done"
    UNCHANGED = "unchanged"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Job:
    """Input of a task.

    Attributes
    ----------
    recording
        The recording.
    out
        Folder of the fleet, the same on all machines.
    config
        Configuration of the replay.
    remap
        Remapped topics.
    pictures
        Whether pictures and reports are written.
    """

    recording: Recording
    out: Path
    config: Config
    remap: tuple[str, ...] = ()
    pictures: bool = True

    @property
    def results(self) -> Path:
        """Folder of the recording's results."""
        return FleetFolder(self.out).results(self.recording.name)

    @property
    def settings(self) -> str:
        """Checksum of the configuration and options of the replay."""
        return settings_checksum(self.config, remap=self.remap, pictures=self.pictures)


@dataclass(frozen=True, slots=True)
class TaskResult:
    """Result of a task.

    Attributes
    ----------
    outcome
        Outcome of the recording.
    reason
        Reason for a failure, in one line.
    """

    outcome: JobStatus
    reason: str = ""


def is_done(job: Job) -> bool:
    """Return whether the results exist and the recording's files are unchanged.

    The recording is not read; the file system reports changes.
    """
    record = _last_record(job)
    with suppress(OSError, TccmError):
        return record is not None and record.files == file_states(job.recording.source)
    return False


def _last_record(job: Job) -> DoneRecord | None:
    """Return the record of results by this software with the job's settings; None without one."""
    record = read_json_or_none(job.results / RECORD, DoneRecord)
    return record if record is not None and record.is_of(job.settings) else None


def process(job: Job) -> TaskResult:
    """Replay a recording unless its results exist; report errors instead of raising them.

    Parameters
    ----------
    job
        The input.
    """
    with ONE_AT_A_TIME:
        try:
            return TaskResult(_process(job))
        except TccmError as error:
            return TaskResult(JobStatus.FAILED, one_line(error))
        except Exception as error:  # one recording must not end the others
            text = f"unexpected {type(error).__name__}: {one_line(error)}"
            return TaskResult(JobStatus.FAILED, text)


def _process(job: Job) -> JobStatus:
    states = file_states(job.recording.source)  # before reading, to detect later changes
    with local_copy(job.recording.source) as bag:
        if not bag.exists():
            raise TccmError(f"{job.recording.source}: no such recording")
        content = content_checksum(bag)
        record = _last_record(job)
        if record is not None and record.content == content:
            return JobStatus.UNCHANGED
        compile_kernels(PARTS, job.config)  # here, to exclude it from the recording's cost
        with output_folder(job.results, is_replaced=True) as folder:
            begin = time.monotonic(), time.process_time()
            _reset_peak_memory()
            summary = replay(bag, folder, job.config, remap=job.remap, pictures=job.pictures)
            cost = _cost(begin, states, folder)
            write_json(folder / RECORD, _record(job, states, content, summary, cost))
            # Before the folder is renamed: results without rows would never get any.
            Catalogue(FleetFolder(job.out).catalogue).add(job.recording.name, folder, job.results)
    return JobStatus.DONE


def _record(
    job: Job, states: tuple[FileState, ...], content: str, summary: Summary, cost: Cost
) -> DoneRecord:
    return DoneRecord(
        job.recording.source,
        software_checksum(),
        job.settings,
        content,
        states,
        summary.content.counts,
        summary.content.bag_duration,
        _start(summary.out),
        cost,
    )


def _start(folder: Path) -> float | None:
    stamps = read_tum(folder / "trajectory.tum").stamps
    return float(stamps[0]) if len(stamps) else None


def _cost(begin: tuple[float, float], states: tuple[FileState, ...], folder: Path) -> Cost:
    return Cost(
        round(time.monotonic() - begin[0], 3),
        round(time.process_time() - begin[1], 3),
        _peak_memory(),
        sum(state.size for state in states),
        sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()),
    )


def _reset_peak_memory() -> None:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_memory() -> int:
    """Return the peak resident size of this process since the last reset, bytes."""
    with suppress(OSError):
        found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
        return int(found[1]) * 1024 if found else 0
    return 0
