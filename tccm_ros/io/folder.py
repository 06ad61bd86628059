"""Folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tccm_ros.errors import OutputError, one_line

__all__ = ["output_folder"]


@contextmanager
def output_folder(out: Path | str) -> Iterator[Path]:
    """Give a temporary folder beside `out`, and move what is in it to `out` at the end.

    Files of the same name in `out` are replaced, other files there stay. After an error nothing
    is moved and the temporary folder is removed.

    Parameters
    ----------
    out
        The folder; it need not exist, its parent is made.

    Raises
    ------
    OutputError
        If `out` is a file or cannot be written; found before any work is done.
    """
    out = Path(os.path.abspath(out))
    try:
        made = _make_beside(out)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written ({one_line(error)})") from None
    try:
        yield made
        try:
            _move(made, out)
        except OSError as error:
            raise OutputError(f"{out}: cannot be written ({one_line(error)})") from None
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _make_beside(out: Path) -> Path:
    if out.exists() and not out.is_dir():
        raise NotADirectoryError(f"{out.name} is a file; give a folder")
    out.parent.mkdir(parents=True, exist_ok=True)
    if out.exists() and not os.access(out, os.W_OK | os.X_OK):
        raise PermissionError("no permission to write")
    return Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))


def _move(made: Path, out: Path) -> None:
    """Move the entries of a folder; a new folder appears in one step."""
    made.chmod(0o755)
    if not out.exists():
        made.rename(out)
        return
    for entry in sorted(made.iterdir()):
        target = out / entry.name
        if entry.is_dir() and target.is_dir():
            shutil.rmtree(target)
        os.replace(entry, target)
