"""The interface of factors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import gtsam

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import Key


class Factor(Protocol):
    """The interface by which a graph adds a factor."""

    @property
    def landmark(self) -> Key | None:
        """The landmark that this factor can start, if it has one."""

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add the GTSAM form."""

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return start values for landmarks that no other part of the graph starts."""


class NoLandmark:
    """Base of factors that start no variable."""

    @property
    def landmark(self) -> Key | None:
        """None."""
        return None

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start nothing."""
        return []
