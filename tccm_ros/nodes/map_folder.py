"""The folder that ~/save_map of the SLAM node writes and ~/load_map reads.

The process that solves packs the files of each solution into an archive, a file without a name; the
node unpacks the newest one when a map is saved. So saving waits for no solution, and it works when
that process has died.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path

from tccm_ros.atomic import finish_moves, output_folder
from tccm_ros.errors import MapError
from tccm_ros.nodes.previous_map import keep_previous
from tccm_ros.results.map_file import MapContent, read_content

MAP_FILE = "map.mcap"
"""What a later session goes on with, beside the files that a replay writes."""


class MapKeeper:
    """Saves the maps of one session, and keeps the maps of others from being lost.

    A map of another session is not replaced by one that holds less; one that is replaced stays in
    the folder beside it (`PREVIOUS`).

    Parameters
    ----------
    may_replace
        Whether any map may be replaced.
    """

    def __init__(self, *, may_replace: bool = False) -> None:
        self._may_replace = may_replace
        self._own: tuple[int, int, int] | None = None

    def forget(self) -> None:
        """Begin another session: what was saved so far is not its own."""
        self._own = None

    def adopt(self, folder: Path) -> None:
        """Take the map of a folder for this session's own, which goes on with it."""
        self._own = _identity(folder / MAP_FILE)

    def save(self, archive: int, content: MapContent, folder: Path, *, is_asked: bool) -> None:
        """Unpack an archive into a folder.

        Parameters
        ----------
        archive
            Descriptor of an archive.
        content
            How much its map holds.
        folder
            Files of the same names are replaced.
        is_asked
            Whether this save was asked for: then the map that it replaces is kept in any case, else
            only that of another session.

        Raises
        ------
        MapError
            Where nothing is mapped yet, or the folder has a map of another session that holds more.
        OutputError
            If the folder cannot be written; what was there is still there.
        """
        if content.is_empty:
            raise MapError(
                f"{folder}: not written, nothing has been mapped yet: are there level scans, "
                "odometry and surface messages?"
            )
        is_own = self._own is not None and _identity(folder / MAP_FILE) == self._own
        if not is_own and not self._may_replace:
            _check_replaceable(folder, content)
        if is_asked or not is_own:
            keep_previous(folder, _sizes(archive))
        save_archive(archive, folder)
        self.adopt(folder)


def _check_replaceable(folder: Path, content: MapContent) -> None:
    """Raise MapError where the folder has a map that holds more."""
    with suppress(OSError):
        finish_moves(folder)
    try:
        there = read_content(folder / MAP_FILE)
    except MapError:  # none, or none that anybody can go on with
        return
    if content.is_less_than(there):
        raise MapError(
            f"{folder}: not written, the map there holds more ({there}) than this one ({content}); "
            "move it away, or set save.directory to another folder"
        )


def _identity(path: Path) -> tuple[int, int, int] | None:
    """Return what tells whether a file was replaced; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_mtime_ns


def _sizes(archive: int) -> dict[str, int]:
    """Return the sizes of the files of an archive, by name."""
    with os.fdopen(os.dup(archive), "rb") as stream:
        stream.seek(0)
        sizes: dict[str, int] = json.loads(stream.readline())
        return sizes


def save_archive(archive: int, folder: Path) -> None:
    """Unpack an archive into a folder; after a kill at any moment the map is the old or the new.

    Parameters
    ----------
    archive
        Descriptor of the file; where it is read from now does not matter.
    folder
        Files of the same names are replaced.

    Raises
    ------
    OutputError
        If the folder cannot be written; what was there is still there.
    """
    sizes = _sizes(archive)
    at = os.fstat(archive).st_size - sum(sizes.values())
    with output_folder(folder) as made:
        for name, size in sizes.items():
            end = at + size
            with (made / name).open("wb") as file:
                while at < end:
                    at += os.sendfile(file.fileno(), archive, at, end - at)
