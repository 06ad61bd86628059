"""Write a replay or a saved map as a Rerun recording.

Measurements are logged at their stamps, in the odometry frame or that of their sensor. The poses of
these frames, and surfaces, objects and signs, are those of the final solution. Each surface, object
and sign is logged at the time at which it was first seen, so that the map grows while the recording
plays.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike
from PIL import Image

from tccm_ros.arrays import Float64
from tccm_ros.atomic import output_file
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, spatial
from tccm_ros.outlines.triangulation import fill_outline
from tccm_ros.records import Event, PlaneRecord, Posed, PosedScan, Surface
from tccm_ros.replay.outcome import Outcome
from tccm_ros.report import palette
from tccm_ros.results.cycles_file import CycleParts
from tccm_ros.sensors.depth_image import PosedImage
from tccm_ros.sensors.laser_scan import project, used_beams
from tccm_ros.sensors.point_cloud import PosedCloud
from tccm_ros.surfaces.scene import surface_pose
from tccm_ros.surfaces.surface_slam import SurfaceSolution

STAMP = "stamp"
"""Name of the timeline, which has message stamps."""

ODOM = "map/odom"
BASE = "map/odom/base"
"""Entities of the frames; their children move with them."""

MAX_IMAGE_WIDTH = 320
"""Maximum width of depth images after thinning, pixels: a megapixel a second fills a disk."""

MAX_POINTS = 20_000
"""Maximum number of points of a cloud after thinning. Chosen: it is still recognisable."""

WALL_HEIGHT_M = 0.9
"""Drawn height of walls, as in the report."""

AXIS_M = 0.3
"""Drawn length of the base's arrow, m."""

RADIUS_M = 0.008
"""Drawn radius of points and lines, m."""


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
        self._config, self._stream = config, stream
        self._poses: dict[int, Float64] = {}
        self._sensors: dict[str, Posed] = {}
        self._images: list[str] = []
        stream.set_log_tick_enabled(False)
        stream.set_log_time_enabled(False)
        stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    # --- while a replay runs ---

    def add(self, event: Event) -> None:
        """Log a sensor measurement; ignore other events."""
        if not isinstance(event, Posed):
            return
        self._poses[int(event.pose_stamps_ns[0])] = event.T_odom_base[0]
        self._at(event.stamp_ns)
        if isinstance(event, PosedScan):
            points, _ = project(event, used_beams(event, self._config))
            self._points(f"{ODOM}/{event.role}", points)
        elif isinstance(event, PosedImage):
            self._image(event)
        elif isinstance(event, PosedCloud):
            self._place_sensor(event)
            points = event.record.points
            step = -(-len(points) // MAX_POINTS) or 1
            self._points(f"{BASE}/{event.role}", points[::step])

    def _at(self, stamp_ns: int) -> None:
        self._stream.set_time(STAMP, timestamp=np.datetime64(stamp_ns, "ns"))

    def _points(self, entity: str, points: Float64) -> None:
        near = np.asarray(points, np.float32)
        self._stream.log(entity, rr.Points3D(near, radii=RADIUS_M, colors=rgb(palette.VIEW)))

    def _place_sensor(self, event: Posed) -> None:
        """Log the pose of a sensor on the base if it has changed."""
        before = self._sensors.get(event.role)
        if before is None or not np.array_equal(before.T_base_sensor[0], event.T_base_sensor[0]):
            self._stream.log(f"{BASE}/{event.role}", _transform(event.T_base_sensor[0]))
            self._sensors[event.role] = event

    def _image(self, event: PosedImage) -> None:
        """Log a depth image as a PNG in mm, and its camera."""
        image, entity = event.image, f"{BASE}/{event.role}"
        self._place_sensor(event)
        step = -(-image.depth.shape[1] // MAX_IMAGE_WIDTH)
        depth = image.depth[::step, ::step]
        if depth.dtype != np.uint16:
            known = np.isfinite(depth) & (depth > 0.0)
            depth = np.where(known, np.clip(depth * 1e3, 0, 65535), 0).astype(np.uint16)
        height, width = depth.shape
        if image.camera is not None:
            matrix = image.camera.P[:, :3] if image.is_rectified else image.camera.K
            size = [width, height]
            K = np.diag([1.0 / step, 1.0 / step, 1.0]) @ matrix
            pinhole = rr.Pinhole(
                image_from_camera=K, resolution=size, camera_xyz=rr.ViewCoordinates.RDF
            )
            if event.role not in self._images:
                self._stream.log(entity, pinhole, static=True)
                self._images.append(event.role)
        packed = io.BytesIO()
        Image.fromarray(np.ascontiguousarray(depth)).save(packed, "PNG", compress_level=1)
        encoded = rr.EncodedDepthImage(blob=packed.getvalue(), media_type="image/png", meter=1000.0)
        self._stream.log(f"{entity}/depth", encoded)

    # --- after the solution ---

    def finish(self, outcome: Outcome, parts: CycleParts) -> None:
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
        T_map_odom = spatial(solution.slam.pose_at(stamps)) @ inverse(T_odom_base)
        for entity, T in ((ODOM, T_map_odom), (BASE, T_odom_base)):
            columns = rr.Transform3D.columns(translation=T[:, :3, 3], mat3x3=T[:, :3, :3])
            self._stream.send_columns(entity, [_times(stamps)], columns)
        arrow = rr.Arrows3D(vectors=[[AXIS_M, 0.0, 0.0]], colors=rgb(palette.VIEW), radii=0.03)
        self._stream.log(f"{BASE}/heading", arrow, static=True)

    def _log_planes(self, planes: Sequence[PlaneRecord]) -> None:
        known = [plane for plane in planes if len(plane.boundary) > 2]
        lines = rr.LineStrips3D(
            [with_first_point(plane.boundary) for plane in known],
            colors=[rgb(palette.PALETTE[p.id % len(palette.PALETTE)]) for p in known],
            radii=RADIUS_M,
        )
        self._stream.log(f"{ODOM}/planes", lines)

    def _log_parts(self, parts: CycleParts) -> None:
        """Log the coarse part map of each tilt cycle as boxes, in the odometry frame."""
        for k, stamp_ns in enumerate(parts.stamps_ns.tolist()):
            chosen = slice(*parts.offsets[k : k + 2].tolist())
            low, high = parts.bottom[chosen] * 0.01, parts.top[chosen] * 0.01
            xy = (np.stack([parts.ix[chosen], parts.iy[chosen]], axis=1) + 0.5) * parts.cell_size
            half = np.full((len(low), 3), 0.5 * parts.cell_size)
            half[:, 2] = 0.5 * (high - low)
            centers = np.column_stack([xy, 0.5 * (low + high)]).astype(np.float32)
            self._at(stamp_ns)
            boxes = rr.Boxes3D(
                centers=centers, half_sizes=half.astype(np.float32), fill_mode="solid",
                colors=rgb("#9fb3c8"),
            )  # fmt: skip
            self._stream.log(f"{ODOM}/part_map", boxes)

    def add_map(self, solution: SurfaceSolution) -> None:
        """Log surfaces, objects, signs, walls, loops, views and the path of a solution."""
        colors = _colors(solution.surfaces)
        floor = solution.floor_z or 0.0
        for surface in solution.surfaces:
            self._log_surface(surface, floor, colors[surface.id])
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

    def _log_surface(self, surface: Surface, floor: float, color: str) -> None:
        self._at(surface.first_seen_ns)
        entity = f"map/surfaces/{surface.id}"
        mesh = fill_outline(surface.boundary, surface.holes, surface.normal)
        alpha = 60 if surface.label == "floor" else 180
        faces = rr.Mesh3D(
            vertex_positions=mesh.points, triangle_indices=mesh.triangles,
            vertex_colors=np.tile([*rgb(color), alpha], (len(mesh.points), 1)),
        )  # fmt: skip
        if len(mesh.triangles):
            self._stream.log(entity, faces)
        T, _ = surface_pose(surface)
        name = f"{surface.label} {surface.id}, {surface.height - floor:.2f} m"
        if surface.label != "floor":
            label = rr.Points3D([T[:3, 3]], labels=[name], colors=rgb(color), radii=0.01)
            self._stream.log(f"{entity}/name", label)
            self._stream.log("events", rr.TextLog(f"first seen: {name}"))
        outline = rr.LineStrips3D(
            [with_first_point(surface.boundary)], colors=rgb(color), radii=RADIUS_M
        )
        self._stream.log(f"{entity}/outline", outline)

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
        for sign in solution.slam.signs:
            self._at(min((view.stamp_ns for view in sign.views), default=solution.stamp_ns))
            arrow = sign_arrow(sign.position, sign.normal, sign.text)
            self._stream.log(f"map/signs/{sign.id}", arrow)

    def _log_walls(self, solution: SurfaceSolution, floor: float) -> None:
        faces = []
        for wall in solution.slam.walls:
            low = np.column_stack([wall.endpoints, np.full(2, floor)])
            high = low + np.array([0.0, 0.0, WALL_HEIGHT_M])
            faces.append(with_first_point(np.vstack([low, high[::-1]])))
        self._lines("map/walls", faces, palette.WALL)

    def _log_loops(self, solution: SurfaceSolution, floor: float) -> None:
        at = {k.id: np.array([*k.pose[:2], floor]) for k in solution.slam.keyframes}
        for entity, accepted in (("map/loops", True), ("map/rejected_loops", False)):
            ends = [
                np.stack([at[loop.from_id], at[loop.to_id]])
                for loop in solution.slam.loops
                if loop.accepted is accepted and {loop.from_id, loop.to_id} <= at.keys()
            ]
            self._lines(entity, ends, "#009e73" if accepted else "#d55e00")

    def _lines(self, entity: str, strips: Sequence[Float64], color: str) -> None:
        """Log lines that are visible at all times."""
        lines = rr.LineStrips3D(strips, colors=rgb(color), radii=RADIUS_M)
        self._stream.log(entity, lines, static=True)

    def blueprint(self) -> rrb.Blueprint:
        """Return the layout: the map in 3D, with depth cameras and events beside it."""
        hidden = [f"- /{ODOM}/{name}/**" for name in ("part_map", "planes")]
        hidden.append("- /map/rejected_loops/**")
        space = rrb.Spatial3DView(origin="/map", contents=["+ /map/**", *hidden], name="Map")
        beside: list[rrb.View] = [
            rrb.Spatial2DView(origin=f"/{BASE}/{role}", name=role) for role in self._images
        ]
        parts = rrb.Spatial3DView(
            origin="/map", contents=[f"+ /{ODOM}/**", "+ /map/walls"], name="Newest tilt cycle"
        )
        events = rrb.TextLogView(origin="/events", name="Events")
        column = rrb.Vertical(*beside, parts, events)
        return rrb.Blueprint(
            rrb.Horizontal(space, column, column_shares=[3, 1]),
            rrb.TimePanel(state="collapsed", timeline=STAMP),
            collapse_panels=True,
        )


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
        stream.send_blueprint(log.blueprint())
        stream.flush()
        stream.disconnect()


def sign_arrow(position: ArrayLike, normal: ArrayLike, text: str) -> rr.Arrows3D:
    """Return a door sign as an arrow along its normal, with its text."""
    along = AXIS_M * np.asarray(normal)
    color = rgb(palette.LANDMARK)
    return rr.Arrows3D(origins=[position], vectors=[along], labels=[text], colors=color)


def _times(stamps_ns: Iterable[int]) -> rr.TimeColumn:
    return rr.TimeColumn(STAMP, timestamp=np.asarray(stamps_ns).astype("datetime64[ns]"))


def _transform(T: Float64) -> rr.Transform3D:
    return rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])


def with_first_point(ring: Float64) -> Float64:
    """Return a ring (N, 3) as a closed line (N + 1, 3)."""
    return np.concatenate([ring, ring[:1]])


def rgb(color: str) -> list[int]:
    """Return a colour ``#rrggbb`` as three numbers."""
    return [int(color[k : k + 2], 16) for k in (1, 3, 5)]


def _colors(surfaces: Sequence[Surface]) -> dict[int, str]:
    """Return a palette colour for each surface, pale for the floor."""
    cycle = len(palette.PALETTE)
    return {
        s.id: palette.FLOOR if s.label == "floor" else palette.PALETTE[s.id % cycle]
        for s in surfaces
    }
