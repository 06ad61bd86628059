"""Results of a replay in memory, before they are written."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor
from tccm_ros.records import PlaneKind
from tccm_ros.results.cycles_file import CycleHistory
from tccm_ros.results.surface_counts import MIN_COUNTED_AREA_M2, count_surfaces
from tccm_ros.scene.changes import Change
from tccm_ros.slam.occupancy import OCCUPIED


@dataclass(slots=True, eq=False)
class ReplayOutcome:
    """Results of a replay in memory, before they are written.

    Attributes
    ----------
    config
        Configuration of the replay.
    cycles
        The tilt cycles of this bag, without their points.
    history
        Coarsened part maps of all tilt cycles, for the report.
    tccm, slam
        The processors at the end, with the integration map and counts.
    solution
        Trajectory, walls and surfaces.
    messages
        Number of messages read, by topic.
    dropped
        Number of records not used by reason, and of messages not read by topic and the first
        problem.
    bag_duration
        Duration of the bag, s.
    continues_map
        Whether it is a new session of a saved map.
    changes
        Changes, with the stamps of the views that revealed them, ns; empty unless requested.
    found_topics
        One line for each topic assigned by its type, and for a laser that is the base.
    """

    config: Config
    cycles: list[CycleResult]
    history: CycleHistory
    tccm: TccmProcessor
    slam: SurfaceSlam
    solution: SurfaceSolution
    messages: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    bag_duration: float = 0.0
    continues_map: bool = False
    found_topics: tuple[str, ...] = ()
    changes: tuple[tuple[int, Change], ...] = ()

    def why_empty(self) -> list[str]:
        """Return the reasons why there are no surfaces or no walls, one line each."""
        surfaces, lines = count_surfaces(self.solution.surfaces), []
        if not surfaces.counted and surfaces.small:
            lines.append(
                f"no surface of {MIN_COUNTED_AREA_M2} m²: {self._why_small(surfaces.small)}"
            )
        elif not surfaces.counted:
            lines.append(f"no surfaces: {self._why_no_surfaces()}")
        if not self.solution.graph.walls:
            lines.append(f"no walls: {self._why_no_walls()}")
        return lines

    def _why_small(self, count: int) -> str:
        planes = [plane for cycle in self.cycles for plane in cycle.planes]
        horizontal = [plane for plane in planes if plane.kind is PlaneKind.HORIZONTAL]
        largest = max(s.area for s in self.solution.surfaces if s.label != "floor")
        return (
            f"the largest of {count} has {largest:.3f} m²; {len(self.cycles)} tilt cycles have "
            f"{len(planes)} planes, {len(horizontal)} of them horizontal"
        )

    def _why_no_surfaces(self) -> str:
        if not self.cycles:
            return "there is no tilting laser, no depth image and no point cloud"
        planes = [plane for cycle in self.cycles for plane in cycle.planes]
        horizontal = sum(plane.kind is PlaneKind.HORIZONTAL for plane in planes)
        limit = self.config.surfaces.min_height
        seen = f"{len(self.cycles)} tilt cycles have {len(planes)} planes"
        if not planes:
            return f"{seen}: no usable points: none measured, or too noisy or too far away"
        seen = f"{seen}, {horizontal} of them horizontal"
        above = sum(map(_area_above_sensor, self.cycles))
        if 2.0 * above > sum(map(_horizontal_area, self.cycles)):
            return f"{seen}, mostly above the sensor: ceilings, or a tilt joint of the wrong sign?"
        return f"{seen}; none is a surface {limit:g} m (surfaces.min_height) above the floor"

    def _why_no_walls(self) -> str:
        scans, grid = self.slam.counts["level scans"], self.solution.grid
        if not scans:
            return "there is no level scan; sensors.level_from makes some of depths or points"
        if grid is None or not (grid.cells == OCCUPIED).any():
            return f"of {scans} level scans no beam measured a range: all say that nothing is there"
        return f"{scans} level scans have no straight line of {self.config.lines.min_length:g} m"


def _horizontal_area(cycle: CycleResult) -> float:
    """Return the area of a tilt cycle's horizontal planes, m2."""
    return sum(p.area for p in cycle.planes if p.kind is PlaneKind.HORIZONTAL)


def _area_above_sensor(cycle: CycleResult) -> float:
    """Return the area of a tilt cycle's horizontal planes above its sensor, m2."""
    T, viewpoint = cycle.T_odom_base, cycle.surfaces.viewpoint
    if viewpoint is None:
        return 0.0
    height = float(T[2, :3] @ viewpoint + T[2, 3])
    horizontal = (p for p in cycle.planes if p.kind is PlaneKind.HORIZONTAL)
    return sum(p.area for p in horizontal if p.centroid[2] > height)
