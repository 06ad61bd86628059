"""The surface map: surfaces from all views at their optimised poses.

It is rebuilt from the views after each optimisation. So a loop closure can merge and split
surfaces, and the map depends neither on the order in which views arrive nor on earlier solutions.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Float32, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.records import (
    LabelCorrection,
    ObjectBoxes,
    PreviousPose,
    Surface,
    SurfaceCloud,
    SurfaceEdge,
    SurfaceSighting,
    ViewIntervals,
)
from tccm_ros.surfaces.edges.shapes import Shape, ShapedEdge, fit_shape, free_shape
from tccm_ros.surfaces.identity.recognition import PastPose, adopt_ids, footprint_of
from tccm_ros.surfaces.identity.track_ids import TrackIds, ViewKey
from tccm_ros.surfaces.labels.corrected_labels import (
    corrected_labels,
    label_to_give,
    with_corrected_labels,
    with_corrections,
)
from tccm_ros.surfaces.labels.labels import Label, label_surfaces
from tccm_ros.surfaces.merging.carving import Carver, Survivors, find_replacements
from tccm_ros.surfaces.merging.floor import find_floor, is_floor, join_floor
from tccm_ros.surfaces.merging.joining import join_over_occlusions
from tccm_ros.surfaces.merging.merged_surface import MergedSurface, fit_surface
from tccm_ros.surfaces.merging.merging import (
    Members,
    MergeFunction,
    Remainders,
    clouds_in_map,
    group_patches,
    merge_coplanar,
)
from tccm_ros.surfaces.merging.patch_planes import fit_plane
from tccm_ros.surfaces.merging.surface_errors import surface_errors
from tccm_ros.surfaces.object_labels import SeenDetection
from tccm_ros.surfaces.objects.object_tracks import with_objects_of
from tccm_ros.surfaces.polygons import polygon_rings
from tccm_ros.surfaces.views.views import (
    View,
    empty_view,
    with_cloud,
    with_detections,
    with_intervals,
    with_numbers_of,
    with_objects,
)

LATE_VIEWS = 8
"""Number of newest views among which a late one may still arrive; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewPoses:
    """The poses of all views with their covariances and keyframes.

    Attributes
    ----------
    T_map_view
        float64 (V, 4, 4), in the order of `SurfaceMap.views`.
    cov_z_roll_pitch
        float64 (V, 3, 3), covariances of (z, roll, pitch), m and rad.
    keyframes
        int64 (V,), id of the nearest keyframe of each view; -1: none.
    """

    T_map_view: Float64
    cov_z_roll_pitch: Float64
    keyframes: Int64


@dataclass(frozen=True, slots=True, eq=False)
class MappedSurfaces:
    """The surfaces of one solution.

    Attributes
    ----------
    surfaces
        Surfaces by id.
    floor_z
        Height of the floor in map, m; None: no floor was seen.
    points
        float32 (N, 3), the thinned points in map, by surface, m.
    surface_id
        uint32 (N,), id of each point's surface.
    members
        For each surface, its patches.
    """

    surfaces: tuple[Surface, ...]
    floor_z: float | None
    points: Float32
    surface_id: NDArray[np.uint32]
    members: tuple[Members, ...]


class SurfaceMap:
    """Views in stamp order, independent of their order of arrival, and their surfaces.

    Parameters
    ----------
    config
        Uses the groups ``views``, ``surfaces``, ``objects`` and ``labels``.
    session
        Session of the views that will be added, counted from 0.
    baseline_merge
        Merging of a baseline in place of `merge_coplanar`; nothing is then joined over occluded
        areas. None: no baseline.

    Attributes
    ----------
    carver, remainders
        Carving and remainders, with caches for later solutions.
    """

    def __init__(
        self, config: Config, session: int = 0, baseline_merge: MergeFunction | None = None
    ):
        self._config = config
        self.carver = Carver(config)
        self.remainders = Remainders(config)
        self._session = session
        self._baseline_merge = baseline_merge
        self._views: dict[tuple[int, int], View] = {}
        self._newest_compared = (-1, -1)

    def add(self, record: SurfaceCloud | ViewIntervals | ObjectBoxes) -> None:
        """Add the cloud, the free intervals or the objects of a view.

        Records with the same stamp belong to one view. A second record of one type replaces the
        first.
        """
        key = self._session, record.stamp_ns
        view = self._views.get(key) or empty_view(record.stamp_ns, self._session, self._config)
        if isinstance(record, SurfaceCloud):
            view = with_cloud(view, record, self._config)
        elif isinstance(record, ObjectBoxes):
            view = with_objects(view, record)
        else:
            view = with_intervals(view, record)
        self._views[key] = view

    def add_view(self, view: View) -> None:
        """Add a complete view of a saved map."""
        self._views[view.key] = view

    def add_detections(self, key: tuple[int, int], seen: Sequence[SeenDetection]) -> None:
        """Add detections to the view of a session and stamp."""
        self._views[key] = with_detections(self._views[key], seen)

    def correct_label(self, correction: LabelCorrection) -> None:
        """Set the user-supplied label of a surface, or remove it.

        Raises
        ------
        MapError
            If the label is unknown, or the views have no such surface.
        """
        views = self.views
        labels = corrected_labels(views)
        for number in correction.surfaces:
            labels.pop(number, None)
        if correction.label:
            labels[correction.surfaces[0]] = label_to_give(correction.label)
        self._views = {view.key: view for view in with_corrected_labels(views, labels)}

    def forget(self, is_stationary: Callable[[int, int], bool]) -> None:
        """Remove views that the next view from the same pose makes redundant.

        The newest views are not compared yet, so that the order of arrival has no effect.

        Parameters
        ----------
        is_stationary
            Returns whether the base did not move between two stamps of this session, ns.
        """
        own = [view for view in self.views if view.session == self._session]
        for older, newer in itertools.pairwise(own[: -LATE_VIEWS or None]):
            if newer.key <= self._newest_compared:
                continue
            self._newest_compared = newer.key
            # Both may have inherited numbers from the previous pair.
            older, newer = self._views[older.key], self._views[newer.key]
            replaced_by = None
            if is_stationary(older.stamp_ns, newer.stamp_ns):
                replaced_by = find_replacements(older, newer, self._config)
            if replaced_by is not None:
                del self._views[older.key]
                kept = with_numbers_of(newer, older, replaced_by)
                self._views[newer.key] = with_objects_of(kept, older, self._config)

    @property
    def views(self) -> list[View]:
        """All views in order of sessions and stamps."""
        return [self._views[key] for key in sorted(self._views)]

    def build(self, poses: ViewPoses, walls: Float64 | None = None) -> MappedSurfaces:
        """Build the surfaces of all views.

        Parameters
        ----------
        poses
            Poses in the order of `views`.
        walls
            float64 (W, 2, 2), ends of the walls in map, m: pieces on two sides of a wall are not
            joined, and labels depend on the distance to walls. None: no walls.
        """
        walls = np.zeros((0, 2, 2)) if walls is None else walls
        views, config, T = self.views, self._config, poses.T_map_view
        survivors = self.carver.carve(views, T)
        groups = self._merge(views, survivors, poses)
        fitted = [fit_surface(members, views, T, config) for members in groups]
        surfaces = [surface for surface in fitted if surface is not None]
        ids = TrackIds(views, T, survivors)

        def seen_span(piece: MergedSurface) -> tuple[ViewKey, ViewKey]:
            placed = ids.placed(piece.members, footprint_of(piece, T))
            return placed, ids.last_seen(piece.members)

        if self._baseline_merge is None:
            surfaces = join_over_occlusions(
                surfaces, views, T, poses.cov_z_roll_pitch, walls, seen_span, config
            )
        surfaces = [
            s for s in surfaces if s.has_area and s.polygon.area >= config.surfaces.min_area
        ]
        floor_z = find_floor(surfaces, config)
        if self._baseline_merge is None:
            surfaces = join_floor(surfaces, floor_z, views, T, config)
        surfaces = [s for s in surfaces if _is_wanted(s, floor_z, config)]
        previous: dict[Members, PastPose] = {}
        if self._baseline_merge is None:
            surfaces, previous = adopt_ids(
                surfaces, ids, views, (T, poses.cov_z_roll_pitch), survivors, config
            )
        surfaces.sort(key=lambda surface: ids.track_id(surface.members))
        labels = with_corrections(
            label_surfaces(surfaces, floor_z, walls, config),
            [ids.all_ids(surface.members) for surface in surfaces],
            corrected_labels(views),
        )
        shapes = self._shapes(surfaces, floor_z, views, T, walls)
        records = [
            _record(surface, shape, label, ids, views, poses, previous.get(surface.members))
            for surface, shape, label in zip(surfaces, shapes, labels)
        ]
        return _mapped(records, surfaces, floor_z, T)

    def _shapes(
        self,
        surfaces: list[MergedSurface],
        floor_z: float | None,
        views: list[View],
        T_map_view: Float64,
        walls: Float64,
    ) -> list[Shape]:
        """Return the shape of each surface; the floor and surfaces of a baseline have no model."""
        above = [surface for surface in surfaces if not is_floor(surface, floor_z)]
        if self._baseline_merge is not None:
            above = []
        modelled = {id(surface) for surface in above}
        return [
            fit_shape(surface, above, views, T_map_view, walls, self._config)
            if id(surface) in modelled
            else free_shape(surface)
            for surface in surfaces
        ]

    def _merge(self, views: list[View], survivors: Survivors, poses: ViewPoses) -> list[Members]:
        """Group the patches that carving left into surfaces."""
        patches = self.remainders.surviving_patches(views, survivors)
        if self._baseline_merge is None:
            return merge_coplanar(patches, poses.T_map_view, poses.cov_z_roll_pitch, self._config)
        clouds = clouds_in_map(patches, poses.T_map_view)
        root = self._baseline_merge(clouds, self._config.surfaces.merge_distance)
        return group_patches(patches, root)


def _is_wanted(surface: MergedSurface, floor_z: float | None, config: Config) -> bool:
    """Return whether a surface is floor, or at least `surfaces.min_height` above the floor."""
    height = surface.height - (floor_z or 0.0)
    return is_floor(surface, floor_z) or height >= config.surfaces.min_height


def _record(
    surface: MergedSurface,
    shape: Shape,
    label: Label,
    ids: TrackIds,
    views: list[View],
    poses: ViewPoses,
    previous: PastPose | None,
) -> Surface:
    T, cov = poses.T_map_view, poses.cov_z_roll_pitch
    boundary, holes = polygon_rings(shape.polygon)
    boundary_seen, _ = polygon_rings(surface.polygon)
    points: dict[int, int] = {}
    for member in surface.members:
        points[member.view] = points.get(member.view, 0) + member.patch.count
    return Surface(
        id=ids.track_id(surface.members),
        label=label.name.value,
        confidence=label.confidence,
        height=surface.height,
        normal=surface.normal,
        offset=surface.offset,
        area=shape.polygon.area,
        centroid=surface.mean,
        boundary=surface.lift(boundary),
        holes=tuple(surface.lift(hole) for hole in holes),
        points=surface.count,
        height_std=float(np.sqrt(fit_plane(surface.cov)[1][0])),
        first_seen_ns=ids.first_seen(surface.members).stamp_ns,
        last_seen_ns=ids.last_seen(surface.members).stamp_ns,
        views=tuple(
            SurfaceSighting(views[v].stamp_ns, int(poses.keyframes[v]), points[v])
            for v in sorted(points)
        ),
        merged_ids=ids.merged_ids(surface.members),
        area_seen=surface.polygon.area,
        boundary_seen=surface.lift(boundary_seen),
        shape=shape.name,
        edges=tuple(_edge(surface, edge, ids) for edge in shape.edges),
        placed_ns=ids.placed(surface.members, footprint_of(surface, T)).stamp_ns,
        previous_pose=None if previous is None else _previous_pose(previous),
        cov_plane=surface_errors(surface.members, surface.mean, T, cov).covariance(cov),
    )


def _previous_pose(previous: PastPose) -> PreviousPose:
    surface = previous.surface
    boundary, _ = polygon_rings(surface.polygon)
    return PreviousPose(
        surface.lift(boundary), surface.normal, surface.offset, previous.last_seen_ns
    )


def _edge(surface: MergedSurface, edge: ShapedEdge, ids: TrackIds) -> SurfaceEdge:
    start, end = surface.lift(np.stack([edge.edge.start, edge.edge.end]))
    hidden_by = None if edge.hidden_by is None else ids.track_id(edge.hidden_by.members)
    return SurfaceEdge(start, end, edge.state, edge.sigma, hidden_by)


def _mapped(
    records: list[Surface],
    surfaces: list[MergedSurface],
    floor_z: float | None,
    T_map_view: Float64,
) -> MappedSurfaces:
    clouds, ids = [np.zeros((0, 3))], [np.zeros(0, np.uint32)]
    for record, surface in zip(records, surfaces):
        for cloud in clouds_in_map(surface.members, T_map_view):
            clouds.append(cloud)
            ids.append(np.full(len(cloud), record.id, np.uint32))
    return MappedSurfaces(
        tuple(records),
        floor_z,
        np.concatenate(clouds).astype(np.float32),
        np.concatenate(ids),
        tuple(surface.members for surface in surfaces),
    )
