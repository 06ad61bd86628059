"""Keyframes from odometry alone, for solutions without matching."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.trajectory import OdometryTrack


class OdometryFrontEnd:
    """A front end with the odometry samples as scans without points.

    It continues with the samples since the previous call of `update`, and begins again after a
    sample in the past or with another first pose: its keyframes are a function of the samples.

    Parameters
    ----------
    config
        As of `FrontEnd`.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._front = FrontEnd(config)
        self._begun: tuple[float, ...] = ()

    def update(self, odometry: OdometryTrack, start: Float64) -> FrontEnd:
        """Return the front end after all samples.

        Parameters
        ----------
        odometry
            The samples.
        start
            float64 (3,), pose of the first sample in map.
        """
        begun = (odometry.late_samples, *start.tolist())
        if begun != self._begun:
            self._front, self._begun = FrontEnd(self._config), begun
        done, nothing = len(self._front.tracked), np.zeros((0, 2))
        for stamp, odom in zip(odometry.stamps_ns[done:], odometry.values[done:].copy()):
            scan = LevelScan(int(stamp), odom, nothing, np.zeros(2), nothing, nothing)
            self._front.add(scan, start)
        return self._front
