"""Walls from lines at known poses, which they do not move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import Wall
from tccm_ros.slam.chain import yaw_offset_for
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import keyframe_key
from tccm_ros.slam.factors.poses import Planar, PriorPose
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.walls.association import associate_walls, min_confirmations
from tccm_ros.slam.walls.corners import find_corners
from tccm_ros.slam.walls.landmarks import wall_factors, wall_records
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.outliers import check_walls


def walls_at(poses: Float64, lines: Sequence[Lines], config: Config) -> list[Wall]:
    """Return the walls of lines at poses with the standard deviations `localisation.sigma`.

    The lines share the errors of their poses: a graph of both estimates them together.

    Parameters
    ----------
    poses
        float64 (K, 3), planar poses of the base in map.
    lines
        Lines of the K level scans, in base frames.
    config
        Groups ``walls``, ``lines`` and ``localisation``.
    """
    if not config.walls.enabled or not any(map(len, lines)):
        return []
    position, yaw = config.localisation.sigma
    cov = np.diag(np.square([position, position, yaw]))
    keys = [keyframe_key(k, yaw_offset_for(x.phi)) for k, x in enumerate(lines)]
    starts = dict(zip(keys, poses))
    priors: list[Factor] = [Planar(key, pose) for key, pose in starts.items()]
    priors += [PriorPose(key, pose, cov) for key, pose in starts.items()]
    found = associate_walls(poses, lines, config)
    checked = check_walls(found, lines, poses, PoseGraph(priors, starts), keys, config)
    graph = PoseGraph(priors, starts)
    graph.add(wall_factors(checked.table, lines, keys, config))
    corners = find_corners(checked.table, lines, min_confirmations(config, len(keys)))
    return wall_records(checked.table, corners, graph.optimise(), checked.unit_variance)
