"""Surface maps of simulated rooms, and their agreement with the truth."""

import numpy as np
from room import Board
from shapely import Polygon

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.surfaces.surface_map import ViewPoses

TABLE = Board(1.5, 0.0, 0.8, 1.4, 0.74)


def default_tilt_covariance(count):
    """Return covariances (count, 3, 3) of (z, roll, pitch) of an unknown base."""
    return np.tile(np.diag(np.square([0.005, 0.00524, 0.00524])), (count, 1, 1))


def poses_at(T_map_view):
    """Return view poses (V, 4, 4), each with a keyframe of its own."""
    count = len(T_map_view)
    return ViewPoses(T_map_view, default_tilt_covariance(count), np.arange(count))


def build(looks, poses=None, config=None, order=None, *, sees_through=True):
    """Return the map of tilt cycles (room, pose, stamp) at their true poses, or at `poses`."""
    surface_map = SurfaceSlam(config or Config()).map
    records = [r for room, pose, stamp in looks for r in room.look(pose, stamp)]
    if not sees_through:
        records = records[::2]
    for k in order if order is not None else range(len(records)):
        surface_map.add(records[k])
    stamps = sorted({stamp for _, _, stamp in looks})
    where = poses or [next(p for _, p, s in looks if s == stamp) for stamp in stamps]
    return surface_map.build(poses_at(spatial(np.array(where))))


def above_floor(mapped):
    """Return the surfaces that are not floor."""
    return [s for s in mapped.surfaces if s.label != "floor"]


def overlap(surface, board):
    """Return the intersection over union of a surface and a board, seen from above."""
    polygon = Polygon(surface.boundary[:, :2], [h[:, :2] for h in surface.holes])
    return polygon.intersection(board.polygon).area / polygon.union(board.polygon).area
