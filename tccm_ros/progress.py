"""Progress bars with rate and remaining time, or none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

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


class Bars(Protocol):
    """Progress bars of long-running work, one after another."""

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

    def advance(self, amount: float) -> None:
        """Advance the running bar by an amount, in its unit."""


class Silent:
    """Progress bars without output."""

    def start(self, name: str, total: float, unit: str = "") -> None:
        """Show nothing, with the arguments of `Bars.start`.

        Parameters
        ----------
        name, total, unit
            Ignored.
        """

    def advance(self, amount: float) -> None:
        """Show nothing."""


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


class _Shown:
    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._task: TaskID | None = None

    def start(self, name: str, total: float, unit: str = "") -> None:
        self._bars.start()
        self.finish()
        self._task = self._bars.add_task(name, total=total, unit=unit)

    def advance(self, amount: float) -> None:
        if self._task is not None:
            self._bars.advance(self._task, amount)

    def finish(self) -> None:
        if self._task is not None:
            self._bars.update(self._task, completed=self._bars.tasks[self._task].total)
            self._task = None


@contextmanager
def progress(quiet: bool = False) -> Iterator[Bars]:
    """Yield bars on standard error, or silent ones."""
    if quiet:
        yield Silent()
        return
    columns = (
        TextColumn("{task.description:<9}"),
        BarColumn(),
        TaskProgressColumn(),
        _Rate(),
        TimeRemainingColumn(),
    )
    bars = Progress(*columns, console=Console(stderr=True))
    shown = _Shown(bars)
    try:
        yield shown
        shown.finish()
    finally:
        if bars.live.is_started:  # stopping a bar that never started would print an empty line
            bars.stop()
