"""Where to look for loop closures, and what is found there.

Each third keyframe looks for itself in the submaps of earlier passes, within a window that grows
with the path since the two were last tied together. A session that starts at an unknown place in a
known map looks everywhere until it is tied.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.slam.correlation import correlate
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.loop_matching import COARSE_STEP, LoopReason, Proposal, Window, propose
from tccm_ros.slam.path_lengths import PathLengths
from tccm_ros.slam.se2 import between, compose
from tccm_ros.slam.submaps import Patch, Submap, make_patch, make_submap

__all__ = ["LoopSearch"]


QUERY_STEP = 3
"""Every third keyframe looks for loops: neighbours see the same."""

SUBMAP_STEP, SUBMAP_HALF, PATCH_HALF = 5, 10, 4
"""A submap of 21 keyframes each 5 keyframes (about 6 m each 1.5 m); 9 keyframes look."""

OVERLAP = 3.0
"""Places this near (m) see the same walls."""

MAX_PASSES = 3
"""Earlier passes that one keyframe is matched against."""

BASE_WINDOW = (0.25, 0.08)
"""Half width (m, rad) of the search where the graph is tight."""

MAX_TURN = 0.7
"""Largest half width in heading, rad, unless lost."""

LOST_STEP, LOST_REACH = 9, 2.0
"""When lost, each ninth keyframe looks around every other submap, this far (m)."""

SAME_PLACE = 1.0
"""Two matches that put the robot within this distance (m) name one place."""

LEAST_POINTS = 10
"""Points of a patch that can be matched at all."""

CACHED_SUBMAPS, CACHED_LOST = 60, 250
"""Submaps that are kept for the next keyframes, and while lost: 1 MB each."""

ROUGH_STEP = 4
"""Each fourth point of a search tells in which order to look everywhere."""


@dataclass(slots=True)
class LoopSearch:
    """The search in the submaps of all sessions; deterministic in the order of keyframes.

    Attributes
    ----------
    keyframes
        Of all sessions, shared with who adds to them.
    """

    config: Config
    keyframes: list[GraphKeyframe]
    _cache: dict[int, Submap] = field(default_factory=dict)

    def look(
        self, k: int, poses: Float64, lengths: PathLengths, tied: Collection[int]
    ) -> list[Proposal]:
        """Match keyframe `k`, the newest, where it may have been before.

        Parameters
        ----------
        k
            A keyframe; most do not look, because neighbours see the same.
        poses
            float64 (K, 3): where the keyframes are believed to be.
        lengths
            How well keyframes are tied to each other.
        tied
            The sessions that are in the map's frame; one that is not looks everywhere.

        Returns
        -------
        Proposals, those with a reason among them, which are none
        """
        is_lost = self.keyframes[k].session not in tied
        if k % (LOST_STEP if is_lost else QUERY_STEP):
            return []
        if is_lost:
            return self._look_everywhere(k, poses, tied)
        return self._look_nearby(k, poses, lengths)

    def _look_nearby(self, k: int, poses: Float64, lengths: PathLengths) -> list[Proposal]:
        """Match keyframe k against the submaps of earlier passes."""
        candidates = self._candidates(k, poses, lengths)
        patch = make_patch(self.keyframes, k, PATCH_HALF) if candidates else None
        if patch is None or len(patch.points) < LEAST_POINTS:
            return []
        found = [propose(self._submap(c), patch, w, self.config) for c, w in candidates]
        return [proposal for proposal in found if proposal is not None]

    def _look_everywhere(self, k: int, poses: Float64, tied: Collection[int]) -> list[Proposal]:
        """Match keyframe k against the whole map; return the best place unless another is near."""
        patch = make_patch(self.keyframes, k, PATCH_HALF)
        best: list[Proposal] = []
        if len(patch.points) < LEAST_POINTS:
            return best
        share = self.config.loops.ambiguity
        for centre in self._likely_first(patch, self._other_sessions(k, tied)):
            least = share * best[0].score if best else 0.0
            window = Window(np.zeros(3), LOST_REACH, np.pi, least)
            found = propose(self._submap(centre, CACHED_LOST), patch, window, self.config)
            if found is not None and not found.reason:
                best = sorted([*best, found], key=lambda p: -p.score)
        rivals = [p for p in best[1:] if p.score >= share * best[0].score]
        if any(not _is_same_place(best[0], p, poses) for p in rivals):
            return [replace(best[0], reason=LoopReason.TWO_PLACES_IN_MAP)]
        return best[:1]

    def _likely_first(self, patch: Patch, centres: list[int]) -> list[int]:
        """Return submap centres in the order of a rough match.

        The right place, found early, sets the score below which the search elsewhere stops.
        """
        span, step = (LOST_REACH, float(np.pi)), 2.0 * COARSE_STEP
        some = np.ascontiguousarray(patch.search_points[::ROUGH_STEP])
        scores = []
        for centre in centres:
            grid = self._submap(centre, CACHED_LOST).grid
            scores.append(correlate(grid, some, np.zeros(3), span, angle_step=step).score)
        return [centres[i] for i in np.argsort(-np.array(scores), kind="stable")]

    def _candidates(self, k: int, poses: Float64, lengths: PathLengths) -> list[tuple[int, Window]]:
        """Return submap centres of earlier passes near k, and where to look in each."""
        loops = self.config.loops
        centres = np.arange(SUBMAP_HALF, k - SUBMAP_HALF, SUBMAP_STEP)
        path = lengths.driven
        centres = centres[path[k] - path[centres] >= loops.min_path]
        if not len(centres):
            return []
        away = np.hypot(*(poses[centres, :2] - poses[k, :2]).T)
        if not (away <= OVERLAP + loops.max_window).any():
            return []
        tied = lengths.until(k)[centres]
        reach = np.minimum(loops.max_window, BASE_WINDOW[0] + loops.drift * tied)
        turn = np.minimum(MAX_TURN, BASE_WINDOW[1] + loops.drift_angle * tied)
        eligible = np.flatnonzero((away <= OVERLAP + reach) & np.isfinite(tied))
        passes = np.split(eligible, np.flatnonzero(np.diff(eligible) > 1) + 1)
        best = [int(p[np.argmin(away[p])]) for p in passes if len(p)]
        best.sort(key=lambda i: (away[i], i))
        return [
            (
                int(centres[i]),
                Window(between(poses[centres[i]], poses[k]), float(reach[i]), float(turn[i])),
            )
            for i in best[:MAX_PASSES]
        ]

    def _other_sessions(self, k: int, tied: Collection[int]) -> list[int]:
        """Return every other submap centre of the map."""
        session = self.keyframes[k].session
        return [
            c
            for c in range(SUBMAP_HALF, k - SUBMAP_HALF, 2 * SUBMAP_STEP)
            if self.keyframes[c].session != session and self.keyframes[c].session in tied
        ]

    def _submap(self, centre: int, most: int = CACHED_SUBMAPS) -> Submap:
        if centre not in self._cache:
            while len(self._cache) >= most:
                del self._cache[next(iter(self._cache))]
            self._cache[centre] = make_submap(self.keyframes, centre, SUBMAP_HALF)
        return self._cache[centre]


def _is_same_place(one: Proposal, other: Proposal, poses: Float64) -> bool:
    a = compose(poses[one.a], one.delta)
    b = compose(poses[other.a], other.delta)
    return bool(np.hypot(a[0] - b[0], a[1] - b[1]) < SAME_PLACE)
