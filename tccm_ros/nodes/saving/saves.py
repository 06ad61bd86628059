"""Automatic saves: at intervals, and at the end of the process."""

from __future__ import annotations

from collections.abc import Callable

from tccm_ros.errors import MapError, TccmError, one_line
from tccm_ros.nodes.process.ending import Ending


class Saves:
    """Runs automatic saves; logs consecutive failures with the same reason once.

    Parameters
    ----------
    name
        Name of the node.
    warn
        Logs a line.
    """

    def __init__(self, name: str, warn: Callable[[str], object]):
        self._name, self._warn = name, warn
        self._reason = ""

    def attempt(self, save: Callable[[], object]) -> None:
        """Save at an interval; log a failure without raising it."""
        try:
            save()
            self._reason = ""
        except TccmError as error:
            self._log(error)

    def at_end(
        self, save: Callable[[], str], ending: Ending, run: Callable[[Callable[[], None]], object]
    ) -> None:
        """Save at the end of the process; any error but an empty map is recorded as a failure.

        Recorded as failed until the save completes, unless an earlier save succeeded, because the
        process may exit first.

        Parameters
        ----------
        save
            Returns a sentence about the saved files.
        ending
            Record of the saves.
        run
            Runs the save and waits for it, for example in another thread.
        """
        if self._name not in ending.saved:
            ending.failed[self._name] = "the save did not finish"

        def attempt() -> None:
            try:
                ending.saved[self._name] = save()
                ending.failed.pop(self._name, None)
            except MapError as error:
                ending.failed.pop(self._name, None)
                self._log(error)
            except Exception as error:
                ending.failed[self._name] = one_line(error)

        run(attempt)

    def _log(self, error: Exception) -> None:
        reason = one_line(error)
        if reason != self._reason:
            self._reason = reason
            self._warn(f"not saved: {reason}")
