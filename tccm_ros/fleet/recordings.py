"""Recordings of a fleet: search, names, and detection of changes.

Local paths and URLs with an ``fsspec`` driver (``s3://``, ``file://``) are handled alike.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from fsspec.core import url_to_fs

from tccm_ros.bags.bag_files import SUFFIXES
from tccm_ros.errors import BagError, FleetError, one_line

METADATA = "metadata.yaml"
"""A folder with this file is a recording."""

RESULTS = "surfaces.json"
"""A folder with this file has results; bags in it are not recordings."""

NAME_DIGITS = 8
"""Number of hexadecimal digits of the path's checksum in a name. Chosen: about one collision is
expected among 10^5 paths; it is refused."""

BLOCK = 1 << 20
"""Number of bytes per read."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording of a fleet.

    Attributes
    ----------
    name
        Name of its results: the end of its path, and a checksum of the whole path. It does not
        depend on the other recordings.
    source
        Absolute path, or URL.
    """

    name: str
    source: str

    @classmethod
    def of(cls, source: str) -> Recording:
        """Return the recording at a path or URL."""
        stem = PurePosixPath(source.rstrip("/")).name
        for suffix in SUFFIXES:
            stem = stem.removesuffix(suffix)
        digits = hashlib.sha256(source.encode()).hexdigest()[:NAME_DIGITS]
        plain = re.sub(r"[^\w.-]", "_", stem).lstrip(".")
        return cls(f"{plain}-{digits}", source)


@dataclass(frozen=True, slots=True)
class FileState:
    """A file of a recording.

    Attributes
    ----------
    name
        Path within the recording.
    size
        Size, bytes.
    token
        Token of the file system, which changes when the file does.
    """

    name: str
    size: int
    token: str


def find_recordings(sources: Iterable[str]) -> list[Recording]:
    """Return the distinct recordings of files, folders and patterns, sorted.

    A folder with a metadata.yaml is one recording. In other folders, each .mcap and .db3 file at
    any depth is one, except in result folders. A path given explicitly is a recording with any
    content; its task reports problems.

    Parameters
    ----------
    sources
        Paths or URLs, optionally with ``*``, ``?`` and ``**``.

    Raises
    ------
    FleetError
        If a path has no recording, or no driver is installed for a URL.
    """
    found: dict[str, Recording] = {}
    for text in sources:
        for source in _sources_of(text):
            recording = Recording.of(source)
            if found.setdefault(recording.name, recording).source != source:
                other = found[recording.name].source
                raise FleetError(f"{source} and {other}: the same name; rename one of them")
    return sorted(found.values(), key=lambda r: (r.source, r.name))


def _sources_of(text: str) -> list[str]:
    fs, path = _file_system(text)
    try:
        paths = sorted(fs.glob(path)) if set(text) & set("*?[") else [path]
        found = [item for p in paths for item in _search(fs, p, is_named=True)]
    except OSError as error:
        raise FleetError(f"{text}: cannot be read ({one_line(error)})") from None
    if not found:
        raise FleetError(f"{text}: no recording; expected .mcap or .db3 files or rosbag2 folders")
    return [_source(fs, item) for item in found]


def _file_system(text: str) -> tuple[Any, str]:
    try:
        fs, path = url_to_fs(text)
    except (ImportError, ValueError) as error:
        raise FleetError(f"{text}: {one_line(error)}") from None
    return fs, str(path)


def _source(fs: Any, path: str) -> str:
    return path if "file" in _protocols(fs) else str(fs.unstrip_protocol(path))


def _protocols(fs: Any) -> tuple[str, ...]:
    return (fs.protocol,) if isinstance(fs.protocol, str) else tuple(fs.protocol)


def _search(fs: Any, path: str, *, is_named: bool = False) -> Iterator[str]:
    """Yield the recordings at a path."""
    if not fs.isdir(path):
        if is_named or path.endswith(SUFFIXES):
            yield path
        return
    entries = sorted(str(p).rstrip("/") for p in fs.ls(path, detail=False))
    names = {PurePosixPath(entry).name for entry in entries}
    if METADATA in names:
        yield path
    elif RESULTS not in names:
        for entry in entries:
            if not PurePosixPath(entry).name.startswith("."):
                yield from _search(fs, entry)


def file_states(source: str) -> tuple[FileState, ...]:
    """Return the files of a recording, sorted by name; none if it does not exist.

    Parameters
    ----------
    source
        Path or URL of a recording.
    """
    fs, path = _file_system(source)
    found = fs.find(path, detail=True)
    states = []
    for name in sorted(found):
        relative = name[len(path) :].strip("/") or PurePosixPath(name).name
        states.append(FileState(relative, int(found[name]["size"] or 0), str(fs.ukey(name))))
    return tuple(states)


@contextmanager
def local_copy(source: str) -> Iterator[Path]:
    """Yield the local path of a recording, which is a temporary copy for a URL.

    Parameters
    ----------
    source
        Path or URL of a recording.

    Raises
    ------
    BagError
        If it does not exist or cannot be read.
    """
    fs, path = _file_system(source)
    if "file" in _protocols(fs):
        yield Path(path)
        return
    with TemporaryDirectory(prefix="tccm-fleet-") as folder:
        target = Path(folder) / PurePosixPath(path).name
        try:
            fs.get(path, str(target), recursive=bool(fs.isdir(path)))
        except OSError as error:
            raise BagError(f"{source}: cannot be fetched ({one_line(error)})") from None
        yield target


def content_checksum(path: Path) -> str:
    """Return the SHA-256 of the names and bytes of a file, or of all files of a folder.

    Parameters
    ----------
    path
        Local path.

    Raises
    ------
    BagError
        If it cannot be read.
    """
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    digest = hashlib.sha256()
    try:
        for file in files:
            name = file.relative_to(path).as_posix() if path.is_dir() else ""
            digest.update(f"{name}\0{file.stat().st_size}\0".encode())
            with file.open("rb") as stream:
                while block := stream.read(BLOCK):
                    digest.update(block)
    except OSError as error:
        raise BagError(f"{path}: cannot be read ({one_line(error)})") from None
    return digest.hexdigest()
