"""Backup of the map that a save replaces, in a folder beside it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Collection
from pathlib import Path

from tccm_ros.atomic import finish_moves, output_folder
from tccm_ros.errors import OutputError, one_line

PREVIOUS = ".previous"
"""Suffix of the backup folder."""


def keep_previous(folder: Path, names: Collection[str]) -> None:
    """Keep files of a folder in its backup folder.

    Raises
    ------
    OutputError
        If they cannot be kept.
    """
    try:
        if folder.exists():
            finish_moves(folder)
        kept = [folder / name for name in names if (folder / name).is_file()]
        if not kept:
            return
        with output_folder(folder.with_name(folder.name + PREVIOUS)) as made:
            for path in kept:
                _link(path, made / path.name)
    except OSError as error:
        raise OutputError(f"{folder}: the map there cannot be kept ({one_line(error)})") from None


def _link(path: Path, target: Path) -> None:
    """Hard-link a file, since it is replaced and never rewritten; else copy it."""
    try:
        os.link(path, target)
    except OSError:
        shutil.copyfile(path, target)
