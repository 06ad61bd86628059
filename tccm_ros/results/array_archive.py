"""Write and read .npz files of named arrays: byte-identical for the same arrays, without pickle.

A file may be damaged or malicious, so the declared size of its arrays is compared with the stored
size before memory is allocated. ``numpy.load`` allocates first.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.errors import one_line

ZIP_LEVEL = 1
"""Deflate level; half of a map is noise, and level 6 takes twice as long for 7 % less."""

ZIP_TIME = (1980, 1, 1, 0, 0, 0)
"""Time of each entry; the clock's time would make two runs differ."""

MAX_ARCHIVE_BYTES = 2**31
"""Maximum size of all arrays together. Chosen: the map of a day takes a twentieth of it."""


def array_archive(arrays: Mapping[str, NDArray[Any] | np.generic]) -> bytes:
    """Return arrays as a compressed .npz file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", ZIP_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, entry.getvalue(), compresslevel=ZIP_LEVEL)
    return buffer.getvalue()


def read_arrays(file: Path | io.BytesIO) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file by name.

    Raises
    ------
    ValueError
        If the file is damaged, has arrays of objects, or declares more than `MAX_ARCHIVE_BYTES` or
        than it stores.
    OSError
        If it cannot be read.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
            declared = sum(entry.file_size for entry in entries)
            if declared > MAX_ARCHIVE_BYTES:
                raise ValueError(f"its arrays declare {declared / 2**30:.1f} GiB")
            return {e.filename.removesuffix(".npy"): _array(archive.read(e)) for e in entries}
    except (ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(one_line(error)) from None


def _array(content: bytes) -> NDArray[Any]:
    """Return the array of an .npy file after comparing its header with the size of its data."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise ValueError(f"an array of the .npy version {version}")
    shape, is_fortran, dtype = read_header(stream)
    if dtype.hasobject:
        raise ValueError("an array of objects")
    count, rest = int(np.prod(shape, dtype=object)), content[stream.tell() :]
    if min(shape, default=0) < 0 or count * dtype.itemsize != len(rest):
        raise ValueError(f"an array of shape {shape} in {len(rest)} bytes")
    array = np.frombuffer(rest, dtype).copy()
    return array.reshape(shape, order="F" if is_fortran else "C")
