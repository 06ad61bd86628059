"""Progress bars with rate and remaining time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        if speed is None:
            return Text("")
        if task.fields["unit"] == "s":  # seconds of a recording per second
            return Text(f"{speed:.1f} x real time")
        if speed < 1.0 and task.fields["unit"] != "%":  # tasks that take longer than a second
            return Text(f"{60.0 * speed:.1f} {task.fields['unit']}/min")
        return Text(f"{speed:.0f} {task.fields['unit']}/s")


class Bars:
    """Progress bars of long-running work on standard error, one after another.

    Parameters
    ----------
    quiet
        Whether nothing is shown.
    """

    def __init__(self, quiet: bool = True) -> None:
        self._shown = Progress(
            TextColumn("{task.description:<9}"),
            BarColumn(),
            TaskProgressColumn(),
            _Rate(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            disable=quiet,
        )
        self._task: TaskID | None = None

    def start(self, name: str, total: float, unit: str = "") -> None:
        """Start a bar; a running one is finished first.

        Parameters
        ----------
        name
            Text before the bar.
        total
            Amount of a full bar, in `unit`.
        unit
            Unit of the displayed rate; ``s`` for seconds of a recording.
        """
        self._shown.start()
        self.finish()
        self._task = self._shown.add_task(name, total=total, unit=unit)

    def advance(self, amount: float) -> None:
        """Advance the running bar by an amount, in its unit."""
        if self._task is not None:
            self._shown.advance(self._task, amount)

    def finish(self) -> None:
        """Fill the running bar."""
        if self._task is not None:
            self._shown.update(self._task, completed=self._shown.tasks[self._task].total)
            self._task = None

    def stop(self) -> None:
        """End the display."""
        if self._shown.live.is_started:  # else, an empty line would be printed
            self._shown.stop()


class FractionBar:
    """A bar for work that reports its completed fraction.

    Parameters
    ----------
    bars
        Progress bars.
    name
        Text before the bar.
    """

    def __init__(self, bars: Bars, name: str):
        self._bars, self._done = bars, 0.0
        bars.start(name, 100.0, "%")

    def __call__(self, fraction: float) -> None:
        """Report the completed fraction, 0 to 1."""
        self._bars.advance(100.0 * (fraction - self._done))
        self._done = fraction


@contextmanager
def progress(quiet: bool = False) -> Iterator[Bars]:
    """Yield bars, which are full if no error was raised."""
    bars = Bars(quiet)
    try:
        yield bars
        bars.finish()
    finally:
        bars.stop()
