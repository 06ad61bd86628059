"""Solved maps for trackers, without the solver process."""

import numpy as np

from tccm_ros.slam.live_estimate import MapWalls, SolvedKeyframe
from tccm_ros.slam.tracking import SolvedMap


def solved_map(slam):
    """Return a solution of a `WallSlam` and its `SolvedMap` for a tracker."""
    solution = slam.solve()
    newest = solution.keyframes[-1]
    keyframe = SolvedKeyframe(newest.id, newest.pose, solution.cov_keyframes[-1])
    walls = MapWalls.of(solution.walls, np.zeros(3))
    return solution, SolvedMap(slam.correction(solution), keyframe, walls, not slam.is_lost)
