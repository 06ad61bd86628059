"""Files and folders that change whole or not at all, whatever ends the process.

A file is written under a temporary name beside its place, flushed to the disk and moved there.
What is new in a folder is written into a temporary folder and flushed to the disk. One rename makes
that the folder or, where this exists, puts it inside as ``.tccm-ready-*``: from then on it is
saved. Its files replace those of the same name one after the other. If this is interrupted,
`finish_moves` goes on with it, before anything is read from the folder or written into it. What a
process that was killed has left half-written beside a folder is removed when the folder is written
again.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tccm_ros.errors import OutputError, one_line

__all__ = ["finish_moves", "output_file", "output_folder"]

READY = ".tccm-ready-"
"""Begins the name of a folder within another whose files are to be moved there."""

UNFINISHED = ".tccm-new-"
"""Ends, with random letters, the hidden name of a folder that is being written."""


@contextmanager
def output_file(path: Path | str) -> Iterator[Path]:
    """Give a temporary path beside `path`; what is written there replaces `path` at the end.

    After an error `path` is as before and nothing is left beside it.

    Parameters
    ----------
    path
        The file; it need not exist, its folder is made.

    Raises
    ------
    OutputError
        If it cannot be written; any OSError of the block counts as that.
    """
    path = Path(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        _flush_entry(beside)  # a rename that outlives its content would leave an empty file
        os.replace(beside, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)})") from None
    finally:
        with suppress(OSError):
            beside.unlink()


@contextmanager
def output_folder(out: Path | str, *, is_replaced: bool = False) -> Iterator[Path]:
    """Give a temporary folder beside `out`, and move what is in it to `out` at the end.

    Files of the same name in `out` are replaced, other files there stay. After an error nothing
    is moved and the temporary folder is removed.

    Parameters
    ----------
    out
        The folder; it need not exist, its parent is made.
    is_replaced
        Whether `out` is replaced as a whole: what else was there goes.

    Raises
    ------
    OutputError
        If `out` is a file or cannot be written; found before any work is done.
    """
    out = Path(os.path.abspath(out))
    try:
        home = _home(out)
        finish_moves(out)
        _remove_unfinished(home, out.name)
        made, lock = _make(home, out.name)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written ({one_line(error)})") from None
    ready = out / (READY + made.name.rpartition("-")[2])
    try:
        yield made
        try:
            names = os.listdir(made)
            _move(made, ready, out)
            if is_replaced:
                _remove_others(out, names)
        except OSError as error:
            raise OutputError(f"{out}: cannot be written ({one_line(error)})") from None
    finally:
        for folder in (made, ready):
            shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def finish_moves(out: Path) -> None:
    """Move the files into a folder that were ready when a process was killed.

    Raises
    ------
    OSError
        If they cannot be moved.
    """
    with suppress(FileNotFoundError, NotADirectoryError):
        for name in sorted(name for name in os.listdir(out) if name.startswith(READY)):
            # Another process may be at it: wait for its end, or do the rest.
            with suppress(FileNotFoundError):
                lock = _lock(out / name)
                try:
                    _move_files(out / name, out)
                finally:
                    os.close(lock)


def _home(out: Path) -> Path:
    """Return where the temporary folder is made: beside `out`, or in it where that is no help."""
    if out.exists() and not out.is_dir():
        raise NotADirectoryError(f"{out.name} is a file; give a folder")
    out.parent.mkdir(parents=True, exist_ok=True)
    if not out.exists():
        return out.parent
    if not os.access(out, os.W_OK | os.X_OK):
        raise PermissionError("no permission to write")
    is_alike = out.stat().st_dev == out.parent.stat().st_dev
    return out.parent if is_alike and os.access(out.parent, os.W_OK | os.X_OK) else out


def _make(home: Path, name: str) -> tuple[Path, int]:
    """Return a new folder and its lock, which tells others that somebody writes it."""
    while True:
        made = Path(tempfile.mkdtemp(prefix=f".{name}{UNFINISHED}", dir=home))
        with suppress(FileNotFoundError):
            lock = _lock(made)
            if made.exists():  # before it was locked, it looked as if nobody wrote it
                return made, lock
            os.close(lock)


def _lock(folder: Path, *, is_patient: bool = True) -> int:
    """Lock a folder until the file descriptor is closed, at the latest by the process's end."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if is_patient else fcntl.LOCK_NB))
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:  # a file system without locks
        pass
    return descriptor


def _remove_unfinished(home: Path, name: str) -> None:
    """Remove what processes that are gone have begun to write."""
    for entry in os.listdir(home):
        if entry.startswith(f".{name}{UNFINISHED}"):
            with suppress(OSError):
                lock = _lock(home / entry, is_patient=False)
                shutil.rmtree(home / entry, ignore_errors=True)
                os.close(lock)


def _move(made: Path, ready: Path, out: Path) -> None:
    """Move the entries of a folder; a new folder appears in one step."""
    made.chmod(0o755)
    _flush(made)
    if not out.exists():
        made.rename(out)
        _flush_entry(out.parent)
        return
    for entry in made.iterdir():
        target = out / entry.name
        if target.exists() and entry.is_dir() != target.is_dir():
            raise FileExistsError(f"{entry.name} is {'a folder' if target.is_dir() else 'a file'}")
    made.rename(ready)
    _flush_entry(out)
    _move_files(ready, out)


def _move_files(ready: Path, out: Path) -> None:
    for entry in sorted(ready.iterdir()):
        target = out / entry.name
        if entry.is_dir() and target.is_dir():
            shutil.rmtree(target)
        os.replace(entry, target)
    ready.rmdir()


def _remove_others(out: Path, names: Collection[str]) -> None:
    """Remove what was in a folder before, but for entries of these names."""
    for entry in out.iterdir():
        if entry.name not in names:
            if entry.is_dir():
                shutil.rmtree(entry)
            else:
                entry.unlink()


def _flush(folder: Path) -> None:
    """Have everything in a folder on the disk: the loss of power must not leave empty files."""
    for path, _, names in os.walk(folder):
        for name in names:
            _flush_entry(Path(path) / name)
        _flush_entry(Path(path))


def _flush_entry(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
