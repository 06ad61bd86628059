"""Landmarks of any kind: the base class of their factors, and the registry of kinds.

A kind is one class of factors, in this package or outside, decorated with `register_landmark`.
Observations are added by ``WallSlam.add_landmark``. The landmarks are estimated with the
trajectory, and returned in ``Solution.landmarks``, the result files, the map and its picture.
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

OWN_LETTERS = frozenset("cosvwx")
"""Reserved letters, of the variables in `keys`."""


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkFactor(ABC):
    """One observation of a landmark from a pose of the base.

    A single observation must determine the landmark, at least weakly: if it does not (a bearing
    without a range), `add_to` must add a wide prior as well.

    Attributes
    ----------
    kind, letter
        Name of the kind, and the unique letter of its variables in the graph.
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
        """Add the factor in GTSAM's form."""

    @abstractmethod
    def start(self, T_map_base: Float64) -> Any:
        """Return the GTSAM value of the landmark from this observation alone."""

    def initial(self, pose_of: Callable[[Key], Float64]) -> list[tuple[Key, Any]]:
        """Return the landmark as seen by this observation as start value."""
        return [(self.landmark, self.start(pose_of(self.pose)))]

    @classmethod
    def position(
        cls, values: gtsam.Values, landmark: Key, covariance: Float64
    ) -> tuple[Float64, Float64]:
        """Return the position of a landmark in map, float64 (3,), with covariance (3, 3).

        Override it for kinds whose variable is not a ``gtsam.Point3``.

        Parameters
        ----------
        values
            Values of all variables.
        landmark
            Variable of the landmark.
        covariance
            Its marginal covariance, in GTSAM's tangent order.
        """
        return np.asarray(values.atPoint3(landmark.symbol)), covariance


Kind = TypeVar("Kind", bound=type[LandmarkFactor])

_KINDS: dict[str, type[LandmarkFactor]] = {}


def register_landmark(factor: Kind) -> Kind:
    """Register a kind of landmark; use it as decorator of the class.

    Raises
    ------
    ValueError
        For a letter that is in use.
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
