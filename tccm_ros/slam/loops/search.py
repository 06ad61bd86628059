"""Search for loop closures: candidate submaps, windows and matches.

Every third keyframe is matched with the submaps of earlier passes, within a window that grows with
the path since the two were last constrained to each other. A session that starts at an unknown pose
in a saved map is matched with the whole map, scan by scan, until it is localised.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.loops.matching import COARSE_STEP, LoopReason, Proposal, Window, propose
from tccm_ros.slam.loops.path_lengths import PathLengths
from tccm_ros.slam.loops.submaps import MergedScan, Submap, make_submap, merge_scans
from tccm_ros.slam.matching.alignment import seen_through
from tccm_ros.slam.matching.correlation import correlate
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.se2 import between_se2, compose_se2

QUERY_STEP = 3
"""Every third keyframe is matched: neighbouring keyframes have similar views (chosen)."""

SUBMAP_STEP, SUBMAP_HALF, MERGED_HALF = 5, 10, 4
"""Keyframes between submaps, and on either side of the centre of each and of a merged scan: submaps
of 21 keyframes every 5 keyframes (6 m every 1.5 m), merged scans of 9 keyframes (chosen)."""

OVERLAP = 3.0
"""Distance (m) below which keyframes observe the same walls (chosen)."""

MAX_PASSES = 3
"""Maximum number of earlier passes matched per keyframe (chosen)."""

BASE_WINDOW = (0.25, 0.08)
"""Half width (m, rad) of the search directly after a loop closure (chosen)."""

MAX_YAW_WINDOW = 0.7
"""Maximum half width of the search in yaw, rad, unless lost (chosen)."""

LOST_WINDOW = 2.0
"""When lost, scans are matched with every other submap, in windows of this half width, m."""

SAME_POSITION = 1.0
"""Distance (m) between the results of two matches below which they are the same place (chosen)."""

MIN_POINTS = 10
"""Minimum number of points of a merged scan (chosen)."""

CACHED_SUBMAPS, CACHED_LOST = 60, 250
"""Number of cached submaps, normally and while lost: 1 MB each (chosen)."""

ROUGH_STEP = 4
"""Every fourth point of a merged scan is used to rank submaps while lost (chosen)."""


@dataclass(slots=True)
class LoopSearch:
    """Loop closure search in the submaps of all sessions; deterministic for an order of keyframes.

    Attributes
    ----------
    config
        Groups ``loops`` and ``matching``.
    keyframes
        Keyframes of all sessions; the `KeyframeChain` appends to this list.
    """

    config: Config
    keyframes: list[GraphKeyframe]
    _cache: dict[int, Submap] = field(default_factory=dict)

    def match_earlier_passes(self, k: int, poses: Float64, lengths: PathLengths) -> list[Proposal]:
        """Match keyframe `k`, the newest, with submaps that may contain the same walls.

        Parameters
        ----------
        k
            Index of a keyframe; two of three are skipped, as neighbours have similar views.
        poses
            float64 (K, 3), estimates of the keyframes.
        lengths
            Path lengths between keyframes.

        Returns
        -------
        list of Proposal
            Proposals; those with a reason are rejected.
        """
        return [] if k % QUERY_STEP else self._match(k, self._candidates(k, poses, lengths))

    def match_around(
        self,
        k: int,
        guess: Window,
        poses: Float64,
        localised: Collection[int],
        lengths: PathLengths | None = None,
    ) -> list[Proposal]:
        """Match keyframe `k` with submaps around an expected pose, from a user or a sign.

        Parameters
        ----------
        k
            The newest keyframe.
        guess
            Expected pose in map, and search window.
        poses
            float64 (K, 3), estimates of the keyframes.
        localised
            Sessions in the map's frame.
        lengths
            Path lengths, to exclude submaps of the path just driven. None: no exclusion.

        Returns
        -------
        list of Proposal
            The match with the best score, if it is not rejected.
        """
        centres = [
            c
            for c in range(0, k, SUBMAP_STEP)
            if self.keyframes[c].session in localised
            and np.hypot(*(poses[c, :2] - guess.centre[:2])) <= OVERLAP + guess.half_width_m
            and (lengths is None or self._is_earlier_pass(c, k, lengths))
        ]
        centres.sort(key=lambda c: (float(np.hypot(*(poses[c, :2] - guess.centre[:2]))), c))
        near = [
            (c, replace(guess, centre=between_se2(poses[c], guess.centre)))
            for c in centres[:MAX_PASSES]
        ]
        fit = [p for p in self._match(k, near) if not p.reason]
        return [max(fit, key=lambda p: p.score)] if fit else []

    def _is_earlier_pass(self, c: int, k: int, lengths: PathLengths) -> bool:
        is_other = self.keyframes[c].session != self.keyframes[k].session
        driven = float(lengths.driven[k] - lengths.driven[c])
        return is_other or driven >= self.config.loops.min_path

    def _match(self, k: int, candidates: Sequence[tuple[int, Window]]) -> list[Proposal]:
        """Match keyframe k with submaps, each given by its centre and a window."""
        merged = merge_scans(self.keyframes, k, MERGED_HALF) if candidates else None
        if merged is None or len(merged.points) < MIN_POINTS:
            return []
        found = [propose(self._submap(c), merged, w, self.config) for c, w in candidates]
        return [proposal for proposal in found if proposal is not None]

    def match_everywhere(
        self, k: int, merged: MergedScan, poses: Float64, localised: Collection[int]
    ) -> list[Proposal]:
        """Match a merged scan with the whole map; return the best place, a reason if ambiguous.

        Parameters
        ----------
        k
            The newest keyframe, whose session is excluded.
        merged
            Merged scan around that keyframe, or around a later scan.
        poses
            float64 (K, 3), estimates of the keyframes.
        localised
            Sessions in the map's frame, to be searched.
        """
        best: list[Proposal] = []
        unfit: list[Proposal] = []
        if len(merged.points) < MIN_POINTS:
            return best
        ratio = self.config.loops.ambiguity
        for centre in self._likely_first(merged, self._other_sessions(k, localised)):
            min_score = ratio * best[0].score if best else 0.0
            window = Window(np.zeros(3), LOST_WINDOW, np.pi, min_score)
            found = propose(self._submap(centre, CACHED_LOST), merged, window, self.config)
            if found is not None and not found.reason:
                best = sorted([*best, found], key=lambda p: -p.score)
            elif found is not None:
                unfit.append(found)
        if not best:
            return sorted(unfit, key=lambda p: -p.score)[:1]
        rivals = [p for p in (*best[1:], *unfit) if p.score >= ratio * best[0].score]
        if any(not is_same_place(best[0], p, poses) for p in rivals):
            return [replace(best[0], reason=LoopReason.TWO_PLACES_IN_MAP)]
        return best[:1]

    def agreement(self, proposal: Proposal, scan: LevelScan) -> float:
        """Return how well a scan agrees with the map at the place of a proposal, -1..1.

        The fraction of matched points, minus the fraction of confirmed surfaces in view that the
        scan sees through.
        """
        lines = self._submap(proposal.a, CACHED_LOST).lines
        return proposal.inliers - seen_through(proposal.delta, scan, lines)

    def _likely_first(self, merged: MergedScan, centres: list[int]) -> list[int]:
        """Return submap centres ranked by a coarse match.

        Finding the right place early bounds the search in the other submaps.
        """
        span, step = (LOST_WINDOW, float(np.pi)), 2.0 * COARSE_STEP
        some = np.ascontiguousarray(merged.search_points[::ROUGH_STEP])
        scores = []
        for centre in centres:
            grid = self._submap(centre, CACHED_LOST).grid
            scores.append(correlate(grid, some, np.zeros(3), span, angle_step=step).score)
        return [centres[i] for i in np.argsort(-np.array(scores), kind="stable")]

    def _candidates(self, k: int, poses: Float64, lengths: PathLengths) -> list[tuple[int, Window]]:
        """Return submap centres of earlier passes near k, each with a search window."""
        loops = self.config.loops
        centres = np.arange(SUBMAP_HALF, k - SUBMAP_HALF, SUBMAP_STEP)
        path = lengths.driven
        centres = centres[path[k] - path[centres] >= loops.min_path]
        if not len(centres):
            return []
        away = np.hypot(*(poses[centres, :2] - poses[k, :2]).T)
        if not (away <= OVERLAP + loops.max_window).any():
            return []
        path_between = lengths.shortest_to(k)[centres]
        half_width_m = np.minimum(loops.max_window, BASE_WINDOW[0] + loops.drift * path_between)
        half_width_rad = np.minimum(
            MAX_YAW_WINDOW, BASE_WINDOW[1] + loops.drift_angle * path_between
        )
        eligible = np.flatnonzero((away <= OVERLAP + half_width_m) & np.isfinite(path_between))
        passes = np.split(eligible, np.flatnonzero(np.diff(eligible) > 1) + 1)
        best = [int(p[np.argmin(away[p])]) for p in passes if len(p)]
        best.sort(key=lambda i: (away[i], i))
        return [
            (
                int(centres[i]),
                Window(
                    between_se2(poses[centres[i]], poses[k]),
                    float(half_width_m[i]),
                    float(half_width_rad[i]),
                ),
            )
            for i in best[:MAX_PASSES]
        ]

    def _other_sessions(self, k: int, localised: Collection[int]) -> list[int]:
        """Return every other submap centre of the sessions in the map's frame."""
        members: dict[int, list[int]] = {}
        for keyframe in self.keyframes[:k]:
            if keyframe.session in localised:
                members.setdefault(keyframe.session, []).append(keyframe.id)
        members.pop(self.keyframes[k].session, None)
        return [
            c
            for ids in members.values()
            for c in ids[min(SUBMAP_HALF, len(ids) // 2) :: 2 * SUBMAP_STEP]
        ]

    def _submap(self, centre: int, max_submaps: int = CACHED_SUBMAPS) -> Submap:
        if centre not in self._cache:
            while len(self._cache) >= max_submaps:
                del self._cache[next(iter(self._cache))]
            self._cache[centre] = make_submap(self.keyframes, centre, SUBMAP_HALF)
        return self._cache[centre]


def is_same_place(one: Proposal, other: Proposal, poses: Float64) -> bool:
    """Return whether two proposals give their keyframe the same place; poses float64 (K, 3)."""
    a = compose_se2(poses[one.a], one.delta)
    b = compose_se2(poses[other.a], other.delta)
    return bool(np.hypot(a[0] - b[0], a[1] - b[1]) < SAME_POSITION)
