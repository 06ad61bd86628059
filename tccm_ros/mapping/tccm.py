"""The TCCM as one processor: records in, planes and the hand-over of each tilt cycle out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.cuboids.clearing import see_through
from tccm_ros.cuboids.cycle_builder import Mapper, Sweep
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.part import PartMap
from tccm_ros.cuboids.queries import MapQuery
from tccm_ros.cuboids.seen_free import SeenFree
from tccm_ros.mapping.surface_message import surface_cloud, view_intervals
from tccm_ros.planes import find_planes
from tccm_ros.planes.tracking import PlaneTracker
from tccm_ros.records import (
    JointSample,
    Odometry,
    PlaneRecord,
    PosedScan,
    RobotDescription,
    Scan,
    SurfaceCloud,
    TabletopObject,
    TransformSample,
    ViewIntervals,
)
from tccm_ros.robot import LaserKinematics
from tccm_ros.robot.synchroniser import Synchroniser
from tccm_ros.sensors.laser_scan import project, valid_beams
from tccm_ros.tabletop.free_places import FreePlaces, find_free_places
from tccm_ros.tabletop.objects import ObjectTracker, find_objects

__all__ = ["CyclePlanes", "CycleResult", "TccmProcessor", "TccmRecord"]

TccmRecord = RobotDescription | JointSample | TransformSample | Odometry | Scan

OnPlanes = Callable[["CyclePlanes"], object]

STILL_SPEED = 0.02
"""Below this the base stands still, m/s (`views.when: still`)."""

STILL_TURN_RATE = np.deg2rad(0.5)
"""Below this the base stands still, rad/s."""


class CyclePlanes(NamedTuple):
    """The planes of a tilt cycle, known before the rest of its result: as in `CycleResult`."""

    stamp_ns: int
    frame_id: str
    planes: list[PlaneRecord]


@dataclass(frozen=True, slots=True, eq=False)
class CycleResult:
    """What one tilt cycle gives.

    Attributes
    ----------
    cycle
        Its number, from 0.
    stamp_ns, start_ns, end_ns
        Middle of the first and the last used beam, and these two.
    frame_id
        Frame of planes, objects, free places and part map: the odometry frame.
    base_frame_id
        Frame of `surfaces` and `view`.
    T_odom_base
        float64 (4, 4), the base at `stamp_ns`.
    planes, objects
        Tracked planes, and what stands on them.
    place_size
        Width and depth of what `free_places` looks for room for, m.
    surfaces, view
        The hand-over.
    part
        The newest part map, with its points.
    scans
        Scans of which beams were used.
    base_speed, base_turn_rate
        Largest of the base during the sweep, m/s and rad/s.
    ended_by
        Why the cycle ended: ``turn``, ``rest``, ``gap``, ``time`` or ``end``.
    """

    cycle: int
    stamp_ns: int
    start_ns: int
    end_ns: int
    frame_id: str
    base_frame_id: str
    T_odom_base: NDArray[np.float64]
    planes: list[PlaneRecord]
    objects: list[TabletopObject]
    place_size: tuple[float, float]
    surfaces: SurfaceCloud
    view: ViewIntervals
    part: PartMap
    scans: int
    base_speed: float
    base_turn_rate: float
    ended_by: str

    def free_places(self, planes: Sequence[PlaneRecord] | None = None) -> list[FreePlaces]:
        """Return where there is room on horizontal planes; worked out when it is asked for.

        `planes` are those to look at, all by default.
        """
        chosen = self.planes if planes is None else planes
        return find_free_places(chosen, self.objects, self.place_size)

    @property
    def found(self) -> CyclePlanes:
        """The planes alone."""
        return CyclePlanes(self.stamp_ns, self.frame_id, self.planes)

    @property
    def is_still(self) -> bool:
        """Whether the base stood still for the whole sweep."""
        return self.base_speed < STILL_SPEED and self.base_turn_rate < STILL_TURN_RATE


class TccmProcessor:
    """Maps what a tilting laser sees, cycle by cycle.

    Parameters
    ----------
    config
        The configuration.
    expects_odometry
        Whether there is an odometry topic (`Synchroniser`).

    Attributes
    ----------
    map, seen_free
        The integration map, and what its cycles saw through (`query`).
    counts
        ``cycles``, ``scans used``, ``resets``.
    """

    def __init__(self, config: Config, *, expects_odometry: bool = False) -> None:
        self.config = config
        self._expects_odometry = expects_odometry
        self.counts: Counter[str] = Counter()
        self.map = IntegrationMap(config)
        self.seen_free = SeenFree(config)
        self._planes = PlaneTracker(config)
        self._objects = ObjectTracker(config)
        self._view_is_asked = False
        self._start()

    def _start(self) -> None:
        self.kinematics = LaserKinematics(self.config, "tilt")
        self.synchroniser = Synchroniser(
            self.config, self.kinematics, expects_odometry=self._expects_odometry
        )
        self._mapper = Mapper(self.config, self._keep_beams)
        self._jumps = 0
        self._frame_id = self.config.frames.odom_name

    @property
    def dropped(self) -> Counter[str]:
        """Scans that were not used, by reason."""
        return self.synchroniser.dropped + self._mapper.dropped

    def add(self, record: TccmRecord, on_planes: OnPlanes = lambda _: None) -> list[CycleResult]:
        """Take one record; return the cycles that are complete now, in order.

        `on_planes` is called with the planes of each as soon as they are known: the rest takes
        about as long again.
        """
        posed = self.synchroniser.add(record)
        if self.synchroniser.jumps != self._jumps:
            self._jumps = self.synchroniser.jumps
            self.clear_map()
        return self._take(posed, on_planes)

    def finish(self, on_planes: OnPlanes = lambda _: None) -> list[CycleResult]:
        """Close the open sweep: the input has ended."""
        results = self._take(self.synchroniser.flush(), on_planes)
        return results + [self._result(sweep, on_planes) for sweep in self._mapper.finish()]

    def reset(self) -> None:
        """Begin anew, with nothing known of the robot."""
        self.clear_map()
        dropped = self.dropped
        self._start()
        self._mapper.dropped = dropped

    def take_view(self) -> None:
        """Hand the surfaces of the next cycle over, also where `views.when` would not."""
        self._view_is_asked = True

    def clear_map(self) -> None:
        """Forget the map and the open sweep; what is known of the robot stays."""
        self.counts["resets"] += 1
        self._mapper.clear()
        self.map.clear()
        self.seen_free.clear()
        self._planes.reset()

    def query(self) -> MapQuery:
        """Return the map as it is now, to be asked (`queries`)."""
        return MapQuery(self.map, self.seen_free)

    def _take(self, posed: list[PosedScan], on_planes: OnPlanes) -> list[CycleResult]:
        self._mapper.add_tilt(self.synchroniser.tilt_samples())
        for scan in posed:
            self._mapper.add_scan(scan)
        complete_ns = self._complete_ns()
        if complete_ns is not None:
            self._mapper.cycles.advance(complete_ns)
        sweeps = self._mapper.take(complete_ns or -(2**62))
        return [self._result(sweep, on_planes) for sweep in sweeps]

    def _complete_ns(self) -> int | None:
        """Return the time before which nothing can come any more: message time less the waits."""
        newest_ns = self.synchroniser.message_ns
        if newest_ns is None:
            return None
        late_joints = max(0.0, -self.config.rig.joint_time_offset)
        wait_ns = round((self.config.sync_timeout + late_joints) * 1e9)
        return newest_ns - wait_ns - self.synchroniser.longest_scan_ns

    def _keep_beams(self, posed: PosedScan) -> NDArray[np.bool_]:
        scan = posed.scan
        shapes = (
            self.kinematics.self_shapes(scan.stamp_ns) if self.config.scan.self_filter else None
        )
        if shapes is None:
            return valid_beams(scan, self.config)
        keep = np.zeros(len(scan.ranges), np.bool_)
        keep[project(posed, self.config, shapes).beams] = True
        return keep

    def _result(self, sweep: Sweep, on_planes: OnPlanes) -> CycleResult:
        if self.config.map.clear_seen_through:
            sweep.part = see_through(sweep, self.map, self.config)
        part = sweep.part
        self._frame_id = self.synchroniser.motion.odom_frame
        self.map.add(part)
        self.counts["cycles"] += 1
        self.counts["scans used"] += len(sweep.scans)
        T_odom_base, viewpoint = sweep.T_odom_base(), sweep.T_odom_laser()[:3, 3]
        cuboids = part.cuboids() if self.config.planes.source == "part" else self.map.cuboids()
        fits = find_planes(cuboids, self.config, viewpoint)
        planes = self._planes.update(fits)
        on_planes(CyclePlanes(sweep.stamp_ns, self._frame_id, planes))
        objects = self._objects.update(find_objects(cuboids, fits, planes, self.config))
        speed, turn_rate = sweep.base_speeds()
        base = self.kinematics.base or ""
        still = speed < STILL_SPEED and turn_rate < STILL_TURN_RATE
        wanted = self.config.views.when == "always" or still or self._view_is_asked
        self._view_is_asked = False
        view = view_intervals(sweep, self.config, T_odom_base, base)
        self.seen_free.add(part.cycle, T_odom_base, view)
        return CycleResult(
            cycle=part.cycle,
            stamp_ns=sweep.stamp_ns,
            start_ns=part.start_ns,
            end_ns=part.end_ns,
            frame_id=self._frame_id,
            base_frame_id=base,
            T_odom_base=T_odom_base,
            planes=planes,
            objects=objects,
            place_size=self.config.objects.place_size,
            surfaces=surface_cloud(sweep, fits, self.config, T_odom_base, viewpoint, base, wanted),
            view=view if wanted else replace(view, intervals=view.intervals[:0]),
            part=part,
            scans=len(sweep.scans),
            base_speed=speed,
            base_turn_rate=turn_rate,
            ended_by=sweep.span.reason,
        )
