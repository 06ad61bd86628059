"""Record of a finished recording beside its results, and the reason of a failure.

Results depend on the recording's bytes, the configuration and the software, and the record has the
checksums of all three. If the file system reports the recording's files as unchanged since then,
their bytes are not read again.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import tccm_ros
from tccm_ros.config import Config
from tccm_ros.fleet.recordings import FileState
from tccm_ros.replay.replay import software_versions
from tccm_ros.results.models import CountsEntry


@dataclass(frozen=True, slots=True)
class Cost:
    """Resources used by a replay.

    Attributes
    ----------
    seconds, processor_seconds
        Wall time and processor time, s.
    peak_memory
        Peak memory of the process, bytes; 0 if unknown.
    bytes_read, bytes_written
        Sizes of the recording and of the results, bytes.
    """

    seconds: float
    processor_seconds: float
    peak_memory: int
    bytes_read: int
    bytes_written: int


@dataclass(frozen=True, slots=True)
class DoneRecord:
    """fleet.json: the inputs of a recording's results.

    Attributes
    ----------
    source
        Path or URL of the recording.
    software, settings, content
        SHA-256 of the software, of configuration and options, and of the recording's bytes.
    files
        State of the recording's files in the file system.
    counts
        Counts of the replay.
    bag_duration
        Duration of the bag, s.
    start
        Stamp of the first pose, s; None without poses.
    cost
        Resources used by the replay.
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

    def is_of(self, settings: str) -> bool:
        """Return whether the results come from this software with these settings."""
        return (self.software, self.settings) == (software_checksum(), settings)


@dataclass(frozen=True, slots=True)
class Failure:
    """Failure of a recording.

    Attributes
    ----------
    source
        Path or URL of the recording.
    reason
        Reason in one line.
    """

    source: str
    reason: str

    def __str__(self) -> str:
        is_named = self.source in self.reason
        return self.reason if is_named else f"{self.source}: {self.reason}"


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
