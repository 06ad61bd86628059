"""Loop closing while driving: search, confirmation and the live estimate of all keyframes.

Keyframes are matched with earlier passes in order (`search`). A match is a proposal: it becomes a
factor when proposals of other keyframes close the same cycle. The estimate is corrected at once, so
that the next search windows are small.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import PoseGuess
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.factors.factor import by_variables
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.front_end import GraphKeyframe, TrackedPose
from tccm_ros.slam.graph.incremental import IncrementalGraph
from tccm_ros.slam.landmarks import AnchoredObservation, landmark_factors
from tccm_ros.slam.loops.consistency import consistent_with
from tccm_ros.slam.loops.matching import LoopReason, Proposal, Window
from tccm_ros.slam.loops.path_lengths import PathLengths
from tccm_ros.slam.loops.place_confirmation import PlaceConfirmation
from tccm_ros.slam.loops.search import MERGED_HALF, LoopSearch, is_same_place
from tccm_ros.slam.loops.submaps import MergedScan, merge_scans
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.se2 import between_se2, compose_se2, inverse_se2
from tccm_ros.slam.signs.sign_places import WINDOW_M, WINDOW_RAD, SignPlaces, is_far
from tccm_ros.slam.signs.views import SignView

NEIGHBOURHOOD = 15.0
"""Path length (m) to either side within which proposals confirm each other (chosen)."""

UPDATE_THRESHOLD_M, UPDATE_THRESHOLD_RAD = 0.08, 0.015
"""A loop closure that contradicts the estimate by more updates all keyframes at once (chosen)."""

GUESS_KEYFRAMES, GUESS_SIGMAS = 10, 2.0
"""Number of keyframes that are matched around a user-supplied pose, and half width of the search in
standard deviations (chosen)."""

MIN_GUESS_M, MIN_GUESS_RAD = 0.3, 0.15
"""Minimum half width of the search around a user-supplied pose: poses set by hand are no more
accurate (chosen)."""

NOWHERE = "not localised, no place of the map matches the scans: drive on, or set the pose"
SIMILAR_PLACES = "it waits for scans that distinguish similar places: drive on, or set the pose"
UNCONFIRMED = "it waits for scans of other spots that confirm the place that fits: drive on"
UNJOINED = (
    "no place of the map fits: a new trajectory has begun beside the map, and is joined to it once "
    "a place fits"
)
"""Reasons why a session is not located in the map yet."""

SEARCH_PERIOD_NS = 500_000_000
"""Time between two searches of the whole map with scans that are no keyframes (chosen): a search of
a flat takes 0.05 s, and the view of a robot at rest hardly changes."""

UNPLACED_NS, UNPLACED_M = 10_000_000_000, 2.0
"""Time (ns) or path (m) after which a session without a place in the map begins its own trajectory
(chosen)."""

BESIDE_M = 30.0
"""Minimum distance in x between keyframes of two trajectories that are not joined: beyond the range
of common level lasers, so that no wall or surface of one overlaps with the other."""

MAP = -1
"""Number of the map's trajectory; the number of another trajectory is that of its first session."""

BATCH = 10
"""Number of keyframes added to the live graph together: an update costs the same for one as for a
few (chosen)."""


class LoopCloser:
    """The live estimate of all keyframes, with its loop closures.

    Parameters
    ----------
    config
        Groups ``loops`` and ``matching``.
    chain
        Keyframes of all sessions; the caller appends to it.
    begins_trajectories
        Whether a session without a place in the map begins its own trajectory after some time.

    Attributes
    ----------
    poses
        float64 (K, 3), estimates of the keyframes; those of a session that is not localised are in
        the session's own frame.
    accepted, rejected
        Proposals, in order of discovery.
    placed_by_sign
        Ids of the signs in the saved map by which sessions were localised, by session.
    placed_by_guess
        The sessions localised by a user-supplied pose.
    waits_for
        Reason why the newest session has no place in the map yet; empty if it has.
    """

    def __init__(
        self, config: Config, chain: KeyframeChain, *, begins_trajectories: bool = True
    ) -> None:
        self.poses = np.zeros((0, 3))
        self.accepted: list[Proposal] = []
        self.rejected: list[Proposal] = []
        self.placed_by_sign: dict[int, int] = {}
        self.placed_by_guess: set[int] = set()
        self.waits_for = ""
        self._config = config
        self._chain = chain
        self._begins_trajectories = begins_trajectories
        self._search = LoopSearch(config, chain.keyframes)
        self._lengths = PathLengths()
        self._graph = IncrementalGraph()
        # The trajectory of each placed session: the map, or the first session of another one.
        self._trajectories = {0: MAP}
        # Proposals within `NEIGHBOURHOOD`, and all unconfirmed proposals by their `id()`.
        self._recent: list[Proposal] = []
        self._pending: dict[int, Proposal] = {}
        # Keyframes, loop closures and landmark observations that are not in the live graph yet, and
        # the number of observations in it.
        self._new_keyframes: list[int] = []
        self._new_loops: list[Proposal] = []
        self._observed: list[AnchoredObservation] = []
        self._observation_count = 0
        self._signs = SignPlaces(chain.keyframes)
        # The user-supplied pose of the next keyframe, and that keyframe.
        self._guess: PoseGuess | None = None
        self._guessed = -1
        self._expected: Float64 | None = None
        self._searched_ns = -SEARCH_PERIOD_NS
        self._confirmations: dict[int, PlaceConfirmation] = {}

    def relocalise_around(self, guess: PoseGuess) -> None:
        """Relocalise the session that begins with the next keyframe around a user-supplied pose."""
        self._guess, self._guessed, self._expected = guess, -1, None

    def set_expected(self, pose: Float64) -> None:
        """Set the alternative pose (3,) in map of the next keyframe, should the guess be wrong."""
        self._expected = pose

    def relocalise(self, scan: LevelScan, tracked: TrackedPose) -> None:
        """Relocalise a session by a scan that is no keyframe.

        Parameters
        ----------
        scan
            The newest scan.
        tracked
            Its pose in the newest keyframe.
        """
        keyframe = self._chain.keyframes[tracked.keyframe]
        is_due = scan.stamp_ns - self._searched_ns >= SEARCH_PERIOD_NS
        if keyframe.session in self.on_trajectory or not self._config.loops.enabled or not is_due:
            return
        k = keyframe.id
        # Only this scan: surroundings of the keyframe may have changed.
        merged = merge_scans([replace(keyframe, scan=scan)], 0, 0)
        self._search_map(k, merged, scan, tracked)
        self._begin_trajectory(k, scan.stamp_ns)

    def _match_everywhere(self, k: int, merged: MergedScan) -> list[Proposal]:
        """Match a merged scan with the map; if nothing fits, with the other trajectories."""
        others = set(self.unjoined.values()) - {self._root(k)} if self._begins_trajectories else ()
        found: list[Proposal] = []
        for root in (MAP, *sorted(others)):
            if any(not p.reason or p.is_ambiguous for p in found):
                break
            found = self._search.match_everywhere(k, merged, self.poses, self._sessions_of(root))
        return found

    def _sessions_of(self, root: int) -> list[int]:
        """Return the sessions of the trajectory that begins with a session."""
        return [session for session, r in self._trajectories.items() if r == root]

    def _root(self, k: int) -> int:
        """Return the trajectory of a keyframe: `MAP`, or the first session of another one."""
        session = self._chain.keyframes[k].session
        return self._trajectories.get(session, session)

    def _begin_trajectory(self, k: int, stamp_ns: int) -> None:
        """Begin a trajectory with the session of keyframe k if it has been unplaced for long."""
        session = self._chain.keyframes[k].session
        if session in self.on_trajectory or not self._begins_trajectories:
            return
        first = next(x for x in self._chain.keyframes if x.session == session)
        driven = self._lengths.driven[k] - self._lengths.driven[first.id]
        if stamp_ns - first.scan.stamp_ns >= UNPLACED_NS or driven >= UNPLACED_M:
            self._trajectories[session] = session
            self.waits_for = UNJOINED
            self._keep_beside()

    def _keep_beside(self) -> None:
        """Shift trajectories in x so that they do not overlap with the map or each other."""
        trajectory = np.array([self._root(k) for k in range(len(self.poses))])
        right = self.poses[trajectory == MAP, 0].max()
        for root in sorted(set(self.unjoined.values())):
            members = trajectory == root
            gap = self.poses[members, 0].min() - right
            if gap < BESIDE_M:
                # More than needed, so that the robot can drive on without another shift.
                self.poses[members, 0] += 1.5 * BESIDE_M - gap
            right = self.poses[members, 0].max()

    @property
    def unconfirmed(self) -> list[Proposal]:
        """Proposals that still need confirmation."""
        return [replace(p, reason=LoopReason.UNCONFIRMED) for p in self._pending.values()]

    @property
    def in_map(self) -> frozenset[int]:
        """The sessions in the map's frame."""
        return frozenset(self._sessions_of(MAP))

    @property
    def on_trajectory(self) -> frozenset[int]:
        """The sessions in the map's frame, or on a trajectory beside it."""
        return frozenset(self._trajectories)

    @property
    def unjoined(self) -> dict[int, int]:
        """The sessions on trajectories beside the map, each with the first of its trajectory."""
        return {session: root for session, root in self._trajectories.items() if root != MAP}

    def fixed_starts(
        self, loops: Iterable[Proposal], seen: Iterable[AnchoredObservation] = ()
    ) -> dict[int, Float64]:
        """Return the poses of the first keyframes of sessions that must be fixed in a graph.

        Those are the sessions that are not joined to another one, and those that the factors of the
        graph do not connect to the first session, as their loop closures were rejected.

        Parameters
        ----------
        loops
            The loop closures of the graph.
        seen
            Its landmark observations; the observers of one landmark are connected.

        Returns
        -------
        Poses float64 (3,) by id, in order
        """
        session = [keyframe.session for keyframe in self._chain.keyframes]
        links = [{session[p.a], session[p.b]} for p in loops]
        observers: dict[Key, set[int]] = {}
        for x in seen:
            observers.setdefault(x.key, set()).add(session[x.anchored.keyframe])
        links += observers.values()
        joined = {s for s, root in self._trajectories.items() if s != root}
        connected = {*session[:1], *(session[k] for k in self._chain.fixed)}
        starts: dict[int, Float64] = {}
        for s in sorted(set(session[1:]), key=lambda s: (s in joined, s)):
            while new := set().union(*(x for x in links if x & connected)) - connected:
                connected |= new
            k = session.index(s)
            if k and (s not in joined or s not in connected):
                starts[k] = self.poses[k].copy()
                connected.add(s)
        return dict(sorted(starts.items()))

    def add(
        self,
        k: int,
        observations: Sequence[AnchoredObservation] = (),
        sign_views: Sequence[SignView] = (),
    ) -> None:
        """Add keyframe `k`, the newest, and the landmark observations since the previous one."""
        self._observed.extend(observations)
        keyframe = self._chain.keyframes[k]
        starts = self._chain.starts(k)
        self._append(
            keyframe, keyframe.pose if starts else compose_se2(self.poses[-1], keyframe.delta)
        )
        if self._root(k) == MAP:
            self._new_keyframes.append(k)
        if len(self._new_keyframes) >= BATCH:
            self._update()
        if self._guess is not None:
            self._close_around(k, self._guess)
        if self._config.loops.enabled:
            self._close(k)
            self._signs.add(sign_views, self.poses)
            self._close_by_sign(k)
        self._begin_trajectory(k, keyframe.scan.stamp_ns)
        if self.unjoined:
            self._keep_beside()

    def load(
        self,
        poses: Float64,
        loops: Sequence[Proposal],
        observations: Sequence[AnchoredObservation],
        sign_views: Sequence[SignView] = (),
        unjoined: Mapping[int, int] | None = None,
    ) -> None:
        """Start from a saved map, with its keyframes in the chain.

        Parameters
        ----------
        poses
            float64 (K, 3), keyframe poses.
        loops
            Accepted loop closures.
        observations
            Landmark observations.
        sign_views
            Views of door signs.
        unjoined
            Value of the attribute `unjoined`.
        """
        sessions = [keyframe.session for keyframe in self._chain.keyframes]
        self._trajectories |= dict.fromkeys(sessions, MAP) | dict(unjoined or {})
        for keyframe, pose in zip(self._chain.keyframes, poses):
            self._append(keyframe, pose)
            if self._root(keyframe.id) == MAP:
                self._new_keyframes.append(keyframe.id)
        if self.unjoined:
            self._keep_beside()
        self.accepted = list(loops)
        self._lengths.add_loops(loops, self._config.loops.drift)
        self._new_loops = list(loops)
        self._observed = list(observations)
        self._signs.load(sign_views, self.poses)
        self._update()

    def _append(self, keyframe: GraphKeyframe, pose: Float64) -> None:
        self._lengths.add(keyframe, starts=self._chain.starts(keyframe.id))
        self.poses = np.concatenate([self.poses, pose[None]])

    def _update(self) -> None:
        """Add the pending keyframes, loop closures and observations to the live graph."""
        keys = self._chain.keys
        factors = by_variables(f for k in self._new_keyframes for f in self._chain.factors_of(k))
        # Loop closures of a trajectory that is not joined stay pending.
        fresh = [p for p in self._new_loops if self._root(p.a) == self._root(p.b) == MAP]
        usable = [s for s in self._observed if self._root(s.anchored.keyframe) == MAP]
        self._observed = [s for s in self._observed if self._root(s.anchored.keyframe) != MAP]
        seen = landmark_factors(usable, first=self._observation_count)
        anchored, anchors = self._chain.anchor(seen.anchored, self.poses)
        starts = {**{keys[k]: self.poses[k].copy() for k in self._new_keyframes}, **anchored}
        factors |= {p: p.factor(keys) for p in fresh}
        self._graph.update(factors | by_variables([*anchors, *seen.factors]), starts)
        self._new_keyframes = []
        self._new_loops = [p for p in self._new_loops if p not in fresh]
        self._observation_count += len(seen.anchored)
        if seen.factors:
            self._read_back()

    def _close(self, k: int) -> None:
        """Search for loop closures of keyframe k; accept those with enough confirmations."""
        driven, keyframe = self._lengths.driven, self._chain.keyframes[k]
        self._recent = [p for p in self._recent if driven[p.b] >= driven[k] - NEIGHBOURHOOD]
        if self._root(k) != MAP:
            merged = merge_scans(self._chain.keyframes, k, MERGED_HALF)
            self._search_map(k, merged, keyframe.scan)
            if keyframe.session not in self.unjoined:
                return
        for proposal in self._search.match_earlier_passes(k, self.poses, self._lengths):
            if not proposal.reason:
                self._confirm(proposal)
            else:
                self.rejected.append(proposal)

    def _search_map(
        self, k: int, merged: MergedScan, scan: LevelScan, tracked: TrackedPose | None = None
    ) -> None:
        """Search the whole map for a merged scan; accept the place once it is confirmed.

        Parameters
        ----------
        k
            The newest keyframe.
        merged
            Merged scan around it, or around a later scan.
        scan
            The central scan of the merged scan.
        tracked
            The pose of the later scan in the keyframe.
        """
        self._searched_ns, session = scan.stamp_ns, self._chain.keyframes[k].session
        found, agreement = next(iter(self._match_everywhere(k, merged)), None), 0.0
        if found is not None:
            agreement = self._search.agreement(found, scan)
        if found is not None and tracked is not None:
            delta = compose_se2(found.delta, inverse_se2(tracked.pose))
            found = replace(found, b=k, delta=delta, cov=found.cov + tracked.cov)
        self.waits_for = UNCONFIRMED
        if found is None or found.reason:
            self.waits_for = SIMILAR_PLACES if found is not None and found.is_ambiguous else NOWHERE
        if found is not None and found.reason:
            self.rejected.append(found)
        confirmation = self._confirmations.setdefault(session, PlaceConfirmation())
        accepted = confirmation.add(found, agreement, self.poses, self._lengths.driven)
        if accepted:
            self._accept(accepted)
        if self._root(k) == MAP:
            self.waits_for = ""
        elif session in self.unjoined:
            self.waits_for = UNJOINED

    def _close_around(self, k: int, guess: PoseGuess) -> None:
        """Search for keyframe k around a user-supplied pose; the first match is accepted.

        The pose expected without the guess is accepted instead if it fits better.
        """
        self._guessed = k if self._guessed < 0 else self._guessed
        is_late = k >= self._guessed + GUESS_KEYFRAMES
        if is_late or self._root(k) == MAP:
            self._guess = None
            return
        moved = between_se2(self.poses[self._guessed], self.poses[k])
        sigmas = np.sqrt(np.diag(guess.cov))
        window = Window(
            compose_se2(guess.pose, moved),
            max(MIN_GUESS_M, GUESS_SIGMAS * float(sigmas[:2].max())),
            min(max(MIN_GUESS_RAD, GUESS_SIGMAS * float(sigmas[2])), float(np.pi)),
        )
        found = self._search.match_around(k, window, self.poses, self.in_map)
        known: list[Proposal] = []
        if k == self._guessed and self._expected is not None:
            near = Window(self._expected, MIN_GUESS_M, MIN_GUESS_RAD)
            known = self._search.match_around(k, near, self.poses, self.in_map)
        if found or known:
            best = max([*found, *known], key=lambda p: p.score)
            if found and is_same_place(best, found[0], self.poses):
                self.placed_by_guess.add(self._chain.keyframes[k].session)
            self._guess, self.waits_for = None, ""
            self._accept([best])

    def _close_by_sign(self, k: int) -> None:
        """Match keyframe k at the place of a known sign, unless that is ambiguous."""
        found: list[tuple[Proposal, int]] = []
        session = self._chain.keyframes[k].session
        is_localised = self._root(k) == MAP
        for known, pose in self._signs.predictions(k, self.poses):
            if self._root(known.keyframe) != MAP:
                continue
            if is_localised and not is_far(self.poses[k], pose):
                continue
            around = Window(pose, WINDOW_M, WINDOW_RAD)
            near = self._search.match_around(k, around, self.poses, self.in_map, self._lengths)
            found += [(proposal, known.sign) for proposal in near]
        if not found:
            return
        best, sign = max(found, key=lambda pair: pair[0].score)
        if any(not is_same_place(best, p, self.poses) for p, _ in found):
            self.rejected.append(replace(best, reason=LoopReason.TWO_PLACES_IN_MAP))
            return
        self._confirm(best)
        if not is_localised and self._root(k) == MAP:
            self.placed_by_sign[session] = sign

    def _confirm(self, proposal: Proposal) -> None:
        """Accept a proposal and those that it confirms, if enough agree."""
        root = self._root(proposal.a)
        near = [p for p in self._recent if p.b != proposal.b and self._root(p.a) == root]
        agree = consistent_with(proposal, near, self.poses, self._lengths.driven)
        self._pending[id(proposal)] = proposal
        self._recent.append(proposal)
        if agree.sum() + 1 < self._config.loops.confirmations:
            return
        fresh = [p for p, ok in zip(near, agree) if ok and id(p) in self._pending] + [proposal]
        for p in fresh:
            del self._pending[id(p)]
        self._accept(fresh)

    def _accept(self, fresh: list[Proposal]) -> None:
        last = fresh[-1]
        is_joined = self._root(last.a) != self._root(last.b)
        if is_joined:
            self._join(last)
        error = np.array(
            [between_se2(p.delta, between_se2(self.poses[p.a], self.poses[p.b])) for p in fresh]
        )
        self.accepted.extend(fresh)
        self._lengths.add_loops(fresh, self._config.loops.drift)
        self._new_loops.extend(fresh)
        if self._root(last.b) != MAP:
            return  # the live graph is that of the map
        far = np.hypot(error[:, 0], error[:, 1]).max() > UPDATE_THRESHOLD_M
        if is_joined or far or np.abs(error[:, 2]).max() > UPDATE_THRESHOLD_RAD:
            self._update()
            self._read_back()

    def _join(self, loop: Proposal) -> None:
        """Move the trajectory of a loop closure's second keyframe to that of its first."""
        T = compose_se2(
            compose_se2(self.poses[loop.a], loop.delta), inverse_se2(self.poses[loop.b])
        )
        target, session = self._root(loop.a), self._chain.keyframes[loop.b].session
        sessions = self._sessions_of(self._root(loop.b)) or [session]
        keyframes = self._chain.keyframes[: len(self.poses)]
        members = [keyframe.id for keyframe in keyframes if keyframe.session in sessions]
        for k in members:
            self.poses[k] = compose_se2(T, self.poses[k])
        self._trajectories.update(dict.fromkeys(sessions, target))
        if target == MAP:
            self._new_keyframes.extend(members)

    def _read_back(self) -> None:
        """Update all poses from the live graph, after one more iteration."""
        self._graph.update({}, {})
        known = [k for k in range(len(self.poses)) if self._root(k) == MAP]
        self.poses[known] = self._graph.planar_poses([self._chain.keys[k] for k in known])
