"""Atomic output: files and folders change as a whole or not at all, even if a process is killed.

A file is written under a temporary name in the same folder, flushed to the disk and renamed. The
new files of a folder are written into a temporary folder and flushed to the disk. If the folder
does not exist, the temporary one is renamed to it. If it exists, the temporary one is renamed to
``.tccm-ready-*`` inside it; from then on the new files are saved. They replace those of the same
name one after the other. If this is interrupted, `finish_moves` completes it, before anything is
read from the folder or written into it. An incomplete temporary folder of a process that was killed
is removed when the folder is written again.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from tccm_ros.errors import OutputError, one_line

READY = ".tccm-ready-"
"""Prefix of a subfolder whose files will be moved into its parent."""

UNFINISHED = ".tccm-new-"
"""Part of the hidden name of a folder that is being written, before random letters."""


@contextmanager
def output_file(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside `path`, which replaces `path` at the end.

    After an error `path` is unchanged and the temporary file is removed.

    Parameters
    ----------
    path
        Output file; neither it nor its folder needs to exist.

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
        _flush_entry(beside)  # otherwise a crash after the rename could leave an empty file
        os.replace(beside, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)})") from None
    finally:
        with suppress(OSError):
            beside.unlink()


def write_output(path: Path | str, content: bytes | str) -> None:
    """Write a whole file, text as UTF-8; errors as of `output_file`."""
    with output_file(path) as made:
        made.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def output_folder(out: Path | str, *, is_replaced: bool = False) -> Iterator[Path]:
    """Yield a temporary folder beside `out`, and move its files to `out` at the end.

    Files of the same name in `out` are replaced, and other files there are kept. After an error
    nothing is moved and the temporary folder is removed.

    Parameters
    ----------
    out
        Output folder; neither it nor its parent needs to exist.
    is_replaced
        Whether to remove other files in `out`.

    Raises
    ------
    OutputError
        If `out` is a file or cannot be written; this is checked before the block.
    """
    out = Path(os.path.abspath(out))
    try:
        home = _home(out)
        finish_moves(out)
        remove_unfinished(home, out.name)
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
    """Complete moves into a folder that a killed process did not finish.

    Raises
    ------
    OSError
        If they cannot be moved.
    """
    with suppress(FileNotFoundError, NotADirectoryError):
        for name in sorted(name for name in os.listdir(out) if name.startswith(READY)):
            # Another process may be moving them: wait for it, then move the rest.
            with suppress(FileNotFoundError):
                lock = _lock(out / name)
                try:
                    _move_files(out / name, out)
                finally:
                    os.close(lock)


def folders_in_progress(out: Path | str) -> Iterator[Path]:
    """Yield the temporary folders in which running processes write `out`."""
    out = Path(os.path.abspath(out))
    for home in (out.parent, out):
        for made in home.glob(f".{escape(out.name)}{UNFINISHED}*"):
            if is_locked(made):
                yield made


def is_locked(folder: Path) -> bool:
    """Return whether a process, this one included, has a lock of a folder."""
    try:
        os.close(_lock(folder, is_patient=False))
    except (BlockingIOError, FileNotFoundError) as error:
        return isinstance(error, BlockingIOError)
    return False


@contextmanager
def shared_lock(folder: Path) -> Iterator[None]:
    """Hold a lock of a folder that several processes may have at once.

    Raises
    ------
    OSError
        If the folder is missing.
    """
    lock = _lock(folder, is_shared=True)
    try:
        yield
    finally:
        os.close(lock)


def remove_unfinished(home: Path, name: str = "") -> None:
    """Remove incomplete folders of processes that have ended.

    Parameters
    ----------
    home
        Folder that contains them.
    name
        Name of the folder that was being written; empty for any.
    """
    for entry in os.listdir(home):
        written, mark, _ = entry.rpartition(UNFINISHED)
        if mark and written.startswith(".") and name in ("", written[1:]):
            with suppress(OSError):
                lock = _lock(home / entry, is_patient=False)
                shutil.rmtree(home / entry, ignore_errors=True)
                os.close(lock)


def _home(out: Path) -> Path:
    """Return the parent of the temporary folder: beside `out` or, if that is impossible, in it."""
    if out.exists() and not out.is_dir():
        raise NotADirectoryError(f"{out.name} is a file; give a folder")
    out.parent.mkdir(parents=True, exist_ok=True)
    if not out.exists():
        return out.parent
    if not os.access(out, os.W_OK | os.X_OK):
        raise PermissionError("no permission to write")
    is_same_device = out.stat().st_dev == out.parent.stat().st_dev
    return out.parent if is_same_device and os.access(out.parent, os.W_OK | os.X_OK) else out


def _make(home: Path, name: str) -> tuple[Path, int]:
    """Return a new folder and its lock, which marks it as in use for other processes."""
    while True:
        made = Path(tempfile.mkdtemp(prefix=f".{name}{UNFINISHED}", dir=home))
        with suppress(FileNotFoundError):
            lock = _lock(made)
            if made.exists():  # another process may have removed it before it was locked
                return made, lock
            os.close(lock)


def _lock(folder: Path, *, is_patient: bool = True, is_shared: bool = False) -> int:
    """Lock a folder until the returned file descriptor is closed, or the process ends."""
    descriptor = os.open(folder, os.O_RDONLY)
    kind = fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX
    try:
        fcntl.flock(descriptor, kind | (0 if is_patient else fcntl.LOCK_NB))
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:  # a file system without locks
        pass
    return descriptor


def _move(made: Path, ready: Path, out: Path) -> None:
    """Move the entries of a folder; a new folder appears atomically."""
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
    """Remove the entries of a folder except the given names."""
    for entry in out.iterdir():
        if entry.name not in names:
            if entry.is_dir():
                shutil.rmtree(entry)
            else:
                entry.unlink()


def _flush(folder: Path) -> None:
    """Flush everything in a folder to disk, so that a power loss leaves no empty files."""
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
