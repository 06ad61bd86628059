"""The node's side of the process that reads door signs."""

from __future__ import annotations

import subprocess
import threading
from collections import Counter
from collections.abc import Callable
from multiprocessing.connection import Connection

from tccm_ros.config import Config
from tccm_ros.nodes.process.child_process import end, spawn
from tccm_ros.nodes.process.worker import Worker
from tccm_ros.sensors.camera_image import PosedPicture
from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement
from tccm_ros.signs.processor import SignProcessor

MAX_WAITING = 10
"""Length of the picture queue; new pictures are dropped beyond it. Chosen: 5 s of pictures."""

MAX_DEATHS = 3
"""After this many deaths without an answer, the process is not restarted."""

LOOK_S = 0.1
"""Polling period of the time limit, s."""

PictureResults = tuple[SearchedPicture | SignMeasurement, ...]
"""Results of a picture: a record of the search, and the signs found."""


class SignReader:
    """Sends selected pictures to the sign process and passes its measurements to the node.

    Only one thread, the node's worker, may call `offer`, `begin` and `after`. The process is
    started with the first picture.

    Parameters
    ----------
    config
        Group `signs`.
    on_signs
        Called with the results of each picture, in the reader's own thread.

    Attributes
    ----------
    counts
        Numbers of ``pictures`` read and ``signs`` found.
    dropped
        Counts of pictures that were not read, by reason.
    problem
        Reason why pictures cannot be read; empty if they can.
    """

    def __init__(self, config: Config, on_signs: Callable[[PictureResults], None]):
        self._config, self._on_signs = config, on_signs
        self._selector = SignProcessor(config)
        self._worker = Worker("signs", self._note_error)
        self._connection: Connection | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._session = 0
        self._deaths = 0
        self.counts: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self.problem = ""

    def offer(self, posed: PosedPicture) -> None:
        """Queue a picture for reading, if `signs.rate` allows it."""
        if not self._selector.selects(posed):
            self.dropped += self._selector.dropped
            self._selector.dropped.clear()
            return
        if self._worker.backlog >= MAX_WAITING:
            self.dropped["overload: pictures"] += 1
            return
        session = self._session
        self._worker.post(lambda: self._read(posed, session))

    def begin(self) -> None:
        """Discard the queued pictures, because a new map begins."""
        self._session += 1
        self._selector = SignProcessor(self._config)

    def after(self, job: Callable[[], None]) -> None:
        """Run a job after all pictures queued so far."""
        self._worker.post(job)

    def wait(self, is_over: Callable[[], bool]) -> None:
        """Return when all pictures queued so far are read, or time is up."""
        done = threading.Event()
        self._worker.post(done.set)
        while not done.wait(LOOK_S) and not is_over():
            pass

    def close(self) -> None:
        """End the process."""
        self._deaths = MAX_DEATHS
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:
            end(self._process)
        self._worker.close()

    def _read(self, posed: PosedPicture, session: int) -> None:
        if session != self._session or self._deaths >= MAX_DEATHS:
            return
        try:
            events, problem = self._answer(posed)
        except (EOFError, OSError):
            self._deaths += 1
            self._connection = None
            self.dropped["pictures at whose reading the process ended"] += 1
            if self._deaths == MAX_DEATHS:
                self.problem = "the process that reads door signs ended three times"
            return
        self._deaths, self.problem = 0, problem
        self.counts["pictures"] += bool(events)
        self.counts["signs"] += sum(type(event) is SignMeasurement for event in events)
        if session == self._session:
            self._on_signs(events)

    def _answer(self, posed: PosedPicture) -> tuple[PictureResults, str]:
        """Return the answer of the process (`process.answer_pictures`)."""
        if self._connection is None:
            self._connection = self._start()
        self._connection.send(posed)
        events, problem = self._connection.recv()
        return events, problem

    def _start(self) -> Connection:
        self._process, connection = spawn("tccm_ros.nodes.signs.process")
        connection.send(self._config.model_dump_json())
        return connection

    def _note_error(self, error: Exception) -> None:
        self.problem = str(error)
