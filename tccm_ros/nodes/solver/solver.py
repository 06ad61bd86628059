"""The node's side of its solver process."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import reduction
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any

from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError, one_line
from tccm_ros.nodes.process.child_process import end, spawn
from tccm_ros.nodes.solver.channel import (
    Began,
    Begin,
    Failed,
    Feed,
    Journal,
    Localised,
    Messages,
    Show,
    Solve,
    Solved,
)
from tccm_ros.nodes.solver.forked import PROCESS, ForkedProcess, take_prepared
from tccm_ros.results.labels_file import labels_beside
from tccm_ros.surfaces.labels.labels import SurfaceLabel

BATCH = 50
"""Number of events in a batch: a quarter of a second of a laser, joints and odometry."""

MAX_DEATHS = 3
"""After this many deaths without a solution, the process is not restarted."""

RETRY_S = 1.0
"""Time between attempts to start the process again, s. Chosen: memory may be free by then."""

Answer = Solved | Localised | Messages | Failed


@dataclass
class _Session:
    """The input of a session, from which a restarted process computes the same state."""

    number: int
    config: str
    journal: Journal = field(default_factory=Journal)
    map_name: str = ""
    labels: Mapping[int, SurfaceLabel] | None = None
    saved_map: IO[bytes] | None = None

    def close(self) -> None:
        self.journal.close()
        if self.saved_map is not None:
            self.saved_map.close()


class Solver:
    """Sends events to the solver process and passes its solutions to the node.

    Only one thread, the node's worker, may call `begin`, `add`, `solve` and `show`.

    Parameters
    ----------
    config
        All groups; a change of parameters is an event (`add`).
    on_answer
        Called with each `Answer`, in a separate thread.

    Attributes
    ----------
    newest
        The newest solution of this session; None before the first.
    restarts
        Number of restarts after the process died.
    """

    def __init__(self, config: Config, on_answer: Callable[[Answer], None]):
        self._config, self._on_answer = config, on_answer
        self._changed = threading.Condition(threading.RLock())
        self._waiting: list[Any] = []
        self._session = _Session(0, config.model_dump_json())
        self._began: dict[int, Began] = {}
        self._sessions = 0
        self._asked: Solve | None = None
        self._number = 0
        self._last = 0
        self._is_current = False
        self._is_final = False
        self._deaths = 0
        self._is_closed = False
        self._process: subprocess.Popen[bytes] | ForkedProcess
        self.newest: Solved | None = None
        self.restarts = 0
        self._start()
        self._thread = threading.Thread(target=self._receive, name="solver", daemon=True)
        self._thread.start()

    @property
    def is_solving(self) -> bool:
        """Whether a requested solution is pending."""
        return self._asked is not None and not self.is_dead

    @property
    def _has_batch(self) -> bool:
        """Whether the last requested solution has arrived and is a batch."""
        return self._last == self._number and self.newest is not None and self.newest.is_batch

    @property
    def is_batch(self) -> bool:
        """Whether the newest solution, if there is one, is a batch."""
        return self.newest is None or self.newest.is_batch

    @property
    def next_number(self) -> int:
        """Number of the next requested solution, which contains all events added by then."""
        return self._number + 1

    @property
    def is_dead(self) -> bool:
        """Whether the process died too often, so that no new solution will come."""
        return self._deaths >= MAX_DEATHS

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    # --- for the worker ---

    def begin(self, saved_map: Path | None = None) -> tuple[int, int]:
        """Begin a session, empty or from a saved map; return `WallSlam.first_keyframe`.

        Raises
        ------
        MapError
            If the map cannot be read; the previous session continues unchanged.
        """
        self._sessions += 1
        session = _Session(self._sessions, self._config.model_dump_json())
        first_keyframe = (0, 0)
        with self._changed:
            if saved_map is not None:
                session.labels = labels_beside(saved_map)
                session.map_name, session.saved_map = str(saved_map), _copied(saved_map)
                first_keyframe = self._load(session)
            else:
                self._send_begin(session)
            self._session.close()
            self._forget(self.newest)
            self._session, self._waiting, self._asked, self.newest = session, [], None, None
            self._last, self._is_current, self._deaths = self._number, False, 0
            self._changed.notify_all()
        return first_keyframe

    def _load(self, session: _Session) -> tuple[int, int]:
        restarts, number = self.restarts, session.number
        self._send_begin(session)
        self._changed.wait_for(
            lambda: number in self._began or self.restarts > restarts or self.is_dead
        )
        began = self._began.get(number)
        error = "the process that reads it has died" if began is None else began.error
        if began is None or error:
            session.close()
            raise MapError(error)
        return began.first_keyframe

    def add(self, event: Any) -> None:
        """Add an event to the next batch."""
        self._waiting.append(event)
        self._is_current = False
        if len(self._waiting) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Send the events of the incomplete batch."""
        if not self._waiting:
            return
        with self._changed:
            self._session.journal.append(self._waiting)
            self._waiting = []
            self._send(Feed(self._session.journal.length))

    def solve(self, topics: frozenset[str], *, is_final: bool = False, map_name: str = "") -> int:
        """Request a solution with all events added; return its number for `wait`.

        If no event was added since the last request, its number is returned.

        Parameters
        ----------
        topics
            Topics whose messages the answer contains.
        is_final
            Whether to solve as a batch at any size (`SurfaceSlam.solve`).
        map_name
            Name of the map in the messages.
        """
        with self._changed:
            if self._is_current and (self._is_final or not is_final or self._has_batch):
                return self._number
            self.flush()
            self._number, self._is_current, self._is_final = self._number + 1, True, is_final
            self._asked = Solve(self._number, topics, is_final, map_name)
            self._send(self._asked)
            return self._number

    def show(self, topics: frozenset[str]) -> None:
        """Request messages of the newest solution."""
        with self._changed:
            self._send(Show(topics))

    # --- for all threads ---

    def wait(self, number: int, timeout_s: float | None = None) -> bool:
        """Wait until a solution has arrived or failed; return whether it did before the timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: self._last >= number or self.is_dead, timeout_s)

    def is_of_session(self, answer: Solved | Localised) -> bool:
        """Return whether an answer belongs to the current session."""
        return answer.session == self._session.number

    def archive(self) -> tuple[Solved, int] | None:
        """Return the newest solution and a descriptor of its archive, which the caller closes."""
        with self._changed:
            return None if self.newest is None else (self.newest, os.dup(self.newest.archive))

    def problems(self) -> Iterator[str]:
        """Yield the current problems, one line each."""
        if self.is_dead:
            yield (
                f"the solver process died {self._deaths} times without a solution and is not "
                "started again: the map is not updated any more; look at its memory, save "
                "and restart or reset the node"
            )
        elif self._deaths:
            yield (
                "the solver process died and was started again; nothing is lost, the next "
                "solution takes longer"
            )

    def close(self) -> None:
        """End the process."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        # Closing the connection would not end a blocking read in another thread; a shutdown does.
        with suppress(OSError), socket.socket(fileno=os.dup(self._connection.fileno())) as ours:
            ours.shutdown(socket.SHUT_RDWR)
        end(self._process)
        self._thread.join()
        self._connection.close()
        self._session.close()
        self._forget(self.newest)
        self.newest = None

    # --- the process ---

    def _start(self) -> None:
        prepared = take_prepared()
        if prepared is not None:
            self._process, self._connection = prepared
        else:
            self._process, self._connection = spawn(PROCESS)
        self._send_begin(self._session)

    def _send(self, command: Begin | Feed | Solve | Show) -> None:
        """Send a command; a dead process is sent all commands again after its restart."""
        with suppress(OSError):
            self._connection.send(command)

    def _send_begin(self, session: _Session) -> None:
        with suppress(OSError):
            self._connection.send(
                Begin(session.config, session.number, session.map_name, session.labels)
            )
            reduction.send_handle(self._connection, session.journal.fileno(), self.pid)
            if session.saved_map is not None:
                reduction.send_handle(self._connection, session.saved_map.fileno(), self.pid)

    def _receive(self) -> None:
        while not self._is_closed:
            try:
                self._take(self._connection, self._connection.recv())
            except (EOFError, OSError, RuntimeError):  # the last: an answer was cut off
                self._restart()

    def _restart(self) -> None:
        """Start the process again; after too many deaths, when the next session begins."""
        with self._changed:
            if self._is_closed:
                return
            self._process.kill()
            self._process.wait()
            self._connection.close()
            self._deaths += 1
            while not self._is_closed and not self._is_started_again():
                self._changed.wait(RETRY_S)
            self._changed.notify_all()

    def _is_started_again(self) -> bool:
        """Start the process and send it all events; return False if it is dead or cannot start."""
        if self.is_dead:
            self._asked = None
            self._changed.notify_all()
            return False
        try:
            self._start()
        except OSError:  # no memory for another process
            self._deaths += 1
            return False
        self.restarts += 1
        self._send(Feed(self._session.journal.length))
        if self._asked is not None:
            self._send(self._asked)
        return True

    def _take(self, connection: Connection, answer: Any) -> None:
        if isinstance(answer, Solved):
            answer = answer._replace(archive=reduction.recv_handle(connection))
        with self._changed:
            if isinstance(answer, Began):
                self._began = {answer.session: answer}  # only `_load` waits for it
            elif answer.session != self._session.number:
                self._forget(answer)
                return
            elif isinstance(answer, Solved):
                self._forget(self.newest)
                self.newest, self._deaths = answer, 0
            if isinstance(answer, (Solved, Failed)) and answer.number >= 0:
                self._last = answer.number
                if self._asked is not None and self._asked.number == answer.number:
                    self._asked = None
            self._changed.notify_all()
        if not isinstance(answer, Began):
            try:
                self._on_answer(answer)
            except Exception as error:
                reason = f"{type(error).__name__}: {one_line(error)}"
                self._on_answer(Failed(answer.session, -1, reason))

    @staticmethod
    def _forget(answer: Any) -> None:
        if isinstance(answer, Solved):
            os.close(answer.archive)


def _copied(path: Path) -> IO[bytes]:
    """Return a copy of a saved map, because saving this session replaces the file.

    Raises
    ------
    MapError, OutputError
        If there is no map, or it cannot be copied.
    """
    made = tempfile.TemporaryFile(prefix="tccm_map_")  # noqa: SIM115
    try:
        with path.open("rb") as file:
            shutil.copyfileobj(file, made, 1 << 20)
    except FileNotFoundError:
        raise MapError(f"{path}: no such map; ~/save_map writes one") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({one_line(error)})") from None
    made.flush()
    return made
