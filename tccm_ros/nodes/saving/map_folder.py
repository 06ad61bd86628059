"""The folder that slam_node's ~/save_map writes and ~/load_map reads.

The solver process packs the files of each solution into an archive, an unnamed file. The node
unpacks the newest archive when a map is saved. So a save waits for no solution, and it works after
that process has died.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from tccm_ros.atomic import finish_moves, output_folder
from tccm_ros.errors import MapError, OutputError, one_line
from tccm_ros.results.labels_file import MAP_FILE
from tccm_ros.results.map_file import MapContent, read_content

PREVIOUS = ".previous"
"""Suffix of the folder that keeps a replaced map."""


class MapKeeper:
    """Saves the maps of one session and protects the maps of other sessions.

    A map of another session is not replaced by a map with less content. A replaced map is kept
    (`keep_previous`).

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
        """Begin another session: the maps saved so far belong to the previous one."""
        self._own = self._beside = None

    def adopt(self, folder: Path) -> None:
        """Treat the map of a folder as this session's own, because the session continues it."""
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
        """Unpack an archive into a folder and return the folder.

        Parameters
        ----------
        archive
            File descriptor of an archive.
        content
            Content of its map.
        folder
            Output folder; files of the same names are replaced.
        is_asked
            Whether a user requested this save. If so, any replaced map is kept; otherwise only that
            of another session.
        is_last
            Whether the session ends. If so, and if the folder has another session's map with more
            content, the map goes into a new folder beside it.

        Raises
        ------
        MapError
            If nothing is mapped yet, or the folder has another session's map with more content.
        OutputError
            If the folder cannot be written; its previous content is kept.
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
    """Return the content of a folder's map if it exceeds `content`, else None."""
    with suppress(OSError):
        finish_moves(folder)
    try:
        there = read_content(folder / MAP_FILE)
    except MapError:  # no map, or one that cannot be loaded
        return None
    return there if content.is_less_than(there) else None


def _free_folder(folder: Path) -> Path:
    """Return a sibling folder that does not exist yet: `map.2`, `map.3`, ..."""
    names = (folder.with_name(f"{folder.name}.{n}") for n in itertools.count(2))
    return next(name for name in names if not name.exists())


def _identity(path: Path) -> tuple[int, int, int] | None:
    """Return a key that changes when a file is replaced; None if there is no file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_mtime_ns


def _sizes(archive: int) -> dict[str, int]:
    """Return the sizes of the files in an archive, bytes, by name."""
    with os.fdopen(os.dup(archive), "rb") as stream:
        stream.seek(0)
        sizes: dict[str, int] = json.loads(stream.readline())
        return sizes


def keep_previous(folder: Path, names: Collection[str]) -> None:
    """Keep files of a folder in a folder beside it (`PREVIOUS`).

    A file is hard-linked, as it is replaced and never rewritten; if that fails, it is copied.

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
                try:
                    os.link(path, made / path.name)
                except OSError:
                    shutil.copyfile(path, made / path.name)
    except OSError as error:
        raise OutputError(f"{folder}: the map there cannot be kept ({one_line(error)})") from None


def save_archive(archive: int, folder: Path) -> None:
    """Unpack an archive into a folder; a kill at any moment leaves the old or the new map.

    Parameters
    ----------
    archive
        File descriptor; its current offset does not matter.
    folder
        Output folder; files of the same names are replaced.

    Raises
    ------
    OutputError
        If the folder cannot be written; its previous content is kept.
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
