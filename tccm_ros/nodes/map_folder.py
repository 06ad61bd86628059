"""The folder that ~/save_map of the SLAM node writes and ~/load_map reads.

The process that solves packs the files of each solution into an archive, a file without a name; the
node unpacks the newest one when a map is saved. So saving waits for no solution, and it works when
that process has died.
"""

from __future__ import annotations

import itertools
import json
import os
from contextlib import suppress
from pathlib import Path

from tccm_ros.atomic import finish_moves, output_folder
from tccm_ros.errors import MapError, OutputError, one_line
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
        self._beside: Path | None = None

    def forget(self) -> None:
        """Begin another session: what was saved so far is not its own."""
        self._own = self._beside = None

    def adopt(self, folder: Path) -> None:
        """Take the map of a folder for this session's own, which goes on with it."""
        self._own = _identity(folder / MAP_FILE)

    def save(
        self,
        archive: int,
        content: MapContent,
        folder: Path,
        *,
        is_asked: bool,
        is_last: bool = False,
    ) -> Path:
        """Unpack an archive into a folder; return that.

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
        is_last
            Whether the session ends: where the folder has a map of another one that holds more,
            this map goes into a new folder beside it.

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
        if is_last and self._beside is not None:
            folder = self._beside
        is_own = self._own is not None and _identity(folder / MAP_FILE) == self._own
        more = None if is_own or self._may_replace else _larger_map(folder, content)
        if more is not None:
            if not is_last:
                raise MapError(
                    f"{folder}: not written, the map there holds more ({more}) than this one "
                    f"({content}); move it away, or set save.directory to another folder"
                )
            folder = self._beside = _free_folder(folder)
        if is_asked or not is_own:
            keep_previous(folder, _sizes(archive))
        save_archive(archive, folder)
        self.adopt(folder)
        return folder


def _larger_map(folder: Path, content: MapContent) -> MapContent | None:
    """Return how much the map of a folder holds, if that is more; None otherwise."""
    with suppress(OSError):
        finish_moves(folder)
    try:
        there = read_content(folder / MAP_FILE)
    except MapError:  # none, or none that anybody can go on with
        return None
    return there if content.is_less_than(there) else None


def _free_folder(folder: Path) -> Path:
    """Return a folder beside another that does not exist yet: `map.2`, `map.3`, ..."""
    names = (folder.with_name(f"{folder.name}.{n}") for n in itertools.count(2))
    return next(name for name in names if not name.exists())


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
            try:
                with (made / name).open("wb") as file:
                    while at < end:
                        at += os.sendfile(file.fileno(), archive, at, end - at)
            except OSError as error:
                raise OutputError(
                    f"{folder / name}: cannot be written ({one_line(error)})"
                ) from None
