"""Another program that drives the base to a staging pose, such as Nav2."""

from __future__ import annotations

from typing import Protocol

from tccm_ros.arrays import Float64


class Navigator(Protocol):
    """Drives the base to one pose at a time; meanwhile nothing else may send it commands."""

    @property
    def is_active(self) -> bool:
        """Whether it drives the base, also while it ends a cancelled drive."""
        ...

    @property
    def failure(self) -> str:
        """Why the last drive failed; empty if it succeeded or `cancel` ended it."""
        ...

    def start(self, pose: Float64) -> None:
        """Start a drive to a pose float64 (3,), in map."""
        ...

    def cancel(self) -> None:
        """Cancel the drive, if there is one; `is_active` shows when it has ended."""
        ...
