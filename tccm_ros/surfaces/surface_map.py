"""The surface map: views on the poses of the graph become surfaces.

It is built anew after each optimisation from the same views, so that a loop closure can merge and
split surfaces, and so that neither arrival order nor history can show in it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.geometry import transform
from tccm_ros.records import Surface, SurfaceCloud, SurfaceSighting, ViewIntervals
from tccm_ros.surfaces.carving import carve, superseded
from tccm_ros.surfaces.floor import find_floor, is_floor, join_floor
from tccm_ros.surfaces.joining import join_pieces
from tccm_ros.surfaces.labels import Label, label_surfaces
from tccm_ros.surfaces.merged_patches import (
    Draft,
    PlacedPatch,
    draft_surface,
    merge,
    surviving_patches,
)
from tccm_ros.surfaces.merging_as_published import merge_by_distance
from tccm_ros.surfaces.patch_planes import fit_plane
from tccm_ros.surfaces.polygons import polygon_rings
from tccm_ros.surfaces.track_ids import Lineage
from tccm_ros.surfaces.views import View, empty_view, heir_of, with_cloud, with_intervals

__all__ = ["MappedSurfaces", "SurfaceMap", "ViewPlacement", "default_tilt_covariance"]

Float64 = NDArray[np.float64]

LEAN = (0.005, 0.00524, 0.00524)
"""z (m), roll and pitch (rad) of a base that nothing is known about (DESIGN section 7)."""


UNSETTLED = 8
"""So many of the newest views may still get company from a late one."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewPlacement:
    """Where the views are.

    Attributes
    ----------
    T_map_view
        float64 (V, 4, 4), in the order of `SurfaceMap.stamps_ns`.
    cov_tilt
        float64 (V, 3, 3) of (z, roll, pitch), m and rad.
    keyframes
        int64 (V,), nearest keyframe of each view; -1 = none.
    """

    T_map_view: Float64
    cov_tilt: Float64
    keyframes: NDArray[np.int64]


def default_tilt_covariance(count: int) -> Float64:
    """Return the covariances (count, 3, 3) of a base that leans as `LEAN` says."""
    return np.tile(np.diag(np.square(LEAN)), (count, 1, 1))


@dataclass(frozen=True, slots=True, eq=False)
class MappedSurfaces:
    """The surfaces of one solution.

    Attributes
    ----------
    surfaces
        Sorted by id.
    floor_z
        Height of the floor in map, m; None where none was seen.
    points
        float32 (N, 3), the thinned points in map, by surface.
    surface_id
        uint32 (N,).
    members
        For each surface, its patches.
    """

    surfaces: tuple[Surface, ...]
    floor_z: float | None
    points: NDArray[np.float32]
    surface_id: NDArray[np.uint32]
    members: tuple[tuple[PlacedPatch, ...], ...]


class SurfaceMap:
    """Views in stamp order, however they arrive, and the surfaces that they show."""

    def __init__(self, config: Config, session: int = 0):
        self._config = config
        self._session = session
        self._views: dict[tuple[int, int], View] = {}
        self._judged = (-1, -1)

    def add(self, record: SurfaceCloud | ViewIntervals) -> None:
        """Take one half of a hand-over; the other half is found by its stamp.

        A second cloud, or second intervals, of one stamp replace the first.
        """
        key = self._session, record.stamp_ns
        view = self._views.get(key) or empty_view(record.stamp_ns, self._session, self._config)
        if isinstance(record, SurfaceCloud):
            view = with_cloud(view, record, self._config)
        else:
            view = with_intervals(view, record)
        self._views[key] = view

    def add_view(self, view: View) -> None:
        """Take a view as it is: from a saved map."""
        self._views[view.key] = view

    def forget(self, has_stood: Callable[[int, int], bool]) -> None:
        """Forget views that the next one, taken at the same place without a move, makes idle.

        The newest views are not judged yet: arrival order must not show.

        Parameters
        ----------
        has_stood
            Tells of two stamps of this session whether the base was at one place.
        """
        own = [view for view in self.views if view.session == self._session]
        for older, newer in itertools.pairwise(own[: -UNSETTLED or None]):
            if newer.key <= self._judged:
                continue
            self._judged = newer.key
            # What the pair before has made of the older one counts, and what this one makes of
            # the newer one is seen by the next.
            older, newer = self._views[older.key], self._views[newer.key]
            heirs = None
            if has_stood(older.stamp_ns, newer.stamp_ns):
                heirs = superseded(older, newer, self._config)
            if heirs is not None:
                del self._views[older.key]
                self._views[newer.key] = heir_of(older, newer, heirs)

    @property
    def views(self) -> list[View]:
        """All views in order of sessions and stamps."""
        return [self._views[key] for key in sorted(self._views)]

    def build(self, placement: ViewPlacement, walls: Float64 | None = None) -> MappedSurfaces:
        """Build the surfaces of all views.

        Parameters
        ----------
        placement
            Where the views are, in the order of `views`.
        walls
            float64 (W, 2, 2), ends of the walls in map: nothing is joined through them, and they
            serve for the labels.
        """
        walls = np.zeros((0, 2, 2)) if walls is None else walls
        views, config, T = self.views, self._config, placement.T_map_view
        left = carve(views, T, config)
        placed = surviving_patches(views, left, config)
        is_published = config.surfaces.segmentation == "seed"
        if is_published:
            groups = merge_by_distance(placed, T, config.surfaces.merge_distance)
        else:
            groups = merge(placed, T, placement.cov_tilt, config)
        drafts = [d for d in (draft_surface(g, views, T, config) for g in groups) if d is not None]
        if not is_published:
            drafts = join_pieces(drafts, views, T, placement.cov_tilt, walls, config)
        drafts = [d for d in drafts if d.polygon.area >= config.surfaces.min_area]
        floor_z = find_floor(drafts, config)
        if not is_published:
            drafts = join_floor(drafts, floor_z, views, T, config)
        drafts = [d for d in drafts if _is_wanted(d, floor_z, config)]
        lineage = Lineage(views, left)
        drafts.sort(key=lambda draft: lineage.name(draft.members))
        labels = label_surfaces(drafts, floor_z, walls, config)
        surfaces = [
            _surface(draft, label, lineage, views, placement.keyframes)
            for draft, label in zip(drafts, labels)
        ]
        return _mapped(surfaces, drafts, floor_z, T)


def _is_wanted(draft: Draft, floor_z: float | None, config: Config) -> bool:
    """Return whether a surface is floor or high enough to put things on."""
    height = draft.height - (floor_z or 0.0)
    return is_floor(draft, floor_z) or height >= config.surfaces.min_height


def _surface(
    draft: Draft,
    label: Label,
    lineage: Lineage,
    views: list[View],
    keyframes: NDArray[np.int64],
) -> Surface:
    boundary, holes = polygon_rings(draft.polygon)
    points: dict[int, int] = {}
    for member in draft.members:
        points[member.view] = points.get(member.view, 0) + member.patch.count
    return Surface(
        id=lineage.name(draft.members),
        label=label.name,
        confidence=label.confidence,
        height=draft.height,
        normal=draft.normal,
        offset=draft.offset,
        area=draft.polygon.area,
        centroid=draft.mean,
        boundary=draft.lift(boundary),
        holes=tuple(draft.lift(hole) for hole in holes),
        points=draft.count,
        height_std=float(np.sqrt(fit_plane(draft.cov)[1][0])),
        first_seen_ns=lineage.first_seen_ns(draft.members),
        last_seen_ns=lineage.last_seen_ns(draft.members),
        views=tuple(
            SurfaceSighting(views[v].stamp_ns, int(keyframes[v]), points[v]) for v in sorted(points)
        ),
        took=lineage.took(draft.members),
    )


def _mapped(
    surfaces: list[Surface], drafts: list[Draft], floor_z: float | None, T_map_view: Float64
) -> MappedSurfaces:
    clouds, ids = [np.zeros((0, 3))], [np.zeros(0, np.uint32)]
    for surface, draft in zip(surfaces, drafts):
        for member in draft.members:
            clouds.append(transform(T_map_view[member.view], member.patch.points))
            ids.append(np.full(len(member.patch.points), surface.id, np.uint32))
    return MappedSurfaces(
        tuple(surfaces),
        floor_z,
        np.concatenate(clouds).astype(np.float32),
        np.concatenate(ids),
        tuple(draft.members for draft in drafts),
    )
