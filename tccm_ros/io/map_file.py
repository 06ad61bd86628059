"""A map in one file: an mcap that holds what a session needs to go on, and opens in Foxglove.

The state is an attachment of named arrays with a checksum of its own, the interrupted run another;
topics beside them show the surfaces, points and walls. Files are written beside their place and
moved there.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from tccm_ros.errors import MapError, OutputError, one_line
from tccm_ros.io.folder import finish_moves
from tccm_ros.io.numbers import array_archive
from tccm_ros.io.ply import surface_color
from tccm_ros.io.typestore import TypestoreMessages
from tccm_ros.messages.markers import Place, surface_markers, wall_markers
from tccm_ros.messages.results import surface_map_message
from tccm_ros.surfaces.continuation import Continuation, LastSample
from tccm_ros.surfaces.saved_map import SavedMap, SavedView
from tccm_ros.surfaces.surface_slam import SurfaceSolution
from tccm_ros.surfaces.view_arrays import pack_views, unpack_views

__all__ = ["FORMAT", "VERSION", "load_map", "save_map"]

FORMAT = "tccm_ros/map"
VERSION = 1
ATTACHMENT = "map.npz"
RUN = "run.npz"
"""The run in the middle of which the map was saved; a file without it is a map all the same."""

CHECKSUMS = {ATTACHMENT: "sha256", RUN: "run_sha256"}
"""Where the metadata has the checksum of an attachment."""

MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<QQI")
"""Start of the summary, start of its offsets, checksum of the summary."""

DATA_END = 13
"""Bytes of the record before the summary: opcode, length, checksum of all before it."""

Arrays = dict[str, NDArray[Any]]


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
        os.replace(beside, path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise OutputError(f"{path}: cannot be written ({one_line(error)})") from None


def _write(stream: Any, saved: SavedMap, solution: SurfaceSolution, frame_id: str) -> None:
    attached = {ATTACHMENT: array_archive(_pack(saved))}
    if saved.run is not None:
        attached[RUN] = array_archive(_pack_run(saved.run), level=1)
    writer = Writer(
        stream, compression=CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True
    )
    writer.start(profile="ros2", library="tccm_ros")
    stamp = max((s.view.stamp_ns for s in saved.views), default=0)
    _write_topics(writer, solution, stamp, frame_id)
    about = {"format": FORMAT, "version": str(VERSION)}
    for name, data in attached.items():
        writer.add_attachment(stamp, stamp, name, "application/zip", data)
        about[CHECKSUMS[name]] = hashlib.sha256(data).hexdigest()
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
    _check(path, about, attached)
    try:
        saved = _unpack(_arrays(attached[ATTACHMENT]))
        run = _unpack_run(_arrays(attached[RUN])) if RUN in attached else None
        return replace(saved, run=run)
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
    return about, {a.name: a.data for a in reader.iter_attachments() if a.name in CHECKSUMS}


def _check(path: Path, about: Mapping[str, str], attached: Mapping[str, bytes]) -> None:
    if about.get("format") != FORMAT:
        raise MapError(f"{path}: an mcap, but not a map of {FORMAT}; a bag cannot be gone on with")
    version = about.get("version", "")
    if not version.isdigit() or int(version) > VERSION:
        raise MapError(f"{path}: version {version}, but this tccm_ros reads {VERSION}; update it")
    wanted = {name: about[key] for name, key in CHECKSUMS.items() if key in about}
    found = {name: hashlib.sha256(data).hexdigest() for name, data in attached.items()}
    if found != wanted or ATTACHMENT not in found:
        raise MapError(f"{path}: damaged (its checksum does not fit)")


def _arrays(archive: bytes) -> Arrays:
    with np.load(io.BytesIO(archive), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _pack(saved: SavedMap) -> Arrays:
    views = pack_views([s.view for s in saved.views])
    about = np.frombuffer(json.dumps({"views": len(saved.views)}).encode(), np.uint8)
    return {
        "about": about,
        **{f"walls/{name}": array for name, array in sorted(saved.walls.items())},
        **{f"views/{name}": array for name, array in sorted(views.items())},
        "anchor/keyframe": np.array([s.keyframe for s in saved.views], np.int64),
        "anchor/hangs": np.array([s.hangs for s in saved.views], bool),
        "anchor/T": np.array([s.T_anchor_view for s in saved.views], float).reshape(-1, 4, 4),
        "anchor/cov_tilt": np.array([s.cov_tilt for s in saved.views], float).reshape(-1, 3, 3),
    }


def _unpack(arrays: Arrays) -> SavedMap:
    def group(prefix: str) -> Arrays:
        return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}

    anchors = group("anchor/")
    views = unpack_views(group("views/"))
    names = anchors["keyframe"].tolist(), anchors["hangs"].tolist()
    rows = zip(views, *names, anchors["T"], anchors["cov_tilt"], strict=True)
    return SavedMap(group("walls/"), tuple(SavedView(*row) for row in rows))


def _pack_run(run: Continuation) -> Arrays:
    about = {
        "software": run.software,
        "configuration": run.configuration,
        "last": run.last.to_json(),
    }
    text = np.frombuffer(json.dumps(about, sort_keys=True).encode(), np.uint8)
    return {"about": text, **{f"state/{name}": array for name, array in run.state.items()}}


def _unpack_run(arrays: Arrays) -> Continuation:
    about = json.loads(arrays.pop("about").tobytes())
    return Continuation(
        about["software"],
        about["configuration"],
        LastSample.from_json(about["last"]),
        {name.removeprefix("state/"): array for name, array in arrays.items()},
    )
