"""Results of a replay in memory, before they are written."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from tccm_ros.config import Config
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor
from tccm_ros.results.cycles_file import CycleHistory
from tccm_ros.surfaces.changes import Change
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution


@dataclass(slots=True, eq=False)
class Outcome:
    """Results of a replay in memory, before they are written.

    Attributes
    ----------
    config
        Of the replay.
    cycles
        The tilt cycles of this bag, without their points.
    history
        Coarsened part map of every tilt cycle, for the report.
    tccm, slam
        The processors at the end: the integration map and counts.
    solution
        Trajectory, walls and surfaces.
    messages
        Messages read, by topic.
    dropped
        Records that were not used, by reason; messages that could not be read, by topic and the
        problem of the first.
    bag_duration
        s.
    continues_map
        Whether it is a new session of a saved map.
    changes
        What has changed, and the stamp of the view that told it, ns; empty unless asked for.
    found_topics
        One line for each topic that was taken by its type, and for a laser that is the base.
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
