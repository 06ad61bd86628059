"""Write a replay or a saved map as a Rerun recording.

Measurements are logged at their stamps, in the odometry frame or that of their sensor. The poses of
these frames, and surfaces, objects and signs, are those of the final solution. Each surface, object
and sign is logged at the time at which it was first seen, so that the map grows while the recording
plays.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr

from tccm_ros.arrays import Float64
from tccm_ros.atomic import output_file
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, spatial
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.outlines.triangulation import fill_outline
from tccm_ros.records import Event, PlaneRecord, Posed, Surface
from tccm_ros.replay.outcome import ReplayOutcome
from tccm_ros.report import palette
from tccm_ros.results.cycles_file import CycleParts
from tccm_ros.scene.scene import surface_pose
from tccm_ros.view.rerun_sensors import SensorLog
from tccm_ros.view.rerun_shapes import (
    BASE,
    ODOM,
    STAMP,
    begin,
    blueprint,
    line_strips,
    log_heading,
    log_part,
    log_planes,
    log_surface,
    rgb,
    set_stamp,
    sign_arrow,
    wall_face,
    with_first_point,
)


class RerunLog:
    """Logs a replay to a Rerun recording.

    Parameters
    ----------
    config
        Configuration of the replay.
    stream
        Output stream; the caller opens and closes it.
    """

    def __init__(self, config: Config, stream: rr.RecordingStream):
        self._stream, self._sensors = stream, SensorLog(config, stream)
        self._poses: dict[int, Float64] = {}
        begin(stream)

    # --- while a replay runs ---

    def add(self, event: Event) -> None:
        """Log a sensor measurement; ignore other events."""
        if isinstance(event, Posed):
            self._poses[int(event.pose_stamps_ns[0])] = event.T_odom_base[0]
            self._sensors.add(event)

    def _at(self, stamp_ns: int) -> None:
        set_stamp(self._stream, stamp_ns)

    # --- after the solution ---

    def finish(self, outcome: ReplayOutcome, parts: CycleParts) -> None:
        """Log the frames, the tilt cycles and the map of a finished replay."""
        solution = outcome.solution
        self._log_frames(solution)
        for cycle in outcome.cycles:
            self._at(cycle.stamp_ns)
            self._log_planes(cycle.planes)
        self._log_parts(parts)
        self.add_map(solution)
        for stamp_ns, change in outcome.changes:
            self._at(stamp_ns)
            self._stream.log("events", rr.TextLog(str(change)))

    def _log_frames(self, solution: SurfaceSolution) -> None:
        """Log the odometry frame in map and the base in it at each stamp with a pose."""
        stamps = np.array(sorted(self._poses), np.int64)
        if not len(stamps):
            return
        T_odom_base = np.array([self._poses[stamp] for stamp in stamps.tolist()])
        T_map_odom = spatial(solution.graph.pose_at(stamps)) @ inverse(T_odom_base)
        for entity, T in ((ODOM, T_map_odom), (BASE, T_odom_base)):
            columns = rr.Transform3D.columns(translation=T[:, :3, 3], mat3x3=T[:, :3, :3])
            self._stream.send_columns(entity, [_times(stamps)], columns)
        log_heading(self._stream, BASE)

    def _log_planes(self, planes: Sequence[PlaneRecord]) -> None:
        known = [plane for plane in planes if len(plane.boundary) > 2]
        log_planes(self._stream, {p.id: with_first_point(p.boundary) for p in known})

    def _log_parts(self, parts: CycleParts) -> None:
        """Log the coarse part map of each tilt cycle, in the odometry frame."""
        table = np.array([parts.ix, parts.iy, parts.bottom, parts.top], np.int64)
        for k, stamp_ns in enumerate(parts.stamps_ns.tolist()):
            self._at(stamp_ns)
            log_part(self._stream, table[:, slice(*parts.offsets[k : k + 2])], parts.cell_size)

    def add_map(self, solution: SurfaceSolution) -> None:
        """Log surfaces, objects, signs, walls, loops, views and the path of a solution."""
        floor = solution.floor_z or 0.0
        for surface in solution.surfaces:
            self._log_surface(surface, floor)
        self._log_objects(solution)
        self._log_signs(solution)
        self._log_walls(solution, floor)
        self._log_loops(solution, floor)
        path = np.column_stack(
            [solution.trajectory[:, :2], np.full(len(solution.trajectory), floor)]
        )
        self._lines("map/path", [path] if len(path) > 1 else [], palette.PATH)
        for stamp_ns, T in zip(solution.view_stamps_ns.tolist(), solution.T_map_views):
            self._at(stamp_ns)
            views = rr.Points3D([T[:3, 3]], colors=rgb(palette.VIEW), radii=0.03)
            self._stream.log("map/views", views)

    def _log_surface(self, surface: Surface, floor: float) -> None:
        self._at(surface.first_seen_ns)
        name = ""
        if surface.label != "floor":
            name = f"{surface.label} {surface.id}, {surface.height - floor:.2f} m"
            self._stream.log("events", rr.TextLog(f"first seen: {name}"))
        mesh = fill_outline(surface.boundary, surface.holes, surface.normal)
        T, _ = surface_pose(surface)
        entity = f"map/surfaces/{surface.id}"
        color = palette.color_by_id(surface.id, surface.label)
        log_surface(self._stream, entity, mesh, color, name, T[:3, 3])

    def _log_objects(self, solution: SurfaceSolution) -> None:
        for item in solution.objects:
            self._at(item.first_seen_ns)
            box = rr.Boxes3D(
                centers=[item.center], sizes=[item.size],
                rotation_axis_angles=[rr.RotationAxisAngle([0, 0, 1], radians=item.yaw)],
                colors=rgb(palette.OBJECT), labels=[item.class_id or f"object {item.id}"],
                show_labels=bool(item.class_id),
            )  # fmt: skip
            self._stream.log(f"map/objects/{item.id}", box)

    def _log_signs(self, solution: SurfaceSolution) -> None:
        for sign in solution.graph.signs:
            self._at(min((view.stamp_ns for view in sign.views), default=solution.stamp_ns))
            arrow = sign_arrow(sign.position, sign.normal, sign.text)
            self._stream.log(f"map/signs/{sign.id}", arrow)

    def _log_walls(self, solution: SurfaceSolution, floor: float) -> None:
        faces = [wall_face(wall.endpoints, floor) for wall in solution.graph.walls]
        self._lines("map/walls", faces, palette.WALL)

    def _log_loops(self, solution: SurfaceSolution, floor: float) -> None:
        at = {k.id: np.array([*k.pose[:2], floor]) for k in solution.graph.keyframes}
        for entity, accepted in (("map/loops", True), ("map/rejected_loops", False)):
            ends = [
                np.stack([at[loop.from_id], at[loop.to_id]])
                for loop in solution.graph.loops
                if loop.accepted is accepted and {loop.from_id, loop.to_id} <= at.keys()
            ]
            self._lines(entity, ends, "#009e73" if accepted else "#d55e00")

    def _lines(self, entity: str, strips: Sequence[Float64], color: str) -> None:
        """Log lines that are visible at all times."""
        self._stream.log(entity, line_strips(strips, color), static=True)

    @property
    def cameras(self) -> list[str]:
        """Roles of the depth cameras that were logged."""
        return self._sensors.cameras


@contextmanager
def rerun_file(path: Path | str, config: Config) -> Iterator[RerunLog]:
    """Yield a log that writes an .rrd, which is complete when the context ends without an error.

    Parameters
    ----------
    path
        Output file; an older one is replaced.
    config
        Configuration of the replay or the map.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with output_file(path) as made:
        stream = rr.RecordingStream("tccm_ros", recording_id=Path(path).stem)
        stream.save(made)
        log = RerunLog(config, stream)
        yield log
        stream.send_blueprint(blueprint(log.cameras))
        stream.flush()
        stream.disconnect()


def _times(stamps_ns: Iterable[int]) -> rr.TimeColumn:
    return rr.TimeColumn(STAMP, timestamp=np.asarray(stamps_ns).astype("datetime64[ns]"))
