"""A map in one file: an mcap that holds what a session needs to go on, and opens in Foxglove.

The state is an attachment of named arrays with a checksum of its own: the map and, where it is
known, the interrupted run. Topics beside it show the surfaces, points and walls. Files are written
beside their place and moved there.
"""

from __future__ import annotations

import hashlib
import io
import os
import struct
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from tccm_ros.atomic import finish_moves
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.errors import MapError, OutputError, one_line
from tccm_ros.results.map_arrays import map_of_arrays, map_to_arrays
from tccm_ros.results.packed import pack_arrays, unpack_arrays
from tccm_ros.results.ply import surface_color
from tccm_ros.ros.markers import Place, surface_markers, wall_markers
from tccm_ros.ros.results import surface_map_message
from tccm_ros.surfaces.saved_map import SavedMap
from tccm_ros.surfaces.surface_slam import SurfaceSolution

__all__ = ["FORMAT", "VERSION", "is_map", "load_map", "save_map"]

FORMAT = "tccm_ros/map"
VERSION = 2
ATTACHMENT = "state"
"""Arrays of the map and of the run in the middle of which it was saved; without a run it is a map
all the same."""

CHECKSUMS = {ATTACHMENT: "sha256"}
"""Where the metadata has the checksum of an attachment."""

CHECKSUMS_1 = {"map.npz": "sha256", "run.npz": "run_sha256"}
"""The same of version 1: archives of NumPy."""

MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<QQI")
"""Start of the summary, start of its offsets, checksum of the summary."""

DATA_END = 13
"""Bytes of the record before the summary: opcode, length, checksum of all before it."""


def save_map(
    path: Path | str, saved: SavedMap, solution: SurfaceSolution, frame_id: str = "map"
) -> None:
    """Write a map; an older file of that name is replaced in one step.

    The same map gives the same bytes.

    Parameters
    ----------
    path
        An .mcap file.
    saved
        `SurfaceSlam.saved` of the same solution.
    solution
        What is shown.
    frame_id
        Name of the map frame.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    path = Path(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as stream:
            _write(stream, saved, solution, frame_id)
            stream.flush()
            os.fsync(stream.fileno())  # a rename that outlives its content would be an empty map
        os.replace(beside, path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise OutputError(f"{path}: cannot be written ({one_line(error)})") from None


def _write(stream: Any, saved: SavedMap, solution: SurfaceSolution, frame_id: str) -> None:
    state = pack_arrays(map_to_arrays(saved))
    writer = Writer(
        stream, compression=CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True
    )
    writer.start(profile="ros2", library="tccm_ros")
    stamp = max((s.view.stamp_ns for s in saved.views), default=0)
    _write_topics(writer, solution, stamp, frame_id)
    writer.add_attachment(stamp, stamp, ATTACHMENT, "application/zstd", state)
    about = {"format": FORMAT, "version": str(VERSION)}
    about[CHECKSUMS[ATTACHMENT]] = hashlib.sha256(state).hexdigest()
    writer.add_metadata(FORMAT, about)
    writer.finish()


def _write_topics(writer: Writer, solution: SurfaceSolution, stamp: int, frame_id: str) -> None:
    """Show surfaces, their points and walls, latched for whoever plays the file."""
    types = TypestoreMessages()
    place = Place(types, stamp, frame_id)
    ids = solution.mapped.surface_id
    known, index = np.unique(ids, return_inverse=True)
    colors = np.array([surface_color(int(i)) for i in known], np.uint8).reshape(-1, 3)[index]
    markers = "visualization_msgs/msg/MarkerArray"
    shown = [
        (
            "/surface_slam/surfaces",
            markers,
            types.make(markers, markers=surface_markers(place, solution.surfaces)),
        ),
        (
            "/surface_slam/surface_cloud",
            "sensor_msgs/msg/PointCloud2",
            surface_map_message(types, stamp, frame_id, solution.mapped.points, ids, colors),
        ),
        (
            "/surface_slam/walls",
            markers,
            types.make(markers, markers=wall_markers(place, solution.slam.walls)),
        ),
    ]
    schemas: dict[str, int] = {}
    for topic, msgtype, message in shown:
        if msgtype not in schemas:
            definition = types.definition(msgtype).encode()
            schemas[msgtype] = writer.register_schema(msgtype, "ros2msg", definition)
        channel = writer.register_channel(topic, "cdr", schemas[msgtype])
        writer.add_message(channel, stamp, bytes(types.serialize(msgtype, message)), stamp)


def is_map(path: Path | str) -> bool:
    """Return whether a file says of itself that it is a map, be it whole or not."""
    with suppress(OSError, McapError, ValueError, EOFError, struct.error), open(path, "rb") as file:
        summary = make_reader(file).get_summary()
        return summary is not None and any(m.name == FORMAT for m in summary.metadata_indexes)
    return False


def load_map(path: Path | str) -> SavedMap:
    """Read a map.

    Raises
    ------
    MapError
        If the file is missing, damaged, no map or of a newer version.
    """
    path = Path(path)
    try:
        with suppress(OSError):  # a folder that cannot be written is read as it is
            finish_moves(path.parent)
        content = path.read_bytes()
        _check_sums(content)
        about, attached = _read(io.BytesIO(content))
    except FileNotFoundError:
        raise MapError(f"{path}: no such map; 'tccm replay' writes one as map.mcap") from None
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({one_line(error)})") from None
    except (McapError, ValueError, EOFError, struct.error, zlib.error, StopIteration) as error:
        raise MapError(f"{path}: damaged or not a map ({one_line(error)})") from None
    version = _check(path, about, attached)
    try:
        if version == 1:
            return map_of_arrays(_arrays_1(attached))
        return map_of_arrays(unpack_arrays(attached[ATTACHMENT]))
    except (
        OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error
    ) as error:  # fmt: skip
        raise MapError(f"{path}: damaged ({one_line(error)})") from None
    except MapError as error:
        raise MapError(f"{path}: {error}") from None


def _check_sums(content: bytes) -> None:
    """Check the checksums over the whole data and summary sections of an mcap file.

    Raises
    ------
    ValueError, struct.error
        Where they do not fit, or where the file is cut off.
    """
    end = len(content) - len(MAGIC)
    start, _, summary_sum = FOOTER.unpack(content[end - FOOTER.size : end])
    data_end = start - DATA_END
    (data_sum,) = struct.unpack("<I", content[start - 4 : start])
    if not (content.startswith(MAGIC) and content.endswith(MAGIC) and 0 < data_end < end):
        raise ValueError("not a complete mcap")
    if (zlib.crc32(content[:data_end]), zlib.crc32(content[start : end - 4])) != (
        data_sum,
        summary_sum,
    ):
        raise ValueError("its checksum does not fit")


def _read(stream: Any) -> tuple[Mapping[str, str], dict[str, bytes]]:
    """Return the file's metadata and its attachments, as far as they are there."""
    reader = make_reader(stream, validate_crcs=True)
    about = next((m.metadata for m in reader.iter_metadata() if m.name == FORMAT), {})
    known = {*CHECKSUMS, *CHECKSUMS_1}
    return about, {a.name: a.data for a in reader.iter_attachments() if a.name in known}


def _check(path: Path, about: Mapping[str, str], attached: Mapping[str, bytes]) -> int:
    """Return the version of a map that is whole."""
    if about.get("format") != FORMAT:
        raise MapError(f"{path}: an mcap, but not a map of {FORMAT}; a bag cannot be gone on with")
    version = about.get("version", "")
    if not (version.isascii() and version.isdigit()) or int(version) > VERSION:
        raise MapError(f"{path}: version {version}, but this tccm_ros reads {VERSION}; update it")
    sums = CHECKSUMS_1 if int(version) == 1 else CHECKSUMS
    wanted = {name: about[key] for name, key in sums.items() if key in about}
    found = {name: hashlib.sha256(data).hexdigest() for name, data in attached.items()}
    if found != wanted or next(iter(sums)) not in found:
        raise MapError(f"{path}: damaged (its checksum does not fit)")
    return int(version)


def _arrays_1(attached: Mapping[str, bytes]) -> dict[str, NDArray[Any]]:
    """Return the arrays of a map of version 1."""
    found = {}
    for name, archive in attached.items():
        with np.load(io.BytesIO(archive), allow_pickle=False) as arrays:
            group = name.removesuffix(".npz")
            found.update({f"{group}/{key}": arrays[key] for key in arrays.files})
    return found
