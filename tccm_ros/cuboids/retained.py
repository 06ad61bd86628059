"""Rebuilding the window under corrected poses, from retained scans (`map.retain_points`).

A part map is made once, with the poses that odometry gave at the time. Where the scans of the
window are kept, its part maps can be made again with better ones.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.cuboids.clearing import see_through
from tccm_ros.cuboids.cycle_builder import Sweep, SweepScan
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.part_map import PartMap, PartMapBuilder

__all__ = ["Correction", "RetainedWindow"]

Correction = Callable[[NDArray[np.int64]], NDArray[np.float64]]
"""Maps stamps int64 (K,) to T_new_odom float64 (K, 4, 4): where odometry's frame really was."""


class RetainedWindow:
    """The scans of the window's cycles.

    Parameters
    ----------
    config
        Group `map`.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._sweeps: deque[Sweep] = deque()

    @property
    def nbytes(self) -> int:
        """Memory of the retained scans, bytes."""
        return sum(
            posed.scan.ranges.nbytes
            + scan.keep.nbytes
            + posed.knots_ns.nbytes
            + posed.T_odom_base.nbytes
            + posed.T_base_laser.nbytes
            for sweep in self._sweeps
            for scan in sweep.scans
            for posed in (scan.posed,)
        )

    def add(self, sweep: Sweep) -> None:
        """Keep a sweep, and forget what leaves the window."""
        self._sweeps.append(sweep)
        oldest = sweep.part.cycle - self._config.map.window_cycles
        while self._sweeps[0].part.cycle <= oldest:
            self._sweeps.popleft()

    def clear(self) -> None:
        """Forget everything."""
        self._sweeps.clear()

    def rebuild(self, map_: IntegrationMap, correction: Correction) -> None:
        """Make the map again, with corrected poses.

        Parameters
        ----------
        map_
            The map; its part maps are replaced by those of the retained sweeps. Those of a loaded
            map have no scans to be made of again, and leave it.
        correction
            Applied to the odometry of every knot. The sweeps themselves stay as they are, so that a
            later correction starts from odometry again.
        """
        builder = PartMapBuilder(self._config)
        map_.clear()
        for sweep in self._sweeps:
            corrected = _corrected(sweep, correction, builder)
            part = corrected.part
            if self._config.map.clear_seen_through:
                part = see_through(corrected, map_, self._config)
            map_.add(part)


def _corrected(sweep: Sweep, correction: Correction, builder: PartMapBuilder) -> Sweep:
    scans = []
    for scan in sweep.scans:
        T_new_odom = correction(scan.posed.knots_ns)
        posed = replace(scan.posed, T_odom_base=T_new_odom @ scan.posed.T_odom_base)
        builder.add(posed, scan.keep, scan.first, scan.last)
        scans.append(SweepScan(posed, scan.keep, scan.first, scan.last))
    part: PartMap = builder.close(sweep.part.cycle, sweep.part.start_ns, sweep.part.end_ns)
    return Sweep(sweep.span, part, scans)
