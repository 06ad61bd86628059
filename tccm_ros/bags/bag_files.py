"""Find the storage files of a bag."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from tccm_ros.bags.storage import ZSTD_MAGIC, expand, reading
from tccm_ros.errors import BagError

SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
MAX_EXPANSION, SMALL = 1000, 2**26
"""A compressed file that expands by a larger factor, and to more than `SMALL` bytes, is refused.
Chosen."""


def storage_paths(path: Path, *, listed: bool = True) -> list[Path]:
    """Return the storage files of a rosbag2 folder, or the file itself.

    Parameters
    ----------
    path
        A folder or a file.
    listed
        Whether to take only the files listed in the folder's metadata.yaml, if it exists.

    Raises
    ------
    BagError
        If there is no bag, a split is missing, or metadata.yaml cannot be read.
    """
    with reading(path):
        if not path.exists():
            raise BagError(f"{path}: no such bag")
        if not path.is_dir():
            return [path]
        files = _listed(path / "metadata.yaml") if listed else []
        if not files:
            files = sorted(p for p in path.iterdir() if p.name.endswith(SUFFIXES))
    if not files:
        raise BagError(f"{path}: no bag in this folder; expected a file ending in .mcap or .db3")
    return files


def _listed(metadata: Path) -> list[Path]:
    """Return the files listed in metadata.yaml; none if it does not exist."""
    if not metadata.exists():
        return []
    advice = "; without this file the bag is read from its storage files alone"
    with reading(metadata, advice):
        try:
            tree: Any = yaml.safe_load(metadata.read_text(encoding="utf-8"))
            names = tree["rosbag2_bagfile_information"]["relative_file_paths"]
            files = [metadata.parent / Path(str(name)).name for name in names]
        except (yaml.YAMLError, KeyError, TypeError, RecursionError):
            raise ValueError("not the metadata of a rosbag2 folder") from None
        for file in files:
            if not file.exists():
                raise ValueError(f"names {file.name}, which is not there")
    return files


@contextmanager
def unpacked(path: Path, *, partly: bool = False) -> Iterator[Path]:
    """Yield a storage file, decompressed into a temporary folder if it is compressed as a whole.

    Parameters
    ----------
    path
        The file.
    partly
        Whether to decompress a damaged file up to the damage.

    Raises
    ------
    BagError
        If it is damaged, or expands beyond `MAX_EXPANSION` and `SMALL`.
    """
    with reading(path), path.open("rb") as stream:
        is_compressed = stream.read(4) == ZSTD_MAGIC
    if not is_compressed:
        yield path
        return
    with TemporaryDirectory() as folder:
        target = Path(folder) / path.name.removesuffix(".zstd")
        limit = SMALL + MAX_EXPANSION * path.stat().st_size
        try:
            with reading(path), path.open("rb") as packed, target.open("wb") as whole:
                whole.writelines(expand(packed, limit))
        except BagError:
            if not partly:
                raise
        yield target
