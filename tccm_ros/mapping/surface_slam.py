"""`SurfaceSlam`, the processor that builds a surface map from level scans, odometry and views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.baselines.distance_merging import merge_by_distance
from tccm_ros.baselines.line_ransac import label_by_ransac
from tccm_ros.config import Config
from tccm_ros.geometry import compose2, inverse, planar, spatial
from tccm_ros.mapping.saved_map import SavedMap, SavedView, views_in_map
from tccm_ros.racks.compartment import Compartment, SeenView
from tccm_ros.racks.compartments import find_compartments
from tccm_ros.racks.unseen_space import UnseenSpace, unseen_spaces
from tccm_ros.records import (
    Event,
    LabelCorrection,
    LandmarkObservation,
    MapOdom,
    MapReset,
    ObjectBoxes,
    Odometry,
    PoseCovariance,
    PosedScan,
    PoseGuess,
    RollPitch,
    Room,
    ScanPose,
    Surface,
    SurfaceCloud,
    ViewIntervals,
)
from tccm_ros.rooms.naming import named_rooms, placed_surfaces
from tccm_ros.rooms.segmentation import find_rooms
from tccm_ros.sensors.detections import PosedDetections
from tccm_ros.sensors.registry import roles_of
from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement
from tccm_ros.slam.base_attitude import with_attitude
from tccm_ros.slam.live_estimate import MapWalls, SolvedKeyframe
from tccm_ros.slam.occupancy import OccupancyGrid, occupancy_grid
from tccm_ros.slam.solution import Solution
from tccm_ros.slam.tracking import SolvedMap
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.slam.walls.lines import label_by_splitting
from tccm_ros.stages import OptionalStages
from tccm_ros.surfaces.labels.corrected_labels import corrected_labels
from tccm_ros.surfaces.object_labels import (
    MAX_WAIT_NS,
    NO_VIEW,
    PlacedDetections,
    SeenDetection,
    count_unused,
    seen_detections,
    view_of,
)
from tccm_ros.surfaces.objects.object_tracks import NO_OBJECTS, TrackedObjects, track_objects
from tccm_ros.surfaces.objects.scene_objects import SceneObject, free_places, scene_objects
from tccm_ros.surfaces.registration.registration import Z_ROLL_PITCH, Registration
from tccm_ros.surfaces.registration.session_alignment import SessionAlignment, align_session
from tccm_ros.surfaces.surface_map import MappedSurfaces, SurfaceMap, ViewPoses
from tccm_ros.surfaces.views.views import View, with_newest

SlamInput = (
    Event
    | LabelCorrection
    | LandmarkObservation
    | ObjectBoxes
    | PoseGuess
    | SearchedPicture
    | SignMeasurement
    | SurfaceCloud
    | ViewIntervals
)

MAX_STATIONARY_MOTION = (0.01, 0.005)
"""Maximum motion (m, rad) of a stationary base; chosen."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfaceSolution:
    """Trajectory, walls and surfaces after one optimisation (a batch if `is_final`).

    Attributes
    ----------
    graph
        Keyframes, walls, loops and poses; in the frame of this session if it is not aligned.
    view_stamps_ns, T_map_views
        int64 (V,), increasing, and float64 (V, 4, 4): stamps and poses of the views of this
        session.
    view_poses
        Poses of all views, those of a saved map first.
    mapped
        Surfaces, floor and points.
    trajectory_ns, trajectory
        int64 (N,) and float64 (N, 3): planar pose of base in map for each level scan, or for each
        tilt scan without a level laser.
    objects
        Objects on the surfaces, by surface and id.
    rooms
        Rooms between the walls, from the largest to the smallest, named by door signs.
    free_places
        Free places on the surfaces, by surface id (`scene_objects.free_places`).
    place_size
        Width and depth of an item for which places are free, m.
    alignment
        Alignment of this session with a saved map; None if there is nothing to align.
    stamp_ns
        Stamp of the newest event that it contains; 0 before the first.
    newest_detections
        Detections after the newest view, which belong to the next view.
    unused_detections
        Number of detections that gave no label, by reason.
    corrected_labels
        User-supplied labels by surface id.
    grid
        Occupancy grid of the level laser; None without one.
    stages
        Runs the optional stages that depend on this map, and counts their failures.
    attitudes
        float64 (N, 3), height, roll and pitch of the base along `trajectory`; empty if odometry
        does not provide them.
    compartments
        Compartments of racks, by rack and height.
    unseen
        Unseen space below surfaces; empty without `surfaces.unseen_space`.
    saved_walls
        Walls and level scans as arrays, for a later session; empty without a level laser.
    tracked
        The objects before they are assigned to surfaces.
    """

    graph: Solution
    view_stamps_ns: Int64
    T_map_views: Float64
    view_poses: ViewPoses
    mapped: MappedSurfaces
    trajectory_ns: Int64
    trajectory: Float64
    objects: tuple[SceneObject, ...] = ()
    rooms: tuple[Room, ...] = ()
    free_places: Mapping[int, list[Float64]] = field(default_factory=dict)
    place_size: tuple[float, float] = (0.0, 0.0)
    alignment: SessionAlignment | None = None
    stamp_ns: int = 0
    newest_detections: tuple[SeenDetection, ...] = ()
    unused_detections: Mapping[str, int] = field(default_factory=dict)
    corrected_labels: Mapping[int, str] = field(default_factory=dict)
    grid: OccupancyGrid | None = None
    stages: OptionalStages = field(default_factory=OptionalStages)
    attitudes: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    compartments: tuple[Compartment, ...] = ()
    unseen: tuple[UnseenSpace, ...] = ()
    saved_walls: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    tracked: TrackedObjects = NO_OBJECTS

    @property
    def T_map_base(self) -> Float64:
        """The poses of the trajectory, float64 (N, 4, 4)."""
        return with_attitude(self.trajectory, self.attitudes)

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """The surfaces in order of their ids."""
        return self.mapped.surfaces

    @property
    def floor_z(self) -> float | None:
        """Height of the floor in map, m; None if it was never seen."""
        return self.mapped.floor_z


class SurfaceSlam:
    """Wall SLAM and surface map of one session: add events as they come, solve for a map.

    Parameters
    ----------
    config
        All groups but those of the TCCM.

    Attributes
    ----------
    counts
        ``level scans`` matched, ``clouds``, ``views``, ``boxes``, ``signs`` and ``detections``
        received, ``views while lost`` and ``detections while lost`` (which are not used),
        ``resets``.
    odom_frame
        Name of the odometry frame.
    """

    def __init__(self, config: Config):
        self.config = config
        self.counts: Counter[str] = Counter()
        self.odom_frame = config.frames.odom_name
        # Roles of its streams; None is for events without a role.
        self._roles = {None, *roles_of("slam", config)}
        self.session = 0
        self.saved_views: tuple[SavedView, ...] = ()
        self._saved_walls: Mapping[str, NDArray[Any]] = {}
        # Walls of a map in which another program localises the robot: saved unchanged.
        self._kept_walls: Mapping[str, NDArray[Any]] = {}
        self._begin()

    def _begin(self) -> None:
        """Start a session, with the saved map if there is one."""
        self.wall_slam = (
            WallSlam.from_saved(self.config, self._saved_walls, _label_lines)
            if self._saved_walls
            else WallSlam(self.config, _label_lines)
        )
        self._handlers: dict[type, Callable[[Any], ScanPose | None]] = {
            PosedScan: self._take_scan,
            Odometry: self._take_odometry,
            RollPitch: self.wall_slam.add_roll_pitch,
            MapOdom: self.wall_slam.add_map_odom,
            PoseCovariance: self.wall_slam.add_pose_covariance,
            LandmarkObservation: self.wall_slam.add_landmark,
            SignMeasurement: self._take_sign,
            SearchedPicture: self.wall_slam.add_picture,
            PoseGuess: self.wall_slam.add_guess,
            LabelCorrection: self._take_correction,
            MapReset: self._take_reset,
            SurfaceCloud: partial(self._take_view, "clouds"),
            ViewIntervals: partial(self._take_view, "views"),
            ObjectBoxes: partial(self._take_view, "boxes"),
            PosedDetections: self._take_detections,
        }
        self.map = self._empty_map(self.session)
        self._registration = Registration(self.config, self.map.carver, self.map.remainders)
        for saved in self.saved_views:
            self.map.add_view(saved.view)
        self._tilt_stamps: set[int] = set()
        self._newest_ns = 0
        self._detections: list[PlacedDetections] = []
        self._unusable: Counter[str] = Counter()

    def _empty_map(self, session: int = 0) -> SurfaceMap:
        """Return a map without views, with the configured merging."""
        is_published = self.config.surfaces.segmentation == "seed"
        return SurfaceMap(self.config, session, merge_by_distance if is_published else None)

    @property
    def saved_keyframes(self) -> int:
        """Number of keyframes of the saved map that this session continues."""
        return len(self._saved_walls.get("keyframe_stamp_ns", ()))

    def takes(self, event: SlamInput) -> bool:
        """Return whether this processor handles an event."""
        return type(event) in self._handlers and getattr(event, "role", None) in self._roles

    def add(self, event: SlamInput) -> list[ScanPose]:
        """Process one event; return the pose of a level scan, and nothing for other events.

        Landmarks, signs, surface clouds and intervals may arrive in any order; they are associated
        by their stamps. Events for other processors are ignored.
        """
        if not self.takes(event):
            return []
        pose = self._handlers[type(event)](event)
        self._newest_ns = max(self._newest_ns, getattr(event, "stamp_ns", 0))
        return [] if pose is None else [pose]

    def _take_scan(self, posed: PosedScan) -> ScanPose | None:
        self.odom_frame = posed.odom_frame
        self.counts["level scans"] += 1
        if self.config.localisation.is_external:
            self.wall_slam.add_scan_of_walls(posed)
            return None
        return self.wall_slam.add_scan(posed)

    def _take_sign(self, sign: SignMeasurement) -> None:
        self.counts["signs"] += 1
        self.wall_slam.add_sign(sign)

    def _take_correction(self, correction: LabelCorrection) -> None:
        self.map.correct_label(correction)
        views = {view.key: view for view in self.map.views}
        self.saved_views = tuple(replace(s, view=views[s.view.key]) for s in self.saved_views)

    def _take_odometry(self, record: Odometry) -> None:
        self.odom_frame = record.frame_id or self.odom_frame
        self.wall_slam.add_odometry(record.stamp_ns, record.T_odom_base)

    def _take_view(self, counted: str, part: ObjectBoxes | SurfaceCloud | ViewIntervals) -> None:
        self.counts[counted] += 1
        if self.wall_slam.is_lost:
            self.counts["views while lost"] += 1
            return
        self.map.add(part)
        self.map.forget(self._is_stationary)

    def _take_detections(self, posed: PosedDetections) -> None:
        detections = posed.detections
        self.counts["detections"] += len(detections.hypotheses)
        self._unusable.update(detections.unusable)
        if self.wall_slam.is_lost:
            self.counts["detections while lost"] += len(detections.hypotheses)
            return
        is_in_map = detections.frame_id == self.config.frames.map_name
        center = detections.center if is_in_map else posed.center_base
        placed = PlacedDetections(posed.stamp_ns, center, detections.hypotheses, is_in_map)
        self._detections.append(placed)

    def _take_reset(self, reset: MapReset) -> None:
        """Restart the session: stamps before and after a jump cannot be compared."""
        self.counts["resets"] += 1
        self._begin()

    def _is_stationary(self, first_ns: int, last_ns: int) -> bool:
        """Return whether the base did not move between two stamps."""
        motion = self.wall_slam.motion_between(first_ns, last_ns)
        if motion is None:
            return False
        return bool(
            np.hypot(motion[0], motion[1]) <= MAX_STATIONARY_MOTION[0]
            and abs(motion[2]) <= MAX_STATIONARY_MOTION[1]
        )

    def add_pose_stamp(self, stamp_ns: int) -> None:
        """Add the stamp of a tilt scan; without a level laser the trajectory has its pose."""
        self._tilt_stamps.add(stamp_ns)

    def solve(
        self,
        *,
        is_final: bool = True,
        with_racks: bool = True,
        stages: OptionalStages | None = None,
    ) -> SurfaceSolution:
        """Rebuild the graph in stamp order, register the views and build the surfaces.

        Parameters
        ----------
        is_final
            Whether the graph is solved as a batch at any size.
        with_racks
            Whether compartments of racks and unseen space are found; each compartment takes a tenth
            of a second.
        stages
            Runs the optional stages that depend on the map.
        """
        is_lost, stages = self._is_lost, stages or OptionalStages()
        views = [view for view in self.map.views if view.session == self.session and not is_lost]
        graph = self._solve_graph(views, is_final=is_final)
        own = _view_poses(graph)
        alignment = self._align_session(views, own.T_map_view)
        T_map_session = np.eye(4) if alignment is None else alignment.T_map_session
        own = replace(own, T_map_view=T_map_session @ own.T_map_view)
        is_found = not is_lost and (alignment is None or alignment.found)
        surface_map = self.map if is_found else self._saved_map()
        view_poses = self._all_poses(graph, own) if is_found else self._saved_poses(graph)
        lines = np.array([wall.endpoints for wall in graph.walls]).reshape(-1, 2, 2)
        mapped = surface_map.build(view_poses, lines)
        saved_walls = self._walls_to_save(graph)
        grid = occupancy_grid(saved_walls)
        rooms = stages.run("rooms", lambda: self._rooms(graph, grid)) or ()
        placed = stages.run(
            "names of rooms", lambda: placed_surfaces(mapped.surfaces, rooms, graph.signs)
        )
        surfaces = placed or mapped.surfaces
        mapped = replace(mapped, surfaces=surfaces)
        newest = self._place_detections(views, own.T_map_view, graph) if is_found else ()
        tracked = track_objects(
            with_newest(surface_map.views, newest), view_poses.T_map_view, self.config
        )
        objects = scene_objects(surfaces, tracked.tracks)
        seen = seen_views(surface_map.views, view_poses.T_map_view) if with_racks else None
        compartments, unseen = self._racks(mapped, seen, stages)
        place_size = self.config.objects.place_size
        free = stages.run("free places", lambda: free_places(surfaces, objects, place_size))
        stamps, poses = self._trajectory(graph)
        return SurfaceSolution(
            graph=graph,
            view_stamps_ns=np.array([view.stamp_ns for view in views], np.int64),
            T_map_views=own.T_map_view,
            view_poses=view_poses,
            mapped=mapped,
            trajectory_ns=stamps,
            trajectory=compose2(planar(T_map_session), poses),
            objects=objects,
            rooms=rooms,
            free_places=free or {},
            place_size=place_size,
            alignment=alignment,
            stamp_ns=self._newest_ns,
            newest_detections=newest,
            unused_detections=count_unused(self._unusable, tracked.unused_detections),
            corrected_labels=corrected_labels(surface_map.views),
            grid=grid,
            stages=stages,
            attitudes=graph.attitude_at(stamps) if len(graph.attitudes) else graph.attitudes,
            compartments=compartments,
            unseen=unseen,
            saved_walls=saved_walls,
            tracked=tracked,
        )

    def _racks(
        self, mapped: MappedSurfaces, seen: list[SeenView] | None, stages: OptionalStages
    ) -> tuple[tuple[Compartment, ...], tuple[UnseenSpace, ...]]:
        """Return compartments and unseen space; both are empty without views."""
        if seen is None:
            return (), ()
        surfaces, floor_z = mapped.surfaces, mapped.floor_z or 0.0
        compartments = stages.run("racks", lambda: find_compartments(surfaces, seen))
        unseen = None
        if self.config.surfaces.unseen_space:
            unseen = stages.run("unseen", lambda: unseen_spaces(surfaces, seen, floor_z))
        return compartments or (), unseen or ()

    def _rooms(self, graph: Solution, grid: OccupancyGrid | None) -> tuple[Room, ...]:
        """Return the rooms between the walls; none without a level laser, or while it is lost."""
        if self._is_lost or grid is None:
            return ()
        outlines = find_rooms([wall.endpoints for wall in graph.walls], grid)
        return named_rooms(outlines, graph.signs)

    def _place_detections(
        self, views: Sequence[View], T_map_view: Float64, graph: Solution
    ) -> tuple[SeenDetection, ...]:
        """Add detections to their views (`view_of`); return those whose next view may still arrive.

        Parameters
        ----------
        views, T_map_view
            Views of this session, and their poses, float64 (V, 4, 4).
        graph
            The optimised graph, in the frame of this session.
        """
        stamps = [view.stamp_ns for view in views]
        still_ns = self._newest_ns - MAX_WAIT_NS
        T_session_view = graph.T_map_views
        newest: list[SeenDetection] = []
        waiting: list[PlacedDetections] = []
        for placed in self._detections:
            v = view_of(placed.stamp_ns, stamps)
            is_open = placed.stamp_ns >= still_ns and (not stamps or placed.stamp_ns > stamps[-1])
            if is_open:
                waiting.append(placed)
            if v is None:
                self._unusable[NO_VIEW] += 0 if is_open else len(placed.hypotheses)
                continue
            T_view = inverse(T_map_view[v])
            if not placed.is_in_map:
                T_view = inverse(T_session_view[v]) @ graph.T_map_base_at(placed.stamp_ns)[0]
            seen = seen_detections(placed, T_view)
            if is_open:
                newest += seen
            else:
                self.map.add_detections(views[v].key, seen)
        self._detections = waiting
        return tuple(newest)

    def _solve_graph(self, views: list[View], *, is_final: bool) -> Solution:
        """Optimise the graph, and again with side factors if views have surfaces in common."""
        stamps = [view.stamp_ns for view in views]
        graph = self.wall_slam.solve(stamps, None, is_final=is_final)
        if not self.config.surfaces.registration or len(views) < 2:
            return graph
        factors = self._registration.side_factors(views, graph)
        if factors:
            graph = self.wall_slam.solve(stamps, factors, is_final=is_final)
        return self._registration.with_adjusted_planes(graph)

    def is_aligned(self, solution: SurfaceSolution) -> bool:
        """Return whether this session was found in the saved map that it continues, if any."""
        if self.saved_keyframes:
            return not self._is_lost
        return solution.alignment is None or solution.alignment.found

    def unplaced_reason(self, solution: SurfaceSolution) -> str:
        """Return why this session was not found in the saved map, without advice for a driver."""
        if self.wall_slam.waits_for_external_pose:
            return "no transform map -> odom has come"
        if solution.alignment is not None:
            return str(solution.alignment.result)
        return self.wall_slam.waits_for.partition(":")[0] or "no place was searched"

    @property
    def _is_lost(self) -> bool:
        """Whether this session is not yet localised in the saved walls, or by another program."""
        is_searched = bool(self.saved_keyframes) and not self.wall_slam.is_first_session_placed
        return is_searched or self.wall_slam.waits_for_external_pose

    def _align_session(self, views: list[View], T_session_view: Float64) -> SessionAlignment | None:
        """Align this session with a saved map without walls; None if there is no such map."""
        if not self.saved_views or self.saved_keyframes or self.config.localisation.is_external:
            return None
        old = [saved.view for saved in self.saved_views]
        T_map_old = np.stack([saved.T_anchor_view for saved in self.saved_views])
        return align_session(old, T_map_old, views, T_session_view, self.config)

    def _saved_map(self) -> SurfaceMap:
        """Return the saved map without this session, which was not found in it."""
        surface_map = self._empty_map()
        for saved in self.saved_views:
            surface_map.add_view(saved.view)
        return surface_map

    def _saved_poses(self, graph: Solution) -> ViewPoses:
        """Return the poses of the saved map's views, which move with their keyframes."""
        keyframes = np.array([saved.keyframe for saved in self.saved_views], np.int64)
        T_anchor_view = np.array([s.T_anchor_view for s in self.saved_views]).reshape(-1, 4, 4)
        poses = np.array([k.pose for k in graph.keyframes]).reshape(-1, 3)
        anchors = np.broadcast_to(np.eye(4), T_anchor_view.shape).copy()
        moves = np.array([saved.is_on_keyframe for saved in self.saved_views], bool)
        anchors[moves] = spatial(poses[keyframes[moves]])
        cov = np.array([saved.cov_z_roll_pitch for saved in self.saved_views]).reshape(-1, 3, 3)
        return ViewPoses(anchors @ T_anchor_view, cov, keyframes)

    def _all_poses(self, graph: Solution, own: ViewPoses) -> ViewPoses:
        old = self._saved_poses(graph)
        return ViewPoses(
            np.concatenate([old.T_map_view, own.T_map_view]),
            np.concatenate([old.cov_z_roll_pitch, own.cov_z_roll_pitch]),
            np.concatenate([old.keyframes, own.keyframes]),
        )

    def _trajectory(self, graph: Solution) -> tuple[Int64, Float64]:
        if self.counts["level scans"] or not self._tilt_stamps:
            return graph.stamps_ns, graph.poses
        stamps = np.array(sorted(self._tilt_stamps), np.int64)
        return stamps, graph.pose_at(stamps)

    def saved(self, solution: SurfaceSolution) -> SavedMap:
        """Return the map that a later session can continue.

        A session that was not found in its saved map leaves that map unchanged.
        """
        state = solution.saved_walls
        if self._is_lost:
            return SavedMap(state, self.saved_views)
        view_poses = solution.view_poses
        solved = with_newest(
            self.map.views[: len(view_poses.keyframes)], solution.newest_detections
        )
        poses = {k.id: spatial(k.pose) for k in solution.graph.keyframes}
        number = self.wall_slam.kept_keyframes()
        views = []
        for view, T, cov, k in zip(
            solved,
            view_poses.T_map_view,
            view_poses.cov_z_roll_pitch,
            view_poses.keyframes.tolist(),
        ):
            is_on_keyframe = state is not self._kept_walls and k in poses
            T_anchor = poses[k] if is_on_keyframe else np.eye(4)
            T_anchor_view = inverse(T_anchor) @ T
            views.append(SavedView(view, number.get(k, k), is_on_keyframe, T_anchor_view, cov))
        return SavedMap(state, tuple(views))

    def _walls_to_save(self, graph: Solution) -> Mapping[str, NDArray[Any]]:
        """Return the walls and level scans of a solution; empty without a level laser."""
        if self._is_lost:
            return self._saved_walls
        is_external = self.config.localisation.is_external
        if is_external or not (self.counts["level scans"] or self.saved_keyframes):
            return self._kept_walls
        return self.wall_slam.saved(graph)

    def solved_map(self, solution: SurfaceSolution) -> SolvedMap:
        """Return the map of a solution and the pose of the robot in it, for a `Tracker`."""
        graph, place = solution.graph, solution.alignment
        p_map_session = np.zeros(3) if place is None else planar(place.T_map_session)
        keyframe = None
        if len(graph.cov_keyframes):
            newest = graph.keyframes[-1]
            pose = compose2(p_map_session, newest.pose)
            keyframe = SolvedKeyframe(newest.id, pose, graph.cov_keyframes[-1])
        return SolvedMap(
            compose2(p_map_session, self.wall_slam.correction(graph)),
            keyframe,
            MapWalls.of(graph.walls, p_map_session),
            self.is_aligned(solution) and not self.wall_slam.is_lost,
            self.wall_slam.placed_by_sign,
            self.wall_slam.is_unjoined,
        )

    def placed_map(self, walls: MapWalls) -> SolvedMap | None:
        """Return the pose of a session in map once it is localised; None until then.

        Parameters
        ----------
        walls
            Walls of the newest solution, in map.
        """
        keyframe = self.wall_slam.placed_keyframe()
        if keyframe is None:
            return None
        p_map_tracking = self.wall_slam.map_from_tracking(keyframe.pose)
        by_sign, is_unjoined = self.wall_slam.placed_by_sign, self.wall_slam.is_unjoined
        return SolvedMap(p_map_tracking, keyframe, walls, True, by_sign, is_unjoined)

    @classmethod
    def from_saved(cls, config: Config, saved: SavedMap) -> SurfaceSlam:
        """Return a processor that continues a saved map in a new session.

        The robot may start anywhere in the map. If another program localises the robot, its poses
        are in the map's frame.

        Raises
        ------
        MapError
            If the saved walls are damaged.
        """
        slam = cls(config)
        slam.session = 1 + max((s.view.session for s in saved.views), default=-1)
        slam.saved_views = saved.views
        if config.localisation.is_external:
            slam.saved_views, slam._kept_walls = views_in_map(saved), saved.walls
        else:
            slam._saved_walls = saved.walls
        slam._begin()
        return slam


def seen_views(views: Sequence[View], T_map_view: Float64) -> list[SeenView]:
    """Return hits and free space of the views that have a viewpoint.

    Parameters
    ----------
    views, T_map_view
        Views, and their poses, float64 (V, 4, 4).
    """
    return [
        SeenView(T, view.viewpoint, view.hits.astype(np.float64), view.free)
        for view, T in zip(views, T_map_view)
        if view.viewpoint is not None
    ]


def _view_poses(graph: Solution) -> ViewPoses:
    cov = graph.cov_views[:, Z_ROLL_PITCH][:, :, Z_ROLL_PITCH]
    return ViewPoses(graph.T_map_views, cov, graph.view_keyframes)


def _label_lines(beams: Float64, config: Config) -> Int32:
    """Label the beams of a scan by line, with the method that `lines.extractor` selects."""
    label = label_by_ransac if config.lines.extractor == "ransac" else label_by_splitting
    return label(beams, config)
