"""The solver process of a SLAM node: `python -m tccm_ros.nodes.solver.process DESCRIPTOR`.

It feeds the node's events, in their order, to the same processor as a replay, and returns the
results that the node publishes and saves. It does not use rclpy, ignores stop signals, which are
for the node, and ends with the node.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from multiprocessing import reduction
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.config import Config
from tccm_ros.errors import MapError, TccmError, one_line
from tccm_ros.mapping.saved_map import SavedMap
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.nodes.process.child_process import yield_to_node
from tccm_ros.nodes.process.heap import trim_heap
from tccm_ros.nodes.solver.channel import (
    GRID,
    GRID_TOPIC,
    KEEPOUT_TOPIC,
    Began,
    Begin,
    Failed,
    Feed,
    Localised,
    Messages,
    PoseStamp,
    Show,
    Solve,
    Solved,
    read_events,
)
from tccm_ros.nodes.solver.scene_channel import pack_scene
from tccm_ros.results.exports import solution_files
from tccm_ros.results.grid_files import grid_files
from tccm_ros.results.keepout_mask import keepout_mask
from tccm_ros.results.labels_file import MAP_FILE, with_labels
from tccm_ros.results.map_file import MapContent, load_map, map_content
from tccm_ros.ros.output_messages import grid_message
from tccm_ros.ros.topic_messages import SolutionMessageBuilder, TopicMessage
from tccm_ros.slam.live_estimate import NO_WALLS
from tccm_ros.slam.occupancy import RESOLUTION_M, OccupancyGrid
from tccm_ros.stages import OptionalStages

GRID_NAME = "map"
"""Stem of map.pgm and map.yaml, for nav2_map_server."""

MASK_NAME = "keepout"
"""Stem of keepout.pgm and keepout.yaml, for the costmap filters of Nav2."""


class SolverProcess:
    """Executes the commands of a node one after another.

    Parameters
    ----------
    connection
        Connection to the node.
    """

    def __init__(self, connection: Connection):
        self._connection = connection
        self._types = TypestoreMessages()
        self._session = -1
        self._journal = -1
        self._read = 0
        self._slam = SurfaceSlam(Config())
        self._walls, self._reported_localisation = NO_WALLS, self._localisation
        self._shown: dict[str, TopicMessage] = {}
        self._builder = SolutionMessageBuilder(self._types, "map")
        self._do: dict[type, Callable[[Any], None]] = {
            Begin: self._begin,
            Feed: self._feed,
            Solve: self._solve,
            Show: self._show,
        }

    def do(self, command: Begin | Feed | Solve | Show) -> None:
        """Execute one command and report its exception to the node."""
        try:
            self._do[type(command)](command)
        except Exception as error:
            self._report(command, error)

    def _report(self, command: Any, error: Exception) -> None:
        number = command.number if isinstance(command, Solve) else -1
        self._connection.send(Failed(self._session, number, _reason(error)))

    def _begin(self, begin: Begin) -> None:
        journal, config = begin.journal, Config.model_validate_json(begin.config)
        try:
            slam = SurfaceSlam(config)
            if begin.map_name:
                slam = SurfaceSlam.from_saved(config, _read_map(begin))
        except Exception as error:
            os.close(journal)
            self._connection.send(Began(begin.session, error=_reason(error)))
            return
        if self._journal >= 0:
            os.close(self._journal)
        self._session, self._journal, self._read = begin.session, journal, 0
        self._slam, self._shown = slam, {}
        self._walls, self._reported_localisation = NO_WALLS, self._localisation
        self._builder = SolutionMessageBuilder(self._types, config.frames.map_name)
        self._connection.send(Began(begin.session, slam.wall_slam.first_keyframe))

    def _feed(self, feed: Feed) -> None:
        begin, self._read = self._read, feed.length
        for event in read_events(self._journal, begin, feed.length):
            try:
                self._take(event)
            except Exception as error:
                self._report(feed, error)

    def _take(self, event: Any) -> None:
        if isinstance(event, PoseStamp):
            self._slam.add_pose_stamp(int(event))
        elif isinstance(event, Config):
            for group in type(event).model_fields:
                setattr(self._slam.config, group, getattr(event, group))
        else:
            self._slam.add(event)
            self._report_localisation()

    @property
    def _localisation(self) -> tuple[int, bool, bool, str]:
        walls = self._slam.wall_slam
        return walls.session, walls.is_located, walls.is_unjoined, walls.waits_for

    def _report_localisation(self) -> None:
        """Report a change of the localisation, or of its wait condition, at once."""
        if self._localisation == self._reported_localisation:
            return
        self._reported_localisation = self._localisation
        slam = self._slam
        localised = slam.placed_map(self._walls)
        resets, is_at_given_pose = slam.counts["resets"], slam.wall_slam.is_at_given_pose
        self._connection.send(
            Localised(self._session, resets, localised, slam.wall_slam.waits_for, is_at_given_pose)
        )

    def _solve(self, solve: Solve) -> None:
        start = time.monotonic()
        solution = self._slam.solve(is_final=solve.is_final)
        solved_map = self._slam.solved_map(solution)
        self._walls = solved_map.walls
        saved = self._slam.saved(solution)
        frame = self._slam.config.frames.map_name
        with tempfile.TemporaryFile(prefix="tccm_map_") as archive:
            pack_files(map_files(self._slam, solution, frame, saved), archive)
            self._shown = self._messages(solution, solve.map_name)
            serialised = self._serialised(solve.topics, solution.stages)
            solved = Solved(
                self._session,
                solve.number,
                self._slam.counts["resets"],
                solution.stamp_ns,
                MapContent.of(saved, solution),
                solved_map,
                pack_scene(solution, frame, solution.grid, self._types),
                serialised,
                time.monotonic() - start,
                solution.unused_detections,
                solution.graph.is_batch,
                dict(solution.stages.failed),
            )
            self._connection.send(solved)
            reduction.send_handle(self._connection, archive.fileno(), os.getppid())
        trim_heap()

    def _show(self, show: Show) -> None:
        serialised = self._serialised(show.topics, OptionalStages())
        self._connection.send(Messages(self._session, serialised))

    def _messages(self, solution: SurfaceSolution, map_name: str) -> dict[str, TopicMessage]:
        due = [*self._builder.of(solution, solution.stamp_ns, map_name)]
        due.append(TopicMessage(GRID_TOPIC, GRID, lambda: self._grid(solution)))
        due.append(TopicMessage(KEEPOUT_TOPIC, GRID, lambda: self._keepout(solution)))
        return {message.topic: message for message in due}

    def _serialised(self, topics: Collection[str], stages: OptionalStages) -> dict[str, bytes]:
        names = sorted(topics & self._shown.keys())
        made = {name: stages.run(name, partial(self._bytes_of, name)) for name in names}
        return {name: data for name, data in made.items() if data}

    def _bytes_of(self, name: str) -> bytes:
        message = self._shown[name]
        return bytes(self._types.serialize(message.msgtype, message.build()))

    def _grid(self, solution: SurfaceSolution) -> Any:
        """Return the grid as a nav_msgs/OccupancyGrid; empty without a level laser."""
        empty = OccupancyGrid(np.zeros((0, 0), np.int8), RESOLUTION_M, np.zeros(2))
        return self._grid_message(solution, solution.grid or empty)

    def _keepout(self, solution: SurfaceSolution) -> Any:
        mask = keepout_mask(solution.grid, solution.surfaces, solution.floor_z)
        return self._grid_message(solution, mask)

    def _grid_message(self, solution: SurfaceSolution, grid: OccupancyGrid) -> Any:
        frame = self._slam.config.frames.map_name
        return grid_message(self._types, solution.stamp_ns, frame, grid)


def map_files(
    processor: SurfaceSlam, solution: SurfaceSolution, map_frame: str, saved: SavedMap
) -> dict[str, bytes]:
    """Return the files of a map by name.

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
    grid = solution.grid
    if grid is not None:
        files |= grid_files(GRID_NAME, grid)
        mask = solution.stages.run(
            "keepout mask", lambda: keepout_mask(grid, solution.surfaces, solution.floor_z)
        )
        files |= {} if mask is None else grid_files(MASK_NAME, mask)
    return files | {MAP_FILE: map_content(saved, solution, map_frame)}


def pack_files(files: Mapping[str, bytes], stream: Any) -> None:
    """Write an archive: one line of JSON with names and sizes, then the concatenated contents."""
    sizes = {name: len(content) for name, content in files.items()}
    stream.write(json.dumps(sizes).encode() + b"\n")
    for content in files.values():
        stream.write(content)
    stream.flush()


def _reason(error: Exception) -> str:
    kind = "" if isinstance(error, TccmError) else f"{type(error).__name__}: "
    if isinstance(error, OSError):  # the temporary folder is the only place it writes to
        kind = f"{tempfile.gettempdir()}: "
    return f"{kind}{one_line(error)}"


def _read_map(begin: Begin) -> SavedMap:
    """Read a saved map from its descriptor; error messages contain its name."""
    path = Path(f"/dev/fd/{begin.saved_map}")
    try:
        return with_labels(load_map(path), begin.labels)
    except MapError as error:
        raise MapError(str(error).replace(str(path), begin.map_name)) from None
    finally:
        os.close(begin.saved_map)


def listen(connection: Connection, commands: queue.SimpleQueue[Any]) -> None:
    """Queue commands on arrival, so that the node never waits; exit with the node."""
    try:
        while True:
            command = connection.recv()
            if isinstance(command, Begin):
                command = command._replace(journal=reduction.recv_handle(connection))
                if command.map_name:
                    command = command._replace(saved_map=reduction.recv_handle(connection))
            commands.put(command)
    except (EOFError, OSError):
        os._exit(0)


def serve(connection: Connection) -> NoReturn:
    """Serve the node at the other end of a connection until it ends."""
    yield_to_node()
    commands: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=listen, args=(connection, commands), daemon=True).start()
    solver = SolverProcess(connection)
    while True:
        solver.do(commands.get())


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
