"""What a SLAM node and the process that solves its map tell each other.

Events go through a journal, a file without a name: the node writes at its end, the other process
reads on. So nobody waits for the other, and a process that is started in place of one that died
reads the same events again and comes to the same bytes. Commands and answers go through a pipe.
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
from tccm_ros.surfaces.labels import SurfaceLabel

GRID, GRID_TOPIC = "nav_msgs/msg/OccupancyGrid", "map"
"""For navigation, latched; saved as map.pgm and map.yaml."""

HEADER = struct.Struct("<Q")
"""Before each batch of events: its size."""


class PoseStamp(int):
    """Stamp of a tilt scan, ns: an event for `SurfaceSlam.add_pose_stamp`."""


class Begin(NamedTuple):
    """Forget everything. The descriptor of a journal follows, then that of the saved map, if any.

    Attributes
    ----------
    config
        The configuration, JSON.
    session
        Number of this beginning, for the answers.
    map_name
        Of the saved map to go on with, for messages; empty without one.
    labels
        What a labels.json beside that map says; None without one.
    journal, saved_map
        Descriptors (set by who receives them).
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
        Of the journal, bytes.
    """

    length: int


class Solve(NamedTuple):
    """Solve with all events so far.

    Attributes
    ----------
    number
        The answer has it too.
    topics
        The answer has the messages of these.
    is_final
        Whether it is a batch, as a replay ends with, at any size (`SurfaceSlam.solve`).
    map_name
        Name of the map in its messages.
    """

    number: int
    topics: frozenset[str]
    is_final: bool = False
    map_name: str = ""


class Show(NamedTuple):
    """Send messages of the newest solution.

    Attributes
    ----------
    topics
        Names of the topics whose messages are wanted.
    """

    topics: frozenset[str]


class Began(NamedTuple):
    """A session has begun, or could not (`error`): then the one before goes on.

    Attributes
    ----------
    session
        As asked.
    first_keyframe
        `WallSlam.first_keyframe`.
    error
        Why the saved map cannot be read; empty.
    """

    session: int
    first_keyframe: tuple[int, int] = (0, 0)
    error: str = ""


class Solved(NamedTuple):
    """What the node takes from a solution; the descriptor of the archive with its files follows.

    Attributes
    ----------
    session, number, resets
        As asked; clock jumps among the events so far.
    stamp_ns
        Of the newest event in it.
    content
        How much its map holds.
    map
        Where it puts this session, its newest keyframe and its walls, for `Tracker.take`.
    scene
        What programs ask about (`nodes.solver.scene_channel`), in pieces.
    messages
        Serialised, by topic.
    duration_s
        Time that it took.
    unused_detections
        `SurfaceSolution.unused_detections`.
    is_batch
        `Solution.is_batch`.
    failed_stages
        Stages that were left out, by name and error.
    archive
        Descriptor (set by who receives it).
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


class Placed(NamedTuple):
    """A session has got a place in the map, or waits for something else than before.

    Attributes
    ----------
    session, resets
        As of `Solved`.
    map
        Where the robot is, before anything is solved; None while that is not known.
    waits_for
        Why it is not; empty where it is.
    is_told
        Whether it is at a user-supplied pose.
    """

    session: int
    resets: int
    map: SolvedMap | None
    waits_for: str
    is_told: bool


class Messages(NamedTuple):
    """The answer to `Show`.

    Attributes
    ----------
    session
        Number of the session whose solution it is.
    messages
        Serialised (CDR), by topic.
    """

    session: int
    messages: dict[str, bytes]


class Failed(NamedTuple):
    """A command or an event raised; the process goes on.

    Attributes
    ----------
    session
        Number of the session.
    number
        Of the solution that was asked for; -1 for none.
    error
        What was raised, in a line.
    """

    session: int
    number: int
    error: str


class Journal:
    """Events of a session in a file that vanishes with its last descriptor.

    Attributes
    ----------
    length
        Bytes written.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="tccm_journal_")  # noqa: SIM115
        self.length = 0

    def fileno(self) -> int:
        """Return its descriptor."""
        return self._file.fileno()

    def append(self, events: Sequence[Any]) -> None:
        """Write a batch of events, compressed.

        Raises
        ------
        OutputError
            Where the disk is full.
        """
        batch = zlib.compress(pickle.dumps(events, pickle.HIGHEST_PROTOCOL), 1)
        entry = HEADER.pack(len(batch)) + batch
        try:
            self.length += os.pwrite(self.fileno(), entry, self.length)
        except OSError as error:
            reason = f"{tempfile.gettempdir()}: cannot be written ({one_line(error)})"
            raise OutputError(reason) from None

    def close(self) -> None:
        """Let go of it."""
        self._file.close()


def read_events(journal: int, begin: int, end: int) -> Iterator[Any]:
    """Yield events of a journal.

    Parameters
    ----------
    journal
        Its file descriptor.
    begin, end
        Lengths of the journal, in bytes, before and after the events were written.
    """
    while begin < end:
        (size,) = HEADER.unpack(os.pread(journal, HEADER.size, begin))
        begin += HEADER.size
        yield from pickle.loads(zlib.decompress(os.pread(journal, size, begin)))
        begin += size
