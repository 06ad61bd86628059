"""What tells that a recording is done: the record beside its results, and the reason of a failure.

Results are of a recording's bytes, of a configuration and of the software. The checksums of all
three are written with them. Where the files of a recording are as the file system described them
then, its bytes are not read again.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import tccm_ros
from tccm_ros.atomic import output_file
from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.fleet.layout import RECORD
from tccm_ros.fleet.recordings import FileState
from tccm_ros.replay.replay import software_versions
from tccm_ros.results.folder_reader import read_json
from tccm_ros.results.models import CountsEntry
from tccm_ros.results.numbers import json_text


@dataclass(frozen=True, slots=True)
class Cost:
    """What the replay of a recording took.

    Attributes
    ----------
    seconds, processor_seconds
        On the clock, and of the processors, s.
    peak_memory
        Of the process, bytes; 0 where the system does not tell.
    bytes_read, bytes_written
        Of the recording, and of the results.
    """

    seconds: float
    processor_seconds: float
    peak_memory: int
    bytes_read: int
    bytes_written: int


@dataclass(frozen=True, slots=True)
class DoneRecord:
    """fleet.json: what the results of a recording were made from.

    Attributes
    ----------
    source
        Path or URL of the recording.
    software, settings, content
        SHA-256 of the software, of configuration and options, and of the recording's bytes.
    files
        The recording's files as the file system described them.
    counts
        Of the replay.
    bag_duration
        s.
    start
        Stamp at which the recording begins, s; None for one without poses.
    cost
        Of the replay.
    """

    source: str
    software: str
    settings: str
    content: str
    files: tuple[FileState, ...]
    counts: CountsEntry
    bag_duration: float
    start: float | None
    cost: Cost

    def write(self, folder: Path) -> None:
        """Write it into a result folder."""
        with output_file(folder / RECORD) as made:
            made.write_text(json_text(self), encoding="utf-8")

    def is_of(self, settings: str) -> bool:
        """Return whether it was made by this software with these settings."""
        return (self.software, self.settings) == (software_checksum(), settings)


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a recording was set aside.

    Attributes
    ----------
    source
        Path or URL of the recording.
    reason
        One line.
    """

    source: str
    reason: str

    def __str__(self) -> str:
        is_named = self.source in self.reason
        return self.reason if is_named else f"{self.source}: {self.reason}"

    def write(self, path: Path) -> None:
        """Write it to a file."""
        with output_file(path) as made:
            made.write_text(json_text(self), encoding="utf-8")


def read_record(folder: Path) -> DoneRecord | None:
    """Return the record of a result folder; None without a readable one."""
    try:
        return read_json(folder / RECORD, DoneRecord)
    except MapError:
        return None


def read_failure(path: Path) -> Failure | None:
    """Return the failure in a file; None without a readable one."""
    try:
        return read_json(path, Failure)
    except MapError:
        return None


@cache
def software_checksum() -> str:
    """Return the SHA-256 of this package's code and of the versions of its libraries."""
    root = Path(tccm_ros.__file__).parent
    digest = hashlib.sha256(json.dumps(software_versions(), sort_keys=True).encode())
    for path in sorted(root.rglob("*")):
        if path.suffix in (".py", ".js", ".css", ".html"):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def settings_checksum(config: Config, **options: Any) -> str:
    """Return the SHA-256 of a configuration and of further options."""
    tree = {"config": config.model_dump(mode="json"), "options": options}
    return hashlib.sha256(json.dumps(tree, sort_keys=True).encode()).hexdigest()
