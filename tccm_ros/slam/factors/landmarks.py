"""Landmarks of any kind: the base class of their factors, and the registry of kinds.

A kind is one class of factors. Whoever writes one, in this package or outside, decorates it with
`register_landmark` and hands its observations to ``WallSlam.add_landmark``: it is estimated with
the trajectory, and comes back in ``Solution.landmarks``, the result files, the map and its picture.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import Key

OWN_LETTERS = frozenset("cfosvwx")
"""Letters of the variables in `keys`."""


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkFactor(ABC):
    """One observation of a landmark, from a pose of the base.

    A single observation must determine its landmark, if only weakly: where it does not (a bearing
    without a range), `add_to` adds a wide prior as well.

    Attributes
    ----------
    kind, letter
        The kind's name, and the letter of its variables in the graph, which no other kind has.
    pose, landmark
        Variables: the base at the stamp, a planar ``gtsam.Pose3``, and the landmark.
    measurement, covariance
        float64 (N,) and (N, N), the measurement in the base frame, as the kind defines it.
    """

    kind: ClassVar[str]
    letter: ClassVar[str]
    pose: Key
    landmark: Key
    measurement: Float64
    covariance: Float64

    @abstractmethod
    def add_to(self, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add the GTSAM form."""

    @abstractmethod
    def start(self, T_map_base: Float64) -> Any:
        """Return the landmark's GTSAM value as this observation alone has it."""

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Start the landmark where the first of its observations sees it."""
        return [(self.landmark, self.start(pose_of(self.pose)))]

    @classmethod
    def position(
        cls, values: gtsam.Values, landmark: Key, covariance: Float64
    ) -> tuple[Float64, Float64]:
        """Return the position of a landmark in map, float64 (3,), with covariance (3, 3).

        A kind whose variable is not a ``gtsam.Point3`` overrides it.

        Parameters
        ----------
        values
            Of all variables.
        landmark
            The variable.
        covariance
            Its marginal covariance, in GTSAM's tangent order.
        """
        return np.asarray(values.atPoint3(landmark.symbol)), covariance


Kind = TypeVar("Kind", bound=type[LandmarkFactor])

_KINDS: dict[str, type[LandmarkFactor]] = {}


def register_landmark(factor: Kind) -> Kind:
    """Register a kind of landmark; the decorator of its class.

    Raises
    ------
    ValueError
        For a letter that names other variables.
    """
    others = {k.letter for k in _KINDS.values() if k.kind != factor.kind}
    if len(factor.letter) != 1 or factor.letter in others | OWN_LETTERS:
        raise ValueError(f"landmark '{factor.kind}': the letter '{factor.letter}' is taken")
    _KINDS[factor.kind] = factor
    return factor


def landmark_class(kind: str) -> type[LandmarkFactor]:
    """Return the class of a kind.

    Raises
    ------
    ValueError
        For a kind that was not registered.
    """
    if kind not in _KINDS:
        known = ", ".join(sorted(_KINDS)) or "none"
        raise ValueError(f"no landmark of kind '{kind}' is registered (known: {known})")
    return _KINDS[kind]
