"""From a path to the storage files of a bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
import zstandard

from tccm_ros.bags import mcap_records, sqlite_file
from tccm_ros.bags.mcap_file import McapFile
from tccm_ros.bags.sqlite_file import SqliteFile
from tccm_ros.bags.storage import ZSTD_MAGIC, StorageDamage, reading
from tccm_ros.errors import BagError

__all__ = ["StorageFile", "open_storage", "storage_paths", "unpack_file"]

SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
ROS1_MAGIC = b"#ROSBAG V"
MAX_EXPANSION = 1000
"""A compressed file that grows more than this (and beyond `SMALL`) is a bomb, not a recording."""

SMALL = 2**26

StorageFile = McapFile | SqliteFile


def storage_paths(path: Path) -> list[Path]:
    """Return the storage files of a rosbag2 folder, or the file itself.

    The folder's metadata.yaml says which files there are; without it, all are taken.

    Raises
    ------
    BagError
        Where nothing is there, a split is missing, or metadata.yaml cannot be read.
    """
    with reading(path):
        if not path.exists():
            raise BagError(f"{path}: no such bag")
        if not path.is_dir():
            return [path]
        files = _listed(path / "metadata.yaml")
        if not files:
            files = sorted(p for p in path.iterdir() if p.name.endswith(SUFFIXES))
    if not files:
        raise BagError(f"{path}: no bag in this folder; expected a file ending in .mcap or .db3")
    return files


def _listed(metadata: Path) -> list[Path]:
    """Return the files that metadata.yaml names; none where it is not there."""
    if not metadata.exists():
        return []
    advice = "; without this file the bag is read from its storage files alone"
    with reading(metadata, advice):
        try:
            tree: Any = yaml.safe_load(metadata.read_text(encoding="utf-8"))
            names = tree["rosbag2_bagfile_information"]["relative_file_paths"]
            files = [metadata.parent / Path(str(name)).name for name in names]
        except (yaml.YAMLError, KeyError, TypeError, RecursionError):
            raise StorageDamage("not the metadata of a rosbag2 folder") from None
        for file in files:
            if not file.exists():
                raise StorageDamage(f"names {file.name}, which is not there")
    return files


def open_storage(path: Path) -> StorageFile:
    """Open a storage file by its first bytes.

    Raises
    ------
    BagError
        Where it is neither mcap nor sqlite3, or damaged.
    """
    with reading(path):
        with path.open("rb") as stream:
            head = stream.read(16)
        if not head:
            raise StorageDamage("the file is empty")
        if head.startswith(ROS1_MAGIC):
            raise StorageDamage("a ROS 1 bag; convert it: rosbags-convert --src BAG --dst FOLDER")
        if head == sqlite_file.MAGIC:
            return SqliteFile(path)
        if not head.startswith(mcap_records.MAGIC):
            raise StorageDamage(
                "neither mcap nor sqlite3; expected a rosbag2 folder, a .mcap or a .db3"
            )
        return McapFile(path)


def is_compressed(path: Path) -> bool:
    """Return whether a storage file is compressed as a whole."""
    with reading(path), path.open("rb") as stream:
        return stream.read(4) == ZSTD_MAGIC


def unpack_file(path: Path, folder: Path) -> Path:
    """Unpack a compressed storage file into a folder and return where it is.

    Raises
    ------
    BagError
        Where it is damaged, or grows beyond what a recording can.
    """
    target = folder / path.name.removesuffix(".zstd")
    limit = SMALL + MAX_EXPANSION * path.stat().st_size
    with reading(path), path.open("rb") as packed, target.open("wb") as unpacked:
        stream = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        while piece := stream.read(2**20):
            unpacked.write(piece)
            limit -= len(piece)
            if limit < 0:
                raise StorageDamage("grows more than a recording can when it is unpacked")
    return target
