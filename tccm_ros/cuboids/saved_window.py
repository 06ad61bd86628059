"""Saving and loading an integration map with its window, so that a restarted node goes on.

The file is an npz without pickles: the originals of all part maps of the window, from which the map
is rebuilt. It is versioned, carries a checksum, and is written aside and moved into place.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.part_map import PartMap
from tccm_ros.errors import MapError, OutputError, one_line

__all__ = ["FORMAT", "VERSION", "load_map", "save_map"]

FORMAT = "tccm_ros/integration_map"
VERSION = 1

_LAYOUT: Mapping[str, tuple[type[Any], tuple[int, ...]]] = {
    "keys": (np.int64, ()),
    "bounds": (np.int32, (2,)),
    "moments": (np.int64, (10,)),
    "seen_ns": (np.int64, (2,)),
    "void_keys": (np.int64, ()),
    "void_bounds": (np.int32, (2,)),
}
"""Type and row shape of each array; rows of all part maps follow each other."""


def save_map(map_: IntegrationMap, path: Path | str, frame_id: str) -> None:
    """Write an integration map.

    Parameters
    ----------
    map_
        The map; the points of its part maps are not written.
    path
        An .npz file; an older one is replaced in one step.
    frame_id
        Frame of the map.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    path = Path(path)
    arrays = {
        name: np.concatenate(
            [np.zeros((0, *shape), dtype), *(getattr(part, name) for part in map_.parts)]
        )
        for name, (dtype, shape) in _LAYOUT.items()
    }
    about = {
        "format": FORMAT,
        "version": VERSION,
        "frame_id": frame_id,
        "cell_size": map_.cell_size,
        "parts": [
            [part.cycle, part.start_ns, part.end_ns, len(part.keys), len(part.void_keys)]
            for part in map_.parts
        ],
    }
    text = np.frombuffer(json.dumps(about, sort_keys=True).encode(), np.uint8)
    arrays = {"about": text, **arrays}
    buffer = io.BytesIO()
    np.savez(buffer, checksum=_checksum(arrays), **arrays)  # type: ignore[arg-type]
    _write(path, buffer.getvalue())


def load_map(path: Path | str, config: Config) -> tuple[IntegrationMap, str]:
    """Read an integration map.

    Parameters
    ----------
    path
        A file of `save_map`.
    config
        `map.cell_size` must be the file's; `map.window_cycles` may differ.

    Returns
    -------
    IntegrationMap
        Rebuilt from its part maps, bit for bit as it was saved.
    str
        Its frame.

    Raises
    ------
    MapError
        If the file is missing, damaged, of another version or of another cell size.
    """
    path = Path(path)
    arrays = _read(path)
    about = json.loads(arrays["about"].tobytes())
    if about.get("format") != FORMAT or about.get("version") != VERSION:
        raise MapError(
            f"{path}: {FORMAT} version {VERSION} is expected, found "
            f"{about.get('format')} version {about.get('version')}"
        )
    if about["cell_size"] != config.map.cell_size:
        raise MapError(
            f"{path}: cells of {about['cell_size']} m, but map.cell_size is "
            f"{config.map.cell_size}; set it to the map's"
        )
    map_ = IntegrationMap(config)
    newest = about["parts"][-1][0] if about["parts"] else 0
    parts = _parts(about, arrays)
    map_.replace(p for p in parts if p.cycle > newest - config.map.window_cycles)
    return map_, str(about["frame_id"])


def _parts(about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> list[PartMap]:
    parts, row, void = [], 0, 0
    for cycle, start_ns, end_ns, cuboids, voids in about["parts"]:
        own, seen_through = slice(row, row + cuboids), slice(void, void + voids)
        parts.append(
            PartMap(
                cycle,
                start_ns,
                end_ns,
                about["cell_size"],
                keys=arrays["keys"][own],
                bounds=arrays["bounds"][own],
                moments=arrays["moments"][own],
                seen_ns=arrays["seen_ns"][own],
                void_keys=arrays["void_keys"][seen_through],
                void_bounds=arrays["void_bounds"][seen_through],
            )
        )
        row, void = row + cuboids, void + voids
    return parts


def _read(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise MapError(f"{path}: there is no such map") from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise MapError(f"{path}: not a saved map ({one_line(error)})") from None
    if set(arrays) != {"checksum", "about", *_LAYOUT}:
        raise MapError(f"{path}: not a saved map (its arrays are {', '.join(sorted(arrays))})")
    checksum = arrays.pop("checksum")
    if not np.array_equal(checksum, _checksum(arrays)):
        raise MapError(f"{path}: the map is damaged: its checksum differs; save it again")
    return arrays


def _checksum(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the SHA-256 of names, types, shapes and bytes, uint8 (32,)."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return np.frombuffer(digest.digest(), np.uint8)


def _write(path: Path, data: bytes) -> None:
    try:
        with NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            aside = Path(file.name)
            try:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
                os.replace(aside, path)
            except BaseException:
                aside.unlink(missing_ok=True)
                raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from None
