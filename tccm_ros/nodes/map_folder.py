"""The folder that ~/save_map of the SLAM node writes and ~/load_map reads.

The process that solves packs the files of each solution into an archive, a file without a name; the
node unpacks the newest one when a map is saved. So saving waits for no solution, and it works when
that process has died.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tccm_ros.atomic import finish_moves, output_folder
from tccm_ros.errors import MapError, OutputError, one_line
from tccm_ros.results.exports import solution_files
from tccm_ros.results.grid_files import grid_files
from tccm_ros.results.keepout_mask import keepout_mask
from tccm_ros.results.map_file import MapContent, load_map, map_content, read_content
from tccm_ros.slam.occupancy import occupancy_grid
from tccm_ros.surfaces.saved_map import SavedMap
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution

MAP_FILE = "map.mcap"
"""What a later session goes on with, beside the files that a replay writes."""

GRID_NAME = "map"
"""Of map.pgm and map.yaml, for nav2_map_server."""

MASK_NAME = "keepout"
"""Of keepout.pgm and keepout.yaml, for the costmap filters of Nav2."""

PREVIOUS = ".previous"
"""Suffix of the folder that keeps the map which was replaced."""


def map_files(
    processor: SurfaceSlam, solution: SurfaceSolution, map_frame: str, saved: SavedMap
) -> dict[str, bytes]:
    """Return the files of a map by their names.

    Parameters
    ----------
    processor, solution
        The processor, and its newest solution.
    map_frame
        Name of the map frame.
    saved
        `SurfaceSlam.saved` of the solution.
    """
    files = solution_files(solution, processor.config)
    grid = occupancy_grid(saved.walls)
    if grid is not None:
        files |= grid_files(GRID_NAME, grid)
        mask = keepout_mask(grid, solution.surfaces, solution.floor_z)
        files |= grid_files(MASK_NAME, mask)
    return files | {MAP_FILE: map_content(saved, solution, map_frame)}


def write_map(
    folder: Path, processor: SurfaceSlam, solution: SurfaceSolution, map_frame: str
) -> None:
    """Write a solution of a processor; after a kill at any moment the map is the old or the new.

    Parameters
    ----------
    folder
        Replaced as a whole.
    processor
        Gives keyframes, walls and what else a later session needs.
    solution
        Newest solution of that processor.
    map_frame
        Name of the map frame in the saved map.

    Raises
    ------
    OutputError
        If the folder cannot be written; what was there is still there.
    """
    with output_folder(folder) as made:
        saved = processor.saved(solution)
        for name, content in map_files(processor, solution, map_frame, saved).items():
            (made / name).write_bytes(content)


def read_map(folder: Path) -> SavedMap:
    """Read the map of a folder.

    Raises
    ------
    MapError
        If there is none, or it is damaged.
    """
    return load_map(folder / MAP_FILE)


def pack_files(files: Mapping[str, bytes], stream: Any) -> None:
    """Write an archive: one line with names and sizes, then the contents end to end."""
    sizes = {name: len(content) for name, content in files.items()}
    stream.write(json.dumps(sizes).encode() + b"\n")
    for content in files.values():
        stream.write(content)
    stream.flush()


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


def keep_previous(folder: Path, names: Collection[str]) -> None:
    """Keep the files of these names in the folder beside it that is called `.previous`.

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
    """Give a file a second name, since it is replaced and never written again; else copy it."""
    try:
        os.link(path, target)
    except OSError:
        shutil.copyfile(path, target)
