"""The interface of factors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import gtsam

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import Key


class Factor(Protocol):
    """A factor that can be added to a graph."""

    @property
    def landmark(self) -> Key | None:
        """The landmark that this factor can initialise; None for none."""

    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add the factor in GTSAM's form."""

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return start values of landmarks that have none yet."""


class NoLandmark:
    """Base of factors that initialise no variable."""

    @property
    def landmark(self) -> Key | None:
        """None."""
        return None

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return no start values."""
        return []
