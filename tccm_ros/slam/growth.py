"""Solutions while driving: extend the graph of the last batch.

A batch builds and optimises the whole graph, and its time grows with the map. The observations
between two solutions affect only a small part of it: new keyframes, walls and loop closures are
added to a graph that stays optimised (`graph.incremental`), and lines are assigned to existing
walls (`walls.growing`). Everything else remains as in the batch.

A new batch is needed if loop closures contradict each other, or if the map has moved so far that
line associations may change (`Growth.solve` returns None). The final result is always that of a
batch.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.factors.factor import Factor, by_variables
from tccm_ros.slam.factors.keys import Key, wall_key
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.incremental import IncrementalGraph, IncrementalSolution
from tccm_ros.slam.graph.pose_graph import GraphSolution
from tccm_ros.slam.inliers import Inliers, loop_records
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.loops.consistency import LOOP_CHI2
from tccm_ros.slam.se2 import compose_se2
from tccm_ros.slam.systematic import CarriedDisplacement, scale_displacements
from tccm_ros.slam.walls.association import min_confirmations
from tccm_ros.slam.walls.corners import find_corners
from tccm_ros.slam.walls.growing import GrowingWalls
from tccm_ros.slam.walls.landmarks import wall_factors
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.outliers import OBSERVATION_CHI2

RELINEARIZE, WILDFIRE = 0.005, 1e-6
"""Thresholds of motion (m, rad) of the graph, as in `graph.incremental`. Chosen: the linearisation
error is quadratic, and is 0.01 mm over a metre here."""

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
    factors
        The factors of the batch by name. Loop closures have themselves as names, other factors the
        names of `by_variables`.
    changing
        Names of the factors that each solution may change.
    anchored
        Variables of the poses of the batch that are anchored to keyframes.
    used
        The inliers that constrain its keyframes.
    chain, closer, lines
        Keyframes, loop closures and the lines of each keyframe; the caller appends to them.
    config
        Group ``walls``.

    Attributes
    ----------
    used
        The inliers that constrain the keyframes now.
    poses
        float64 (K, 3), the keyframes in the last solution, and extrapolated since.
    """

    def __init__(
        self,
        solution: GraphSolution,
        factors: Mapping[Hashable, Factor],
        changing: Iterable[Hashable],
        anchored: Iterable[Key],
        used: Inliers,
        chain: KeyframeChain,
        closer: LoopCloser,
        lines: list[Lines],
        config: Config,
    ) -> None:
        self.used = used
        self._config, self._chain, self._closer, self._lines = config, chain, closer, lines
        self._in_map, self._loops_seen = closer.in_map, len(closer.accepted)
        self._changing, keys = {*changing}, chain.keys
        self.poses = self._assigned_at = solution.planar_poses(keys)
        self._walls = GrowingWalls(used.walls, self.poses, lines, config)
        self._first_new, self._known_walls = len(keys), len(used.walls)
        self._new_rows = np.zeros(0, np.int64)
        self._new: dict[Hashable, Factor] = {}
        walls = map(wall_key, range(len(used.walls)))
        covariances = {key: solution.covariance(key) for key in [keys[-1], *walls, *anchored]}
        self._graph = IncrementalGraph(RELINEARIZE, WILDFIRE, covariances)
        starts = {key: solution.pose(key) for key in [*keys, *anchored]}
        self._graph.update(factors, starts)
        session = chain.keyframes[-1].session
        self._odometry_scale = CarriedDisplacement(
            scale_displacements(solution, chain, session)[-1], solution.planar_covariance(keys[-1])
        )

    def extend(self) -> bool:
        """Add new keyframes, loop closures and lines; return False where a batch is needed."""
        chain, closer = self._chain, self._closer
        self._first_new = len(self.poses)
        new = range(self._first_new, len(chain.keys))
        if self._in_map != closer.in_map or any(map(chain.starts, new)):
            return False
        for k in new:
            pose = compose_se2(self.poses[-1], chain.keyframes[k].delta)
            self.poses = np.concatenate([self.poses, pose[None]])
        self._assigned_at = np.concatenate([self._assigned_at, self.poses[self._first_new :]])
        loops = closer.accepted[self._loops_seen :]
        self._loops_seen = len(closer.accepted)
        self._new = by_variables(f for k in new for f in chain.factors_of(k))
        self._new |= {p: p.factor(chain.keys) for p in loops}
        self._extend_walls()
        used = [*self.used.loops, *loops]
        taken = {id(p) for p in used}
        records = loop_records(closer, [id(p) in taken for p in closer.accepted])
        self.used = replace(self.used, loops=used, records=records)
        return True

    def _extend_walls(self) -> None:
        """Assign the lines of new keyframes."""
        lines, keys = self._lines, self._chain.keys
        self._known_walls = len(self._walls.table)
        self._new_rows = self._walls.add(self.poses, lines, self._first_new)
        seen = self._walls.observations(self._new_rows)
        self._new |= by_variables(wall_factors(seen, lines, keys, self._config))
        table = self._walls.table
        corners = find_corners(table, lines, min_confirmations(self._config, len(keys)))
        self.used = replace(self.used, walls=table, corners=corners)

    def solve(
        self, starts: Mapping[Key, Float64], changing: Mapping[Hashable, Factor]
    ) -> IncrementalSolution | None:
        """Optimise the extended graph; return None if a batch is needed.

        Parameters
        ----------
        starts
            Start values (4, 4) of the poses anchored to keyframes.
        changing
            All factors by name except those of keyframes, loop closures and lines.
        """
        keys, gone = self._chain.keys, dict.fromkeys(self._changing - changing.keys())
        poses = {**dict(zip(keys[self._first_new :], self.poses[self._first_new :])), **starts}
        try:
            solution = self._updated({**self._new, **gone, **changing}, poses)
            outliers = self._without_outliers(solution)
            solution = self._updated(dict.fromkeys(outliers), {}) if outliers else solution
        except RuntimeError:
            # Numerically singular; a batch builds a new graph.
            return None
        self._changing, self.poses = {*changing}, solution.planar_poses(keys)
        if not self._is_sound(solution):
            return None
        driven = self._chain.keyframes[self._first_new : len(keys)]
        self._odometry_scale.carry(driven, solution.planar_covariance(keys[-1]))
        return solution

    def _updated(
        self, factors: Mapping[Hashable, Factor | None], poses: Mapping[Key, Float64]
    ) -> IncrementalSolution:
        self._graph.update(factors, poses)
        self._graph.relinearise()
        return self._graph.solution()

    def _without_outliers(self, solution: IncrementalSolution) -> list[Hashable]:
        """Remove new lines that are outliers of their wall, one of the known first; return them."""
        names = [name for name, f in self._new.items() if isinstance(f, WallObservation)]
        chi2 = 2.0 * solution.errors_of(self._graph.indices_of(names))
        gone = self._walls.without(self._new_rows, chi2 > OBSERVATION_CHI2, self._known_walls)
        self.used = replace(self.used, walls=self._walls.table)
        return [names[i] for i in gone]

    def _is_sound(self, solution: IncrementalSolution) -> bool:
        """Return whether loop closures are consistent and line associations still valid."""
        chi2 = 2.0 * solution.errors_of(self._graph.indices_of(self.used.loops))
        moved, gates = self.poses - self._assigned_at, self._config.walls
        far = np.hypot(moved[:, 0], moved[:, 1]) > MAX_MOVED * gates.gate_distance
        turned = np.abs(wrap_angle(moved[:, 2])) > MAX_MOVED * gates.gate_angle
        return not ((chi2 > LOOP_CHI2).any() or (far | turned).any())

    def newest_covariance(self, solution: IncrementalSolution) -> Float64:
        """Return the covariance (3, 3) of (x, y, yaw) of the newest keyframe, in its own frame."""
        graph = solution.planar_covariance(self._chain.keys[-1]) * self.used.scale
        shifted = self._odometry_scale.displacement
        return np.asarray(graph + np.outer(shifted, shifted))
