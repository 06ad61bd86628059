"""Loop closure: where to look, what to believe, and the record of both.

Keyframes are taken in order. Each third looks for itself in the submaps of earlier passes, within a
window that grows with the path since the two were last tied together. A match is only a proposal:
it becomes a factor when others, from other keyframes, close the same cycle. The estimate follows at
once, so that the next windows are small. A session that starts at an unknown place in a known map
looks everywhere until it is tied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.correlation import correlate
from tccm_ros.slam.factors import BetweenKeyframes, Key
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.graph import IncrementalGraph
from tccm_ros.slam.loop_consistency import consistent_with
from tccm_ros.slam.loop_proposals import COARSE_STEP, Proposal, Window, propose
from tccm_ros.slam.path_lengths import lengths_from
from tccm_ros.slam.se2 import between, compose, inverse
from tccm_ros.slam.submaps import Patch, Submap, make_patch, make_submap

__all__ = ["LoopCloser", "loop_factor"]

Float64 = NDArray[np.float64]

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

NEIGHBOURHOOD = 15.0
"""Path (m) on either side within which proposals confirm each other."""

MOVED = (0.08, 0.015)
"""A loop closure that contradicts the estimate by more (m, rad) moves all keyframes at once."""

LOOP_LENGTH = 0.5
"""A loop closure ties its ends at best as well as this much path (m)."""

CACHED_SUBMAPS, CACHED_LOST = 60, 250
"""Submaps that are kept for the next keyframes, and while lost: 1 MB each."""

BATCH = 10
"""Keyframes that wait for each other before the live graph takes them: an update costs the same for
one as for a few."""

ROUGH_STEP = 4
"""Each fourth point of a search tells in which order to look everywhere."""


def loop_factor(proposal: Proposal, keys: Sequence[Key], weight: float = 1.0) -> BetweenKeyframes:
    """Return the factor of a proposal."""
    a, b = keys[proposal.a], keys[proposal.b]
    return BetweenKeyframes(a, b, proposal.delta, proposal.cov, weight)


def _lengths_of(loops: Sequence[Proposal], drift: float) -> Float64:
    """Return the path (m) that ties as well as each loop does in its weakest direction, (L,)."""
    return np.array([max(LOOP_LENGTH, p.spread**0.5 / drift) for p in loops])


def _ends_of(loops: Sequence[Proposal]) -> NDArray[np.int64]:
    """Return the keyframes that loops tie, int64 (L, 2)."""
    return np.array([(p.a, p.b) for p in loops], np.int64).reshape(-1, 2)


@dataclass(slots=True)
class LoopCloser:
    """The search, keyframe by keyframe; deterministic in their order.

    Attributes
    ----------
    keyframes, chain
        Of all sessions, shared with who adds to them.
    poses
        float64 (K, 3): where the keyframes are believed to be. Those of a session that is not
        tied yet are in that session's own frame.
    accepted, rejected
        Proposals, in order of discovery.
    """

    config: Config
    keyframes: list[GraphKeyframe]
    chain: Chain
    poses: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    accepted: list[Proposal] = field(default_factory=list)
    rejected: list[Proposal] = field(default_factory=list)
    _graph: IncrementalGraph = field(default_factory=lambda: IncrementalGraph(relinearize_skip=1))
    _waiting: list[int] = field(default_factory=list)
    _fresh: list[Proposal] = field(default_factory=list)
    _tied: set[int] = field(default_factory=lambda: {0})
    _recent: list[Proposal] = field(default_factory=list)
    _pending: list[Proposal] = field(default_factory=list)
    _steps: Float64 = field(default_factory=lambda: np.zeros(0))
    _path: Float64 = field(default_factory=lambda: np.zeros(0))
    _ends: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    _ties: Float64 = field(default_factory=lambda: np.zeros(0))
    _cache: dict[int, Submap] = field(default_factory=dict)

    @property
    def unconfirmed(self) -> list[Proposal]:
        """Proposals that wait for others to confirm them."""
        return [replace(p, reason="no other match confirms it") for p in self._pending]

    @property
    def tied(self) -> frozenset[int]:
        """The sessions that are in the map's frame."""
        return frozenset(self._tied)

    def add(self, k: int) -> None:
        """Take keyframe `k`, the newest."""
        keyframe = self.keyframes[k]
        starts = k == 0 or self.keyframes[k - 1].session != keyframe.session
        pose = keyframe.pose if starts else compose(self.poses[-1], keyframe.delta)
        self._append(keyframe, pose)
        if keyframe.session in self._tied:
            self._waiting.append(k)
        if len(self._waiting) >= BATCH:
            self._update()
        if self.config.loops.enabled:
            self._query(k)

    def load(self, poses: Float64, loops: Sequence[Proposal]) -> None:
        """Start from a saved map: keyframes that are in the chain, their poses, its loops."""
        for keyframe, pose in zip(self.keyframes, poses):
            self._append(keyframe, pose)
            self._tied.add(keyframe.session)
        self.accepted = list(loops)
        self._ends, self._ties = _ends_of(loops), _lengths_of(loops, self.config.loops.drift)
        self._waiting, self._fresh = list(range(len(poses))), list(loops)
        self._update()

    def _append(self, keyframe: GraphKeyframe, pose: Float64) -> None:
        x, y, yaw = keyframe.delta
        step = float(np.hypot(x, y) + 0.2 * abs(yaw))
        starts = not keyframe.id or self.keyframes[keyframe.id - 1].session != keyframe.session
        self._path = np.append(self._path, step + (self._path[-1] if len(self._path) else 0.0))
        self._steps = np.append(self._steps, np.inf if starts else step)
        self.poses = np.concatenate([self.poses, pose[None]])

    def _update(self) -> None:
        """Hand keyframes and loops that wait to the live graph."""
        keys = self.chain.keys
        factors = [factor for k in self._waiting for factor in self.chain.factors_of(k)]
        factors += [loop_factor(p, keys) for p in self._fresh]
        self._graph.add(factors, {keys[k]: self.poses[k].copy() for k in self._waiting})
        self._waiting, self._fresh = [], []

    def _query(self, k: int) -> None:
        lost = self.keyframes[k].session not in self._tied
        if k % (LOST_STEP if lost else QUERY_STEP):
            return
        far = self._path[k] - NEIGHBOURHOOD
        self._recent = [p for p in self._recent if self._path[p.b] >= far]
        proposals = self._look_everywhere(k) if lost else self._look_nearby(k)
        for proposal in proposals:
            if not proposal.reason:
                self._weigh(proposal)
            else:
                self.rejected.append(proposal)

    def _look_nearby(self, k: int) -> list[Proposal]:
        """Match keyframe k against the submaps of earlier passes."""
        candidates = self._candidates(k)
        patch = make_patch(self.keyframes, k, PATCH_HALF) if candidates else None
        if patch is None or len(patch.points) < LEAST_POINTS:
            return []
        found = [propose(self._submap(c), patch, w, self.config) for c, w in candidates]
        return [proposal for proposal in found if proposal is not None]

    def _look_everywhere(self, k: int) -> list[Proposal]:
        """Match keyframe k against the whole map; return the best place unless another is near."""
        patch = make_patch(self.keyframes, k, PATCH_HALF)
        best: list[Proposal] = []
        if len(patch.points) < LEAST_POINTS:
            return best
        share = self.config.loops.ambiguity
        for centre in self._likely_first(k, patch):
            least = share * best[0].score if best else 0.0
            window = Window(np.zeros(3), LOST_REACH, np.pi, least)
            found = propose(self._submap(centre, CACHED_LOST), patch, window, self.config)
            if found is not None and not found.reason:
                best = sorted([*best, found], key=lambda p: -p.score)
        rivals = [p for p in best[1:] if p.score >= share * best[0].score]
        if any(not self._same_place(best[0], p) for p in rivals):
            return [replace(best[0], reason="ambiguous: the map has another place like this")]
        return best[:1]

    def _likely_first(self, k: int, patch: Patch) -> list[int]:
        """Return every other submap of the map in the order of a rough match.

        The right place, found early, sets the score below which the search elsewhere stops.
        """
        span, step = (LOST_REACH, float(np.pi)), 2.0 * COARSE_STEP
        some = np.ascontiguousarray(patch.search_points[::ROUGH_STEP])
        centres, scores = self._other_sessions(k), []
        for centre in centres:
            grid = self._submap(centre, CACHED_LOST).grid
            scores.append(correlate(grid, some, np.zeros(3), span, angle_step=step).score)
        return [centres[i] for i in np.argsort(-np.array(scores), kind="stable")]

    def _same_place(self, one: Proposal, other: Proposal) -> bool:
        a = compose(self.poses[one.a], one.delta)
        b = compose(self.poses[other.a], other.delta)
        return bool(np.hypot(a[0] - b[0], a[1] - b[1]) < SAME_PLACE)

    def _candidates(self, k: int) -> list[tuple[int, Window]]:
        """Return submap centres of earlier passes near k, and where to look in each."""
        loops = self.config.loops
        centres = np.arange(SUBMAP_HALF, k - SUBMAP_HALF, SUBMAP_STEP)
        path, poses = self._path, self.poses
        centres = centres[path[k] - path[centres] >= loops.min_path]
        if not len(centres):
            return []
        away = np.hypot(*(poses[centres, :2] - poses[k, :2]).T)
        if not (away <= OVERLAP + loops.max_window).any():
            return []
        tied = self._distance(k)[centres]
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

    def _other_sessions(self, k: int) -> list[int]:
        """Return every other submap centre of the map."""
        session = self.keyframes[k].session
        return [
            c
            for c in range(SUBMAP_HALF, k - SUBMAP_HALF, 2 * SUBMAP_STEP)
            if self.keyframes[c].session != session and self.keyframes[c].session in self._tied
        ]

    def _distance(self, k: int) -> Float64:
        """Return the shortest path (m) in the graph from k to all keyframes before it."""
        return lengths_from(k, self._steps[: k + 1], self._ends, self._ties)

    def _submap(self, centre: int, most: int = CACHED_SUBMAPS) -> Submap:
        if centre not in self._cache:
            while len(self._cache) >= most:
                del self._cache[next(iter(self._cache))]
            self._cache[centre] = make_submap(self.keyframes, centre, SUBMAP_HALF)
        return self._cache[centre]

    def _weigh(self, proposal: Proposal) -> None:
        """Accept a proposal, and those that it confirms, once enough agree."""
        near = [p for p in self._recent if p.b != proposal.b]
        agree = consistent_with(proposal, near, self.poses, self._path)
        self._pending.append(proposal)
        self._recent.append(proposal)
        if agree.sum() + 1 < self.config.loops.confirmations:
            return
        waiting = {id(p) for p in self._pending}
        fresh = [p for p, ok in zip(near, agree) if ok and id(p) in waiting] + [proposal]
        taken = {id(p) for p in fresh}
        self._pending = [p for p in self._pending if id(p) not in taken]
        self._accept(fresh)

    def _accept(self, fresh: list[Proposal]) -> None:
        session = self.keyframes[fresh[-1].b].session
        tie = session not in self._tied
        if tie:
            self._tie(session, fresh[-1])
        error = np.array([between(p.delta, self._step(p)) for p in fresh])
        self.accepted.extend(fresh)
        self._ends = np.concatenate([self._ends, _ends_of(fresh)])
        ties = _lengths_of(fresh, self.config.loops.drift)
        self._ties = np.concatenate([self._ties, ties])
        self._fresh.extend(fresh)
        far = np.hypot(error[:, 0], error[:, 1]).max() > MOVED[0]
        if tie or far or np.abs(error[:, 2]).max() > MOVED[1]:
            self._update()
            self._graph.add([], {})
            self._read_back()

    def _step(self, proposal: Proposal) -> Float64:
        return between(self.poses[proposal.a], self.poses[proposal.b])

    def _tie(self, session: int, loop: Proposal) -> None:
        """Move a session to where a loop closure puts it; it waits for the live graph then."""
        T = compose(compose(self.poses[loop.a], loop.delta), inverse(self.poses[loop.b]))
        members = [x.id for x in self.keyframes[: len(self.poses)] if x.session == session]
        for k in members:
            self.poses[k] = compose(T, self.poses[k])
        self._tied.add(session)
        self._waiting.extend(members)

    def _read_back(self) -> None:
        """Take all poses from the graph."""
        known = [k for k in range(len(self.poses)) if self.keyframes[k].session in self._tied]
        self.poses[known] = self._graph.planar_poses([self.chain.keys[k] for k in known])
