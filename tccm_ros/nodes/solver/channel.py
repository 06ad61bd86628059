"""Commands, events and answers between a SLAM node and its solver process.

Events go through a journal, an unnamed file to which the node appends and from which the solver
process reads. So neither waits for the other, and a process that replaces a dead one reads the same
events again and computes the same bytes. Commands and answers go through a pipe.
"""

from __future__ import annotations

import os
import pickle
import struct
import tempfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from tccm_ros.errors import OutputError, one_line
from tccm_ros.results.map_file import MapContent
from tccm_ros.slam.tracking import SolvedMap
from tccm_ros.surfaces.labels.labels import SurfaceLabel

GRID, GRID_TOPIC = "nav_msgs/msg/OccupancyGrid", "map"
"""Grid for navigation, latched; saved as map.pgm and map.yaml."""

KEEPOUT_TOPIC = "keepout_mask"
"""Mask of the floor under furniture, for Nav2's costmap filters; saved as keepout.pgm and .yaml."""

HEADER = struct.Struct("<Q")
"""Header of each batch of events: its size, bytes."""


class PoseStamp(int):
    """Stamp of a tilt scan, ns: an event for `SurfaceSlam.add_pose_stamp`."""


class Begin(NamedTuple):
    """Begin a session; descriptors of its journal and of the saved map, if any, follow.

    Attributes
    ----------
    config
        The configuration, JSON.
    session
        Number of the session, repeated in the answers.
    map_name
        Name of the saved map to continue, for messages; empty without one.
    labels
        Content of a labels.json beside that map; None without one.
    journal, saved_map
        File descriptors (set by the receiver).
    """

    config: str
    session: int
    map_name: str = ""
    labels: Mapping[int, SurfaceLabel] | None = None
    journal: int = -1
    saved_map: int = -1


class Feed(NamedTuple):
    """The journal has grown.

    Attributes
    ----------
    length
        Length of the journal, bytes.
    """

    length: int


class Solve(NamedTuple):
    """Solve with all events received so far.

    Attributes
    ----------
    number
        Number of the solution, repeated in the answer.
    topics
        Topics whose messages the answer contains.
    is_final
        Whether to solve as a batch at any size, as at the end of a replay (`SurfaceSlam.solve`).
    map_name
        Name of the map in the messages.
    """

    number: int
    topics: frozenset[str]
    is_final: bool = False
    map_name: str = ""


class Show(NamedTuple):
    """Request messages of the newest solution.

    Attributes
    ----------
    topics
        Names of the topics.
    """

    topics: frozenset[str]


class Began(NamedTuple):
    """A session has begun, or failed to begin (`error`), in which case the previous one continues.

    Attributes
    ----------
    session
        Number of the session from `Begin`.
    first_keyframe
        `WallSlam.first_keyframe`.
    error
        Reason why the saved map cannot be read; empty if it can.
    """

    session: int
    first_keyframe: tuple[int, int] = (0, 0)
    error: str = ""


class Solved(NamedTuple):
    """A solution as needed by the node; the descriptor of the archive with its files follows.

    Attributes
    ----------
    session, number, resets
        Numbers from the commands, and the count of clock jumps among the events.
    stamp_ns
        Stamp of the newest event in it, ns.
    content
        Content of its map.
    map
        Its estimate of this session, the newest keyframe and the walls, for `Tracker.take`.
    scene
        Pickled pieces of the scene for queries (`nodes.solver.scene_channel`).
    messages
        Serialised messages by topic.
    duration_s
        Duration of the solution, s.
    unused_detections
        `SurfaceSolution.unused_detections`.
    is_batch
        `Solution.is_batch`.
    failed_stages
        Optional stages that failed, by name and error.
    archive
        File descriptor (set by the receiver).
    """

    session: int
    number: int
    resets: int
    stamp_ns: int
    content: MapContent
    map: SolvedMap
    scene: tuple[bytes, ...]
    messages: dict[str, bytes]
    duration_s: float
    unused_detections: Mapping[str, int]
    is_batch: bool
    failed_stages: Mapping[str, int] = {}
    archive: int = -1


class Localised(NamedTuple):
    """A session has been localised in the map, or its search waits for another condition.

    Attributes
    ----------
    session, resets
        As in `Solved`.
    map
        The map with the pose of the robot, before a solution; None while the pose is unknown.
    waits_for
        Reason why the pose is unknown; empty if it is known.
    is_at_given_pose
        Whether the pose is a user-supplied one.
    """

    session: int
    resets: int
    map: SolvedMap | None
    waits_for: str
    is_at_given_pose: bool


class Messages(NamedTuple):
    """The answer to `Show`.

    Attributes
    ----------
    session
        Number of the session.
    messages
        Serialised messages (CDR) by topic.
    """

    session: int
    messages: dict[str, bytes]


class Failed(NamedTuple):
    """A command or an event raised an exception; the process continues.

    Attributes
    ----------
    session
        Number of the session.
    number
        Number of the requested solution; -1 for none.
    error
        The exception in one line.
    """

    session: int
    number: int
    error: str


class Journal:
    """Events of a session in a file that is deleted with its last descriptor.

    Attributes
    ----------
    length
        Number of bytes written.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="tccm_journal_")  # noqa: SIM115
        self.length = 0

    def fileno(self) -> int:
        """Return its file descriptor."""
        return self._file.fileno()

    def append(self, events: Sequence[Any]) -> None:
        """Append a batch of events, compressed; all of it or, by `length`, nothing.

        Raises
        ------
        OutputError
            If the disk is full.
        """
        batch = zlib.compress(pickle.dumps(events, pickle.HIGHEST_PROTOCOL), 1)
        entry = HEADER.pack(len(batch)) + batch
        written = 0
        try:
            while written < len(entry):  # a disk that becomes full takes a part
                written += os.pwrite(self.fileno(), entry[written:], self.length + written)
        except OSError as error:
            reason = f"{tempfile.gettempdir()}: cannot be written ({one_line(error)})"
            raise OutputError(reason) from None
        self.length += written

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_events(journal: int, begin: int, end: int) -> Iterator[Any]:
    """Yield the events in a section of a journal.

    Parameters
    ----------
    journal
        File descriptor of the journal.
    begin, end
        Offsets of the section, bytes.
    """
    while begin < end:
        (size,) = HEADER.unpack(os.pread(journal, HEADER.size, begin))
        begin += HEADER.size
        yield from pickle.loads(zlib.decompress(os.pread(journal, size, begin)))
        begin += size
