"""Confirmation of a place in a saved map: successive searches of the whole map that agree.

A room of the same form elsewhere matches most of a scan, but the scan sees through its other walls,
and it matches only until the robot leaves the room.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.loops.consistency import consistent_with
from tccm_ros.slam.loops.matching import Proposal

CERTAIN_AGREEMENT = 0.9
"""A search with this agreement suffices: fraction of matched points, minus the fraction of mapped
surfaces in view that the scan sees through. ``bench/bench_relocalise.py``: at most 0.80 in a map of
other rooms."""

CONFIRMED_M = 2.5
"""Path (m) over which all searches must give one place otherwise. ``bench/bench_relocalise.py``: at
most 1.3 m in a map of other rooms, 3.8 to 19.5 m in a real arena with moved furniture."""


@dataclass(slots=True)
class PlaceConfirmation:
    """Confirmation of the place of one session.

    Attributes
    ----------
    is_ambiguous
        Whether a search with `CERTAIN_AGREEMENT` had several results: the map has places that one
        scan cannot distinguish, so that twice the confirmation is needed.
    """

    is_ambiguous: bool = False
    _agreeing: list[tuple[Proposal, bool]] = field(default_factory=list)

    def add(
        self,
        found: Proposal | None,
        agreement: float,
        poses: Float64,
        path: Sequence[float] | Float64,
    ) -> list[Proposal]:
        """Add the result of a search; return the proposals to accept, empty until they suffice.

        Parameters
        ----------
        found
            The place with the best score; None if nothing matches.
        agreement
            Its agreement with the scan, -1..1.
        poses
            float64 (K, 3), estimates of the keyframes.
        path
            Path length up to each keyframe, m.
        """
        is_certain = agreement >= CERTAIN_AGREEMENT
        if found is None or found.reason:
            self._agreeing = []
            self.is_ambiguous |= found is not None and found.is_ambiguous and is_certain
            return []
        if self._agreeing:
            previous = self._agreeing[-1][0]
            if not consistent_with(found, [previous], poses, path)[0]:
                self._agreeing = []
        self._agreeing.append((found, is_certain))
        # Rotation in place shows no other surroundings, so that only translation counts.
        spots = poses[[proposal.b for proposal, _ in self._agreeing], :2]
        driven_m = float(np.hypot(*np.diff(spots, axis=0).T).sum())
        certain = sum(is_certain for _, is_certain in self._agreeing)
        if certain + driven_m / CONFIRMED_M < 1 + self.is_ambiguous:
            return []
        first = self._agreeing[0][0]
        return [first, found] if first.b != found.b else [found]
