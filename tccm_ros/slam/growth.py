"""Solutions while driving: extend the graph of the last batch.

A batch builds and optimises the whole graph, and its time grows with the map. The observations
between two solutions affect only a small part of it: new keyframes, walls and loop closures are
added to a graph that stays optimised (`kept_graph`), and lines are assigned to existing walls
(`growing`). Everything else remains as in the batch.

A new batch is needed if loop closures contradict each other, or if the map has moved so far that
line associations may change (`Growth.solve` returns None). The final result is always that of a
batch.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.chain import AnchoredPose, Chain
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, corner_key, wall_key
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.kept_graph import KeptGraph, KeptSolution
from tccm_ros.slam.graph.pose_graph import GraphSolution
from tccm_ros.slam.inliers import Inliers, loop_records
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.loops.consistency import LOOP_CHI2
from tccm_ros.slam.registered_views import RegisteredViews
from tccm_ros.slam.se2 import compose
from tccm_ros.slam.systematic import CarriedDisplacement, scale_displacements
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.corners import corner_factors, uses_corners
from tccm_ros.slam.walls.growing import GrowingWalls
from tccm_ros.slam.walls.landmarks import structure_factors, wall_factors
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.outliers import OBSERVATION_CHI2

MIN_KEYFRAMES = 500
"""Minimum number of keyframes; with fewer, a batch takes less than a second (chosen)."""

MAX_MOVED = 0.5
"""Lines are associated again if a keyframe has moved by this fraction of ``walls.gate_distance`` or
``walls.gate_angle`` since the last association (chosen)."""


class Growth:
    """The graph of a batch solution, extended by newer factors.

    Parameters
    ----------
    solution
        Solution of the batch, with its covariances; all sessions are placed in the map.
    used
        The inliers that constrain its keyframes.
    chain, closer, lines
        Keyframes, loop closures and the lines of each keyframe; the caller appends to them.
    views
        Stamps (ns) of the views of the batch.
    config
        Group ``walls``.

    Attributes
    ----------
    used
        The inliers that constrain the keyframes now.
    views
        Variables of views, and factors between them.
    """

    def __init__(
        self,
        solution: GraphSolution,
        used: Inliers,
        chain: Chain,
        closer: LoopCloser,
        lines: list[Lines],
        views: Sequence[int],
        config: Config,
    ) -> None:
        self.used = used
        self._config, self._chain, self._closer, self._lines = config, chain, closer, lines
        self.views = RegisteredViews(views)
        self._localised, self._loops_seen = closer.localised, len(closer.accepted)
        keys, poses = chain.keys, solution.planar_poses(chain.keys)
        self._assigned_at = poses
        self._walls = GrowingWalls(used.walls, used.corners, poses, lines, config)
        walls = [wall_key(w) for w in range(len(used.walls) if config.walls.enabled else 0)]
        known = [keys[-1], *walls, *self.views.keys(views)]
        self._kept = KeptGraph({key: solution.covariance(key) for key in known})
        loops = [p.factor(keys) for p in used.loops]
        factors: list[Factor] = [f for k in range(len(keys)) for f in chain.factors_of(k)]
        factors += self._wall_factors(used.walls)
        corners = self._corner_factors(range(len(used.corners)))
        added = self._kept.update([*loops, *factors], dict(zip(keys, poses)), groups=corners)
        self._loop_factors = [index for (index,) in added[: len(loops)]]
        session = chain.keyframes[-1].session
        self._odometry_scale = CarriedDisplacement(
            scale_displacements(solution, chain, session)[-1], solution.planar_covariance(keys[-1])
        )

    def _wall_factors(self, observations: WallTable) -> list[WallObservation]:
        if not self._config.walls.enabled:
            return []
        return wall_factors(observations, self._lines, self._chain.keys, self._config)

    def _corner_factors(self, numbers: Iterable[int]) -> dict[Hashable, list[Factor]]:
        """Return the factors of corners, by corner variable."""
        if not uses_corners(self._config):
            return {}
        walls, keys = self._walls, self._chain.keys
        return {
            corner_key(n): corner_factors(walls.corners, walls.table, keys, self._config, [n])
            for n in numbers
        }

    def solve(
        self, anchored: Mapping[Key, AnchoredPose], others: Sequence[Factor]
    ) -> KeptSolution | None:
        """Add new factors and optimise; return None where a batch is needed.

        Parameters
        ----------
        anchored
            All poses anchored to keyframes, by their variables.
        others
            All factors except those of keyframes, loop closures, walls and between views.
        """
        chain, keys = self._chain, self._chain.keys
        new = range(len(self._assigned_at), len(keys))
        if self._localised != self._closer.localised or any(map(chain.starts, new)):
            return None
        loops = self._closer.accepted[self._loops_seen :]
        poses = self._extrapolated(new)
        known = len(self._walls.table)
        rows, corners = self._walls.add(poses, self._lines, new.start)
        seen = self._wall_factors(self._walls.observations(rows))
        factors: list[Factor] = [*seen, *(p.factor(keys) for p in loops)]
        factors += [factor for k in new for factor in chain.factors_of(k)]
        starts: dict[Key, Float64] = {keys[k]: poses[k] for k in new}
        changing = [*others, *self.views.factors(anchored), *self._structure_factors()]
        for key, pose in anchored.items():
            starts[key], factor = chain.anchor(key, pose, poses)
            changing.append(factor)
        try:
            added = self._kept.update(factors, starts, changing, self._corner_factors(corners))
            self._take_out(rows, added[: len(seen)], known)
        except RuntimeError:
            # Numerically singular; a batch builds a new graph.
            return None
        self._loop_factors += [index for (index,) in added[len(seen) : len(seen) + len(loops)]]
        self._assigned_at = np.concatenate([self._assigned_at, poses[new.start :]])
        solution = self._kept.solution()
        if not self._is_sound(solution):
            return None
        self._odometry_scale.carry(
            chain.keyframes[new.start : new.stop], solution.planar_covariance(keys[-1])
        )
        self._note_used()
        return solution

    def _extrapolated(self, new: range) -> Float64:
        """Return the poses (K, 3) of all keyframes, of new ones by their odometry steps."""
        poses = [*self._kept.solution().planar_poses(self._chain.keys[: new.start])]
        for k in new:
            poses.append(compose(poses[-1], self._chain.keyframes[k].delta))
        return np.array(poses)

    def _structure_factors(self) -> list[Factor]:
        walls = self._config.walls
        has_prior = walls.enabled and walls.structure_prior
        return structure_factors(self._walls.table) if has_prior else []

    def _take_out(self, rows: Int64, factors: Sequence[Sequence[int]], known: int) -> None:
        """Remove new observations that are outliers of their wall, one of the `known` first."""
        if not self._config.walls.enabled or not len(rows):
            return
        indices = np.array(factors, np.int64)[:, 0]
        chi2 = 2.0 * self._kept.solution().errors_of(indices.tolist())
        gone = self._walls.without(rows, chi2 > OBSERVATION_CHI2, known)
        if len(gone):
            self._kept.remove(indices[gone].tolist())

    def _is_sound(self, solution: KeptSolution) -> bool:
        """Return whether loop closures are consistent and line associations still valid."""
        chi2 = 2.0 * solution.errors_of(self._loop_factors)
        moved = solution.planar_poses(self._chain.keys) - self._assigned_at
        gates = self._config.walls
        far = np.hypot(moved[:, 0], moved[:, 1]) > MAX_MOVED * gates.gate_distance
        turned = np.abs(wrap_angle(moved[:, 2])) > MAX_MOVED * gates.gate_angle
        return not ((chi2 > LOOP_CHI2).any() or (far | turned).any())

    def _note_used(self) -> None:
        """Update the inliers that constrain the keyframes."""
        closer = self._closer
        loops = [*self.used.loops, *closer.accepted[self._loops_seen :]]
        self._loops_seen = len(closer.accepted)
        taken = {id(p) for p in loops}
        records = loop_records(closer, [id(p) in taken for p in closer.accepted])
        self.used = replace(
            self.used,
            loops=loops,
            records=records,
            walls=self._walls.table,
            corners=[*self._walls.corners],
        )

    def newest_covariance(self, solution: KeptSolution) -> Float64:
        """Return the covariance (3, 3) of (x, y, yaw) of the newest keyframe, in its own frame."""
        graph = solution.planar_covariance(self._chain.keys[-1]) * self.used.scale
        shifted = self._odometry_scale.displacement
        return np.asarray(graph + np.outer(shifted, shifted))
