"""What a sensor of the simulator could see on its drive, by the true solids."""

import numpy as np

from tccm_ros.geometry import inverse, pose_from_rpy, transform
from tccm_sim.engine import Simulation
from tccm_sim.world import with_options

MAX_EYES = 12
"""Maximum number of sensor positions of a laser or a lidar: further ones add nothing."""

SKIN = 0.003
"""Distance of a visible point from a solid behind it, m: more than the errors of rays."""


class Sight:
    """Visibility of points from the sensor of a recording.

    A camera has its true poses at all images, its field of view and its range. Other sensors have
    the positions of the views with most hits; a lidar sees what is between its outer rings.

    Parameters
    ----------
    world, options, seed
        The simulated world.
    outcome, T_map_world
        Outcome of the replay, and float64 (4, 4).
    """

    def __init__(self, world, options, seed, outcome, T_map_world):
        self._rig, self._scene = with_options(world.rig, options), world.scene.freeze()
        if self._rig.camera is not None:
            times = np.arange(0.0, world.duration, self._rig.camera.period)
            simulation = Simulation(world, seed, options)
            self._poses = list(simulation.sensor_poses(self._rig.camera_frame, times))
            return
        views, poses = outcome.slam.map.views, outcome.solution.view_poses.T_map_view
        seen = [(-len(v.hits), k) for k, v in enumerate(views) if v.viewpoint is not None]
        lidar = self._rig.lidar_frame if self._rig.lidar is not None else None
        turned = next((j.rpy for j in self._rig.joints if j.child == lidar), (0.0, 0.0, 0.0))
        self._poses = [
            inverse(T_map_world) @ poses[k] @ pose_from_rpy([*views[k].viewpoint.tolist(), *turned])
            for _, k in sorted(seen)[:MAX_EYES]
        ]

    def sees(self, points):
        """Return which points (N, 3) in the world are in view and not hidden, bool (N,)."""
        seen = np.zeros(len(points), bool)
        for T_world_sensor in self._poses:
            rest = np.flatnonzero(~seen)
            rest = rest[self._in_view(transform(inverse(T_world_sensor), points[rest]))]
            if not len(rest):
                continue
            way = points[rest] - T_world_sensor[:3, 3]
            ranges = np.linalg.norm(way, axis=1)
            origins = np.repeat(T_world_sensor[None, :3, 3], len(rest), axis=0)
            hits, _ = self._scene.cast(origins, way / ranges[:, None], np.zeros(len(rest)))
            seen[rest[hits > ranges - SKIN]] = True
        return seen

    def _in_view(self, points):
        """Return which points (N, 3) in the frame of the sensor are in its field of view."""
        x, y, z = points.T
        if self._rig.camera is not None:
            camera = self._rig.camera
            is_ahead = (z > camera.range_min) & (z < camera.range_max)
            u, v = camera.focal * np.abs([x, y]) / np.where(is_ahead, z, 1.0)
            return is_ahead & (u < 0.5 * camera.width) & (v < 0.5 * camera.height)
        if self._rig.lidar is not None:
            return np.abs(np.arctan2(z, np.hypot(x, y))) <= max(self._rig.lidar.elevations)
        return np.ones(len(points), bool)
