"""Write and read a saved map: an mcap file that a new session continues and that opens in Foxglove.

The map is an attachment, an .npz of named arrays with its own checksum. Topics in the same file
show the surfaces, points and walls. A file is written under a temporary name and then renamed.
"""

from __future__ import annotations

import hashlib
import io
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from tccm_ros.atomic import finish_moves, write_output
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.errors import MapError, one_line
from tccm_ros.mapping.saved_map import SavedMap, SavedView, pack_views, unpack_views
from tccm_ros.results.array_archive import array_archive, read_arrays
from tccm_ros.results.labels_file import labels_beside, with_labels
from tccm_ros.results.numbers import Stamp
from tccm_ros.ros.topic_messages import SolutionMessageBuilder

if TYPE_CHECKING:  # slam_node does not import the graph; its child process solves
    from tccm_ros.mapping.surface_slam import SurfaceSolution

Arrays = dict[str, NDArray[Any]]

FORMAT = "tccm_ros/map"
VERSION = 3
"""Version of the arrays; other versions are refused."""

ATTACHMENT = "map.npz"
CHECKSUM = "sha256"
"""Metadata key of the attachment's checksum."""

TOPICS = ("surfaces", "surface_cloud", "walls")
"""Topics of the SLAM node in a saved map. Its path is left out, as it covers one session only."""

MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<QQI")
"""Last record of an mcap: offset of the summary, of its offset section, checksum of the summary."""

DATA_END = 13
"""Size of the record before the summary, bytes: opcode, length, checksum of all data before it."""


class MapContent(NamedTuple):
    """Amount of content in a map.

    Attributes
    ----------
    keyframes, views, surfaces, sessions, objects, walls, signs
        Numbers over all sessions; 0 if the version that wrote the file did not count them.
    """

    keyframes: int
    views: int
    surfaces: int = 0
    sessions: int = 0
    objects: int = 0
    walls: int = 0
    signs: int = 0

    @classmethod
    def of(cls, saved: SavedMap, solution: SurfaceSolution) -> MapContent:
        """Return the amount of content in the map of a solution."""
        return cls(
            keyframes=len(solution.graph.keyframes),
            views=len(saved.views),
            surfaces=len(solution.surfaces),
            sessions=len({s.view.session for s in saved.views}) or 1,
            objects=len(solution.objects),
            walls=len(solution.graph.walls),
            signs=len(solution.graph.signs),
        )

    def __str__(self) -> str:
        return f"{self.keyframes} keyframes, {self.views} views and {self.surfaces} surfaces"

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to save."""
        return not (self.keyframes or self.views)

    def is_less_than(self, other: MapContent) -> bool:
        """Return whether it has fewer keyframes or views; surfaces do not count, as they merge."""
        return self.keyframes < other.keyframes or self.views < other.views


def read_content(path: Path) -> MapContent:
    """Return the amount of content in the map of a file.

    Raises
    ------
    MapError
        If the file is missing, damaged or not a map.
    """
    with suppress(OSError, McapError, ValueError, EOFError, struct.error, TypeError, StopIteration):
        with path.open("rb") as file:
            found = make_reader(file).iter_metadata()
            metadata = next(m.metadata for m in found if m.name == FORMAT)
        counts = {name: int(metadata[name]) for name in MapContent._fields if name in metadata}
        return MapContent(**counts)
    saved = load_map(path)
    return MapContent(saved.keyframe_count, len(saved.views))


def save_map(
    path: Path | str, saved: SavedMap, solution: SurfaceSolution, frame_id: str = "map"
) -> None:
    """Write a map and replace an older file of that name atomically.

    The file is byte-identical for the same map.

    Parameters
    ----------
    path
        An .mcap file.
    saved
        `SurfaceSlam.saved` of the same solution.
    solution
        Solution whose surfaces, points and walls are written as topics.
    frame_id
        Name of the map frame.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    write_output(path, map_content(saved, solution, frame_id))


def map_content(saved: SavedMap, solution: SurfaceSolution, frame_id: str) -> bytes:
    """Return the content of a map file.

    Parameters
    ----------
    saved, solution, frame_id
        As for `save_map`.
    """
    stream = io.BytesIO()
    archive = array_archive(_arrays_of(saved))
    writer = Writer(
        stream, compression=CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True
    )
    writer.start(profile="ros2", library="tccm_ros")
    stamp = max((s.view.stamp_ns for s in saved.views), default=0)
    _write_topics(writer, solution, stamp, frame_id)
    writer.add_attachment(stamp, stamp, ATTACHMENT, "application/zip", archive)
    metadata = {"format": FORMAT, "version": str(VERSION)}
    metadata[CHECKSUM] = hashlib.sha256(archive).hexdigest()
    metadata["stamp"] = str(Stamp(solution.stamp_ns))
    counts = MapContent.of(saved, solution)._asdict()
    metadata.update({name: str(count) for name, count in counts.items()})
    writer.add_metadata(FORMAT, metadata)
    writer.finish()
    return stream.getvalue()


def _write_topics(writer: Writer, solution: SurfaceSolution, stamp: int, frame_id: str) -> None:
    """Write surfaces, their points and walls as one message each."""
    types = TypestoreMessages()
    schemas: dict[str, int] = {}
    for topic, msgtype, build in SolutionMessageBuilder(types, frame_id).of(solution, stamp):
        if topic not in TOPICS:
            continue
        if msgtype not in schemas:
            definition = types.definition(msgtype).encode()
            schemas[msgtype] = writer.register_schema(msgtype, "ros2msg", definition)
        channel = writer.register_channel(f"/surface_slam/{topic}", "cdr", schemas[msgtype])
        writer.add_message(channel, stamp, bytes(types.serialize(msgtype, build())), stamp)


def is_map(path: Path | str) -> bool:
    """Return whether the metadata of a file identifies it as a map, intact or damaged."""
    with suppress(OSError, McapError, ValueError, EOFError, struct.error), open(path, "rb") as file:
        summary = make_reader(file).get_summary()
        return summary is not None and any(m.name == FORMAT for m in summary.metadata_indexes)
    return False


def load_map(path: Path | str) -> SavedMap:
    """Read a map, with the corrected labels of a labels.json beside a map.mcap.

    Raises
    ------
    MapError
        If the file is missing, damaged, not a map or of another version, or if labels.json does not
        fit.
    """
    path = Path(path)
    return with_labels(_read_map(path), labels_beside(path))


def _read_map(path: Path) -> SavedMap:
    try:
        with suppress(OSError):  # a read-only folder is read as it is
            finish_moves(path.parent)
        content = path.read_bytes()
        _check_sums(content)
        metadata, archive = _read(io.BytesIO(content))
    except FileNotFoundError:
        raise MapError(f"{path}: no such map; 'tccm replay' writes one as map.mcap") from None
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({one_line(error)})") from None
    except (McapError, ValueError, EOFError, struct.error, zlib.error, StopIteration) as error:
        raise MapError(f"{path}: damaged or not a map ({one_line(error)})") from None
    _check(path, metadata, archive)
    try:
        return _map_of(read_arrays(io.BytesIO(archive)))
    except (ValueError, KeyError, TypeError) as error:
        raise MapError(f"{path}: damaged ({one_line(error)})") from None
    except MapError as error:
        raise MapError(f"{path}: {error}") from None


def _check_sums(content: bytes) -> None:
    """Check the checksums of the data and summary sections of an mcap file.

    Raises
    ------
    ValueError, struct.error
        If they do not match, or if the file is truncated.
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
        raise ValueError("its checksum does not match")


def _read(stream: Any) -> tuple[Mapping[str, str], bytes]:
    """Return the file's metadata and the attached map; empty if they are missing."""
    reader = make_reader(stream, validate_crcs=True)
    metadata = next((m.metadata for m in reader.iter_metadata() if m.name == FORMAT), {})
    archives = (a.data for a in reader.iter_attachments() if a.name == ATTACHMENT)
    return metadata, next(archives, b"")


def _check(path: Path, metadata: Mapping[str, str], archive: bytes) -> None:
    """Raise MapError if a file is not a map, of another version, or damaged."""
    if metadata.get("format") != FORMAT:
        raise MapError(f"{path}: an mcap, but not a map; expected the map.mcap of 'tccm replay'")
    version = metadata.get("version", "")
    if not (version.isascii() and version.isdigit()) or int(version) > VERSION:
        raise MapError(f"{path}: version {version}, but this tccm_ros reads {VERSION}; update it")
    if int(version) < VERSION:
        raise MapError(
            f"{path}: version {version}, saved before tccm_ros 0.1.0 and not readable; "
            "replay its recordings again"
        )
    if hashlib.sha256(archive).hexdigest() != metadata.get(CHECKSUM):
        raise MapError(f"{path}: damaged (its checksum does not match)")


def _arrays_of(saved: SavedMap) -> Arrays:
    views = pack_views([s.view for s in saved.views])
    return {
        **{f"walls/{name}": array for name, array in sorted(saved.walls.items())},
        **{f"views/{name}": array for name, array in sorted(views.items())},
        "anchor/keyframe": np.array([s.keyframe for s in saved.views], np.int64),
        "anchor/hangs": np.array([s.is_on_keyframe for s in saved.views], bool),
        "anchor/T": np.array([s.T_anchor_view for s in saved.views], float).reshape(-1, 4, 4),
        "anchor/cov_tilt": np.array([s.cov_z_roll_pitch for s in saved.views], float).reshape(
            -1, 3, 3
        ),
    }


def _map_of(arrays: Arrays) -> SavedMap:
    anchors = _group(arrays, "anchor/")
    views = unpack_views(_group(arrays, "views/"))
    names = anchors["keyframe"].tolist(), anchors["hangs"].tolist()
    rows = zip(views, *names, anchors["T"], anchors["cov_tilt"], strict=True)
    return SavedMap(_group(arrays, "walls/"), tuple(SavedView(*row) for row in rows))


def _group(arrays: Arrays, prefix: str) -> Arrays:
    return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
