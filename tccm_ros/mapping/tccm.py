"""The TCCM as one processor: takes events, returns planes and a surface message per tilt cycle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.baselines.center_cores import find_core_planes
from tccm_ros.baselines.neighbour_planes import find_neighbour_planes
from tccm_ros.baselines.seed_segmentation import segment
from tccm_ros.baselines.union_as_printed import AS_PRINTED
from tccm_ros.config import Config
from tccm_ros.cuboids.clearing import add_voids
from tccm_ros.cuboids.cycle_builder import CycleBuilder, TiltCycleData, count_begun
from tccm_ros.cuboids.cycle_records import CyclePoints, CycleRecord, CycleScan
from tccm_ros.cuboids.free_columns import FreeSpace
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.part_map import PartMap
from tccm_ros.cuboids.queries import MapQuery
from tccm_ros.cuboids.union import UNION
from tccm_ros.mapping.surface_message import (
    hits_near,
    object_boxes,
    surface_cloud,
    view_intervals,
)
from tccm_ros.planes import PlaneFits, find_planes
from tccm_ros.planes.tracking import PlaneTracker
from tccm_ros.records import (
    Event,
    MapReset,
    ObjectBoxes,
    PlaneRecord,
    Posed,
    PosedScan,
    StreamComplete,
    SurfaceCloud,
    TabletopObject,
    TiltAngle,
    ViewIntervals,
)
from tccm_ros.sensors.depth_image import PosedImage, measure_image
from tccm_ros.sensors.laser_scan import used_beams
from tccm_ros.sensors.point_cloud import PosedCloud, measure_cloud
from tccm_ros.sensors.registry import roles_of
from tccm_ros.tabletop.objects import ObjectTracker, find_objects

DETECTORS = {
    "moments": find_planes,
    "center_cores": find_core_planes,
    "neighbours": find_neighbour_planes,
}
"""Plane detectors by `planes.detector`."""

OnPlanes = Callable[["CyclePlanes"], object]

STILL_SPEED = 0.02
"""Speed below which the base counts as still, m/s (`views.when: still`). Chosen."""

STILL_ANGULAR_SPEED = np.deg2rad(0.5)
"""Angular speed below which the base counts as still, rad/s. Chosen."""


def is_still(speed: float, angular_speed: float) -> bool:
    """Return whether the base counts as still at a speed, m/s, and an angular speed, rad/s."""
    return speed < STILL_SPEED and angular_speed < STILL_ANGULAR_SPEED


class CyclePlanes(NamedTuple):
    """The planes of a tilt cycle, available before the other fields of its `CycleResult`.

    Attributes
    ----------
    stamp_ns
        Stamp of the tilt cycle.
    frame_id
        Frame of the planes.
    planes
        Tracked planes.
    """

    stamp_ns: int
    frame_id: str
    planes: list[PlaneRecord]


@dataclass(frozen=True, slots=True, eq=False)
class CycleResult:
    """The result of one tilt cycle.

    Attributes
    ----------
    cycle
        Index of the tilt cycle, from 0.
    stamp_ns, start_ns, end_ns
        Middle time of the first and the last used beam, and their times.
    frame_id
        Frame of planes, objects and part map: the odometry frame.
    base_frame_id
        Frame of `surfaces`, `view` and `boxes`.
    T_odom_base
        float64 (4, 4), the base at `stamp_ns`.
    planes, objects
        Tracked planes, and the objects on them.
    surfaces, view, boxes
        Messages to the surface map.
    part
        The newest part map, with its points.
    scans
        Number of scans, images and clouds used.
    base_speed, base_angular_speed
        Maximum speed of the base during the tilt cycle, m/s and rad/s.
    ended_by
        Reason for the end of the cycle: ``turn``, ``rest``, ``gap``, ``time``, ``motion`` or
        ``end``.
    """

    cycle: int
    stamp_ns: int
    start_ns: int
    end_ns: int
    frame_id: str
    base_frame_id: str
    T_odom_base: Float64
    planes: list[PlaneRecord]
    objects: list[TabletopObject]
    surfaces: SurfaceCloud
    view: ViewIntervals
    boxes: ObjectBoxes
    part: PartMap
    scans: int
    base_speed: float
    base_angular_speed: float
    ended_by: str

    @property
    def found(self) -> CyclePlanes:
        """The planes alone."""
        return CyclePlanes(self.stamp_ns, self.frame_id, self.planes)

    @property
    def is_still(self) -> bool:
        """Whether the base stood still for the whole tilt cycle."""
        return is_still(self.base_speed, self.base_angular_speed)


class TccmProcessor:
    """Maps the measurements of tilting lasers, depth cameras and lidars, one tilt cycle at a time.

    Parameters
    ----------
    config
        The configuration.

    Attributes
    ----------
    map, seen_free
        The integration map, and the free space that its tilt cycles observed (see `query`).
    counts
        Numbers of ``cycles``, ``scans used`` and ``resets``.
    used
        Number of records used, by role.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        self.counts: Counter[str] = Counter()
        self.used: Counter[str] = Counter()
        self.map = IntegrationMap(config)
        self.seen_free = FreeSpace(config)
        # Baselines are selected here and passed on as functions: `cuboids` imports none of them.
        self._rule = AS_PRINTED if config.map.mode == "paper" else UNION
        self._cycles = CycleBuilder(config, self._rule)
        is_seed = config.surfaces.segmentation == "seed"
        self._segmentation = partial(segment, config=config) if is_seed else None
        # Own streams, and events without a role.
        self._roles = {None, *roles_of("tccm", config)}
        self._planes = PlaneTracker(config)
        self._objects = ObjectTracker(config)
        self._odom_frame, self._base_frame = config.frames.odom_name, ""
        self._view_is_asked = False
        self._handlers: dict[type, Callable[[Any], None]] = {
            PosedScan: self._take_scan,
            PosedImage: self._take_image,
            PosedCloud: self._take_cloud,
            TiltAngle: self._take_angle,
            StreamComplete: self._take_complete,
            MapReset: self._take_reset,
        }

    @property
    def dropped(self) -> Counter[str]:
        """Number of posed records that were not used, by reason."""
        return self._cycles.dropped

    def takes(self, event: Event) -> bool:
        """Return whether this processor handles an event.

        Raises
        ------
        TypeError
            For a posed record of one of its streams whose class has no handler.
        """
        if getattr(event, "role", None) not in self._roles:
            return False
        if type(event) in self._handlers:
            return True
        if isinstance(event, Posed):
            raise TypeError(f"{event.role}: no handler maps {type(event).__name__} records")
        return False

    def add(self, event: Event, on_planes: OnPlanes = lambda _: None) -> list[CycleResult]:
        """Take one event; return the tilt cycles that are complete now, in order.

        Events of other processors are ignored. `on_planes` is called with the planes of each tilt
        cycle as soon as they are found; the remaining steps take about as long again.
        """
        if not self.takes(event):
            return []
        self._handlers[type(event)](event)
        return [self._result(cycle, on_planes) for cycle in self._cycles.take()]

    def _take_scan(self, posed: PosedScan) -> None:
        keep = used_beams(posed, self.config)
        self._take_record(CycleScan(posed, keep, 0, len(posed.scan.ranges)))

    def _take_image(self, posed: PosedImage) -> None:
        self._take_record(CyclePoints(posed, measure_image(posed, self.config)))

    def _take_cloud(self, posed: PosedCloud) -> None:
        self._take_record(CyclePoints(posed, measure_cloud(posed, self.config)))

    def _take_record(self, record: CycleRecord) -> None:
        self._odom_frame, self._base_frame = record.posed.odom_frame, record.posed.base_frame
        self._cycles.add(record)

    def _take_angle(self, sample: TiltAngle) -> None:
        self._cycles.add_tilt(*sample)

    def _take_complete(self, complete: StreamComplete) -> None:
        self._cycles.add_complete(*complete)

    def _take_reset(self, reset: MapReset) -> None:
        self.clear_map()

    def finish(self, on_planes: OnPlanes = lambda _: None) -> list[CycleResult]:
        """Close the open tilt cycle at the end of the input; return the complete cycles."""
        return [self._result(cycle, on_planes) for cycle in self._cycles.finish()]

    def reset(self) -> None:
        """Clear the map and restart the count of tilt cycles from 0."""
        self.clear_map()
        dropped = self.dropped
        self._cycles = CycleBuilder(self.config, self._rule)
        self._cycles.dropped = dropped

    def take_view(self) -> None:
        """Publish the surfaces of the next tilt cycle even if `views.when` excludes it."""
        self._view_is_asked = True

    def clear_map(self) -> None:
        """Clear the map and the open tilt cycle."""
        self.counts["resets"] += 1
        self._cycles.clear()
        self.map.clear()
        self.seen_free.clear()
        self._planes.reset()
        self._objects.reset()

    def query(self) -> MapQuery:
        """Return a snapshot of the map for queries (`cuboids.queries`)."""
        return MapQuery(self.map, self.seen_free)

    def _result(self, cycle: TiltCycleData, on_planes: OnPlanes) -> CycleResult:
        """Merge a tilt cycle with the map, find planes and objects, and make the messages."""
        self._merge(cycle)
        part, T_odom_base = cycle.part, cycle.T_odom_base()
        cuboids = part.cuboids() if self.config.planes.source == "part" else self.map.cuboids()
        fits = DETECTORS[self.config.planes.detector](
            cuboids, self.config, cycle.T_odom_sensor()[:3, 3]
        )
        planes = self._planes.update(fits)
        on_planes(CyclePlanes(cycle.stamp_ns, self._odom_frame, planes))
        objects = self._objects.update(find_objects(cuboids, fits, planes, self.config))
        speed, angular_speed = cycle.base_speeds()
        wanted = self._is_view_wanted(speed, angular_speed)
        surfaces, view = self._surfaces_and_view(cycle, fits, wanted)
        base = self._base_frame
        return CycleResult(
            cycle=part.cycle,
            stamp_ns=cycle.stamp_ns,
            start_ns=part.start_ns,
            end_ns=part.end_ns,
            frame_id=self._odom_frame,
            base_frame_id=base,
            T_odom_base=T_odom_base,
            planes=planes,
            objects=objects,
            surfaces=surfaces,
            view=view,
            boxes=object_boxes(cycle, fits, planes, self.config, T_odom_base, base, wanted),
            part=part,
            scans=len(cycle.records),
            base_speed=speed,
            base_angular_speed=angular_speed,
            ended_by=cycle.span.reason,
        )

    def _merge(self, cycle: TiltCycleData) -> None:
        """Add the part map of a tilt cycle to the map, and count its records."""
        if self.config.map.clear_seen_through:
            cycle.part = add_voids(cycle, self.map, self.config)
        self.map.add(cycle.part)
        self.counts["cycles"] += 1
        self.counts["scans used"] += count_begun(cycle.records)
        self.used.update(record.posed.role for record in cycle.records if record.is_whole)

    def _is_view_wanted(self, speed: float, angular_speed: float) -> bool:
        """Return whether `views.when` or `take_view` asks for the surfaces of this tilt cycle."""
        asked, self._view_is_asked = self._view_is_asked, False
        return asked or self.config.views.when == "always" or is_still(speed, angular_speed)

    def _surfaces_and_view(
        self, cycle: TiltCycleData, fits: PlaneFits, wanted: bool
    ) -> tuple[SurfaceCloud, ViewIntervals]:
        """Return the messages with the points and the free space; both empty if not wanted."""
        T_odom_base, base = cycle.T_odom_base(), self._base_frame
        view = view_intervals(cycle, self.config, T_odom_base, base)
        self.seen_free.add(cycle.part.cycle, T_odom_base, view)
        # As published, segmentation needs a 3D scan: a single scan line always fits a plane.
        can_segment = (
            self._segmentation is None or cycle.swept_angle() >= self.config.cycle.min_sweep
        )
        surfaces = surface_cloud(
            cycle,
            fits,
            T_odom_base,
            cycle.T_odom_sensor()[:3, 3],
            base,
            wanted and can_segment,
            self.config,
            self._segmentation,
        )
        if not wanted:
            return surfaces, replace(view, intervals=view.intervals[:0])
        return surfaces, replace(view, hits=hits_near(cycle, fits, surfaces, T_odom_base))
