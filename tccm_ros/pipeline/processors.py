"""The two processors and the hand-over between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from tccm_ros.config import Config
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor, TccmRecord
from tccm_ros.records import Scan
from tccm_ros.records.building import Record
from tccm_ros.results.cycles import CycleHistory
from tccm_ros.stopwatch import Stopwatch
from tccm_ros.surfaces.saved_map import SavedMap
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution

__all__ = ["Pipeline"]

PARTS_KEPT = 400
"""Cycles whose part maps are kept for result.mcap: memory stays bounded in a bag of hours."""


class Pipeline:
    """Both processors of a run, fed record by record."""

    def __init__(
        self,
        config: Config,
        *,
        expects_odometry: bool,
        saved: SavedMap | None = None,
        clock: Stopwatch | None = None,
    ):
        self.config = config
        self.clock = clock or Stopwatch()
        self.tccm = TccmProcessor(config, expects_odometry=expects_odometry)
        self.slam = (
            SurfaceSlam(config, expects_odometry=expects_odometry)
            if saved is None
            else SurfaceSlam.from_saved(config, saved, expects_odometry=expects_odometry)
        )
        self.cycles: list[CycleResult] = []
        self.history = CycleHistory(config.map.window_cycles)

    def add(self, role: str, record: Record) -> list[CycleResult]:
        """Give one record to whom it concerns; return the cycles that are complete now."""
        results: list[CycleResult] = []
        if role != "scan":
            with self.clock.stage("tccm"):
                results = self.tccm.add(cast(TccmRecord, record))
        with self.clock.stage("slam"):
            if role != "tilt_scan":
                self.slam.add(record)
            elif isinstance(record, Scan):
                self.slam.add_pose_stamp(record.stamp_ns)
        self._hand_over(results)
        return results

    def finish(self) -> list[CycleResult]:
        """Take the end of the input."""
        with self.clock.stage("tccm"):
            results = self.tccm.finish()
        self._hand_over(results)
        with self.clock.stage("slam"):
            self.slam.finish()
        return results

    def solve(self) -> SurfaceSolution:
        """Optimise the graph and build the surface map."""
        with self.clock.stage("solve"):
            return self.slam.solve()

    def _hand_over(self, results: Sequence[CycleResult]) -> None:
        for result in results:
            with self.clock.stage("slam"):
                self.slam.add(result.surfaces)
                self.slam.add(result.view)
            with self.clock.stage("history"):
                self.history.add(result.cycle, result.stamp_ns, result.part.cuboids())
            self.cycles.append(replace(result, part=result.part.without_points()))
            if len(self.cycles) > PARTS_KEPT:
                old = self.cycles[-PARTS_KEPT - 1]
                self.cycles[-PARTS_KEPT - 1] = replace(old, part=old.part.without_cuboids())
