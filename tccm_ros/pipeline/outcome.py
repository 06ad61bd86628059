"""What a replay has found, and how its bag begins."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

from tccm_ros.config import Config
from tccm_ros.mapping.tccm import CycleResult, TccmProcessor
from tccm_ros.results.cycles import CycleHistory
from tccm_ros.surfaces.continuation import Continuation
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution

__all__ = ["Outcome", "Session"]


@dataclass(frozen=True, slots=True)
class Session:
    """How a bag begins.

    Attributes
    ----------
    kind
        ``first``: with nothing; ``continued``: where the saved run was interrupted; ``new``: a
        session of its own, whose place in the saved map has to be found.
    reason
        Why it is a new one.
    """

    kind: Literal["first", "continued", "new"]
    reason: str


@dataclass(slots=True, eq=False)
class Outcome:
    """What a replay has found, before it is written.

    Attributes
    ----------
    config
        As it was run.
    earlier
        The tilt cycles of the run that this bag goes on with: their planes and objects.
    cycles
        The tilt cycles of this bag, without their points.
    history
        Coarse part maps of every cycle, for the report.
    tccm, slam
        The processors at the end: the integration map, counts and drops.
    solution
        Trajectory, walls and surfaces.
    messages
        Messages read, by topic.
    unreadable
        Messages that could not be used, by topic and what was wrong with the first.
    bag_duration
        s.
    session
        How the bag begins.
    run
        The run before its end, for the next bag of the same recording; None if nothing came.
    """

    config: Config
    earlier: list[CycleResult]
    cycles: list[CycleResult]
    history: CycleHistory
    tccm: TccmProcessor
    slam: SurfaceSlam
    solution: SurfaceSolution
    messages: Counter[str] = field(default_factory=Counter)
    unreadable: Counter[str] = field(default_factory=Counter)
    bag_duration: float = 0.0
    session: Session = Session("first", "")
    run: Continuation | None = None
