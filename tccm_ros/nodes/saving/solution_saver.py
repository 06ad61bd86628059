"""Saves the newest solution of the process that solves, in a thread of its own."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rclpy.node import Node
from rclpy.task import Future

from tccm_ros.errors import MapError, OutputError
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.process.worker import Worker, promise
from tccm_ros.nodes.saving.map_folder import MapKeeper
from tccm_ros.nodes.saving.saves import Saves
from tccm_ros.nodes.solver.channel import Solved
from tccm_ros.nodes.solver.solver import Solver

PATIENCE_S = 1.2
"""A save waits so long for the solution with all that has come; then it takes the newest."""

MAX_PATIENCE_S = 10.0
"""Maximum time that a save waits. ``bench/soak.py bag``: on a machine with seven times more work
than cores, where a solution took 230 s, a save waited for 470 s without this."""

LOOK_AT_END_S = 0.1
"""Interval of checks whether the wait for a solution is over, s. Chosen: below `PATIENCE_S`."""


class Wanted(NamedTuple):
    """Input that a saved map should contain.

    Attributes
    ----------
    stamp_ns
        Of the newest record, ns.
    number
        Of the first solution with all records.
    """

    stamp_ns: int
    number: int


class Session(NamedTuple):
    """State of the tracker, with which a solution must agree.

    Attributes
    ----------
    resets
        How often the map began anew.
    keyframes
        How many there are.
    waits_for_scan
        Whether a map was loaded and no scan has come since.
    """

    resets: int
    keyframes: int
    waits_for_scan: bool


def patience_s(duration_s: float) -> float:
    """Return how long a save waits, s, where the last solution took `duration_s`.

    Another one may be under way, which is as long.
    """
    return min(PATIENCE_S + 2.0 * duration_s, MAX_PATIENCE_S)


class SolutionSaver:
    """Saves solutions on request, at intervals and at the end.

    Parameters
    ----------
    solver
        Has the solutions.
    session
        Returns the state of the tracker.
    saves
        Handles failures of saves that nobody requested.
    on_named
        Called with the name of a map that was saved under it.
    on_error
        Called with exceptions of the thread.
    """

    def __init__(
        self,
        solver: Solver,
        session: Callable[[], Session],
        saves: Saves,
        on_named: Callable[[str], None],
        on_error: Callable[[Exception], None],
    ):
        self._solver, self._session, self._saves = solver, session, saves
        self._on_named = on_named
        self._keeper = MapKeeper()
        self._worker = Worker("saver", on_error)
        self._is_ending = threading.Event()

    def close(self) -> None:
        """Finish the queued saves and end the thread."""
        self._worker.close()

    def forget(self) -> None:
        """Begin another map: saved ones belong to another session from now on."""
        self._keeper.forget()

    def adopt(self, folder: Path) -> None:
        """Go on with the map of a folder, which this session may replace."""
        self._keeper.adopt(folder)

    def begin(
        self,
        node: Node,
        folder: Path,
        ask: Callable[[Callable[[Wanted], None]], None],
        *,
        is_named: bool = False,
    ) -> Future:
        """Save the solution with all input so far, or the newest one if that takes too long.

        Parameters
        ----------
        node
            Its service callback awaits the returned future, a sentence.
        folder
            Files of the same names are replaced.
        ask
            Requests a solution, and passes on the input that it will contain.
        is_named
            Whether the folder's name is the map's: then any map in it is replaced.
        """
        asked: list[Wanted] = []

        def save() -> str:
            newest = self._solver.newest if self._has_solution else None
            wait_s = math.inf if newest is None else patience_s(newest.duration_s)
            end_s = time.monotonic() + wait_s
            self._wait(
                asked[0].number, lambda: self._is_ending.is_set() or time.monotonic() > end_s
            )
            said = self._save(folder, asked[0], is_asked=True, may_replace=is_named)
            if is_named:
                self._on_named(folder.name)
            return said

        def note(wanted: Wanted) -> None:
            asked.append(wanted)
            self._worker.post(run)

        saved, run = promise(save, node)
        ask(note)
        return saved

    def autosave(self, folder: Path, wanted: Wanted) -> None:
        """Save the newest solution as it is."""
        save = partial(self._save, folder, wanted, is_asked=False)
        self._worker.post(lambda: self._saves.attempt(save))

    def save_quickly(self, folder: Path, wanted: Wanted, ending: Ending) -> None:
        """Save the newest solution at once, if there is one, as the process ends."""
        if self._has_solution:
            self.save_at_end(folder, wanted, ending)

    def save_at_end(self, folder: Path, wanted: Wanted, ending: Ending) -> None:
        """Save the newest solution as the process ends; saves that wait for another one go on."""
        self._is_ending.set()
        save = partial(self._save, folder, wanted, is_asked=False, is_last=True)
        self._saves.at_end(save, ending, self._worker.wait)

    def wait(self, number: int, ending: Ending) -> bool:
        """Wait for a solution until the process has to end; return whether it has come."""
        return self._wait(number, lambda: ending.is_over)

    def _wait(self, number: int, is_over: Callable[[], bool]) -> bool:
        """Wait for a solution; return whether it came before `is_over`."""
        while not self._solver.wait(number, LOOK_AT_END_S):
            if is_over():
                return False
        return True

    @property
    def _has_solution(self) -> bool:
        newest = self._solver.newest
        return newest is not None and newest.resets == self._session().resets

    def _save(
        self,
        folder: Path,
        wanted: Wanted,
        *,
        is_asked: bool,
        may_replace: bool = False,
        is_last: bool = False,
    ) -> str:
        """Save the newest solution; return a sentence that names it, and input that it lacks.

        Parameters
        ----------
        folder, is_asked, is_last
            As for `MapKeeper.save`.
        wanted
            Input that should be in it.
        may_replace
            Whether any map may be replaced.

        Raises
        ------
        MapError, OutputError
            Where that is not to be, or cannot be done.
        """
        session = self._session()
        if session.waits_for_scan:
            raise MapError("no level scan since the map was loaded: there is nothing new to save")
        newest = self._solver.archive()
        if newest is None:
            kind = OutputError if is_last and session.keyframes else MapError
            raise kind(f"{folder}: not written, there is no solution yet")
        solved, archive = newest
        try:
            if solved.resets != session.resets:
                raise MapError(f"{folder}: not written, no solution since the map began anew")
            keeper = MapKeeper(may_replace=True) if may_replace else self._keeper
            folder = keeper.save(
                archive, solved.content, folder, is_asked=is_asked, is_last=is_last
            )
        finally:
            os.close(archive)
        up_to = f"up to {solved.stamp_ns * 1e-9:.3f} s, " if solved.stamp_ns else ""
        return (
            f"{folder}: solution {solved.number}, {up_to}{solved.content}{_lacking(solved, wanted)}"
        )


def _lacking(solved: Solved, wanted: Wanted) -> str:
    """Return which input a solution lacks."""
    if wanted.stamp_ns and not solved.stamp_ns:
        return "; nothing of this drive is in it, only the map that was loaded"
    late_s = max(wanted.stamp_ns - solved.stamp_ns, 0) * 1e-9
    if late_s:
        return f"; the last {late_s:.1f} s of records are not in it"
    # A view may come last and be older than the scans that were solved.
    return "; the newest records are not in it" if solved.number < wanted.number else ""
