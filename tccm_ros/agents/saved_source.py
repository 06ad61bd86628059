"""A saved map as a source for agents."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tccm_ros.agents.facts import (
    BasePoseFacts,
    ChangeFacts,
    ObjectFacts,
    PlacementFacts,
    PlacementQuery,
    SurfaceFacts,
    appearances,
    newest_first,
    rounded,
    seconds,
)
from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.errors import MessageError
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.records import Surface
from tccm_ros.results.map_file import load_map
from tccm_ros.scene.base_poses import FreeFloor
from tccm_ros.scene.queries import SurfaceFilter, SurfaceQueries
from tccm_ros.scene.scene import surface_pose
from tccm_ros.tabletop.placements import PlacementRequest

MAX_BASE_POSES = 3
"""Maximum number of base poses per placement, the default of FindPlacements."""

MAX_PLACEMENTS = 100
"""Maximum number of placements tried for base poses, as in slam_node's services."""


class SavedMapSource:
    """The content of a saved map; see `MapSource`.

    Parameters
    ----------
    solution
        Solution of the map.
    """

    def __init__(self, solution: SurfaceSolution):
        self._solution = solution
        self._queries = SurfaceQueries(
            solution.surfaces, solution.objects, solution.floor_z, solution.compartments
        )
        grid = solution.grid
        self._floor = None if grid is None else FreeFloor(grid, solution.surfaces)

    @classmethod
    def load(cls, path: Path | str, config: Config | None = None) -> SavedMapSource:
        """Return the source of a map file, or of the map.mcap in a folder.

        Raises
        ------
        MapError
            If the map is missing, damaged or of another version.
        """
        path = Path(path)
        saved = load_map(path / "map.mcap" if path.is_dir() else path)
        return cls(SurfaceSlam.from_saved(config or Config(), saved).solve())

    def stamp_s(self) -> float:
        """Return the stamp of the newest view that the map contains, s."""
        seen = (surface.last_seen_ns for surface in self._solution.surfaces)
        return seconds(max(self._solution.stamp_ns, *seen, 0))

    def surfaces(self) -> Sequence[SurfaceFacts]:
        """Return the surfaces except the floor, by id."""
        ground = self._solution.floor_z or 0.0
        known = (s for s in self._solution.surfaces if s.label != "floor")
        return [_surface(surface, ground) for surface in known]

    def objects(self) -> Sequence[ObjectFacts]:
        """Return the objects on surfaces."""
        return [
            ObjectFacts(
                item.id,
                item.class_id,
                item.surface,
                rounded(item.center),
                rounded(item.size),
                seconds(item.first_seen_ns),
                seconds(item.last_seen_ns),
            )
            for item in self._solution.objects
        ]

    def rooms(self) -> Sequence[str]:
        """Return the names of the named rooms."""
        return sorted(room.name for room in self._solution.rooms if room.name)

    def placements(self, query: PlacementQuery) -> tuple[list[PlacementFacts], str]:
        """Return placements, the best first, and a sentence.

        Raises
        ------
        MessageError
            If base poses are requested and the map has no free floor.
        """
        with_base = query.reach_m > 0.0
        if with_base and self._floor is None:
            raise MessageError("where the base can stand is not known: there is no level laser")
        wanted = SurfaceFilter(ids=frozenset(query.surface_ids))
        count = MAX_PLACEMENTS if with_base else query.limit
        request = PlacementRequest(*query.size_m, query.clearance_m, count)
        found = []
        for placement in self._queries.find_placements(wanted, request):
            bases = self._bases(placement.position, query) if with_base else []
            if bases or not with_base:
                position, yaw = rounded(placement.position), round(placement.yaw, 3)
                clearance = round(placement.clearance, 3)
                found.append(PlacementFacts(placement.surface, position, yaw, clearance, bases))
            if len(found) == query.limit:
                break
        reached = " in reach of a free place on the floor" if with_base else ""
        return found, f"{len(found)} placements{reached} on {len(query.surface_ids)} surfaces"

    def _bases(self, position: Float64, query: PlacementQuery) -> list[BasePoseFacts]:
        assert self._floor is not None
        poses = self._floor.base_poses(
            position, query.reach_m, query.robot_radius_m, MAX_BASE_POSES
        )
        return [BasePoseFacts(round(p.x, 3), round(p.y, 3), round(p.yaw, 3)) for p in poses]

    def changes(self) -> tuple[list[ChangeFacts], str]:
        """Return which surfaces and objects appeared or were moved, the newest first."""
        found = appearances(self.surfaces(), self.objects())
        found += [
            ChangeFacts("moved", seconds(surface.placed_ns), [surface.id], -1, surface.label)
            for surface in self._solution.surfaces
            if surface.label != "floor" and surface.previous_pose is not None
        ]
        note = "a saved map does not record removals; compare two maps with tccm compare"
        return newest_first(found), note


def _surface(surface: Surface, ground: float) -> SurfaceFacts:
    T, (length, width) = surface_pose(surface)
    return SurfaceFacts(
        surface.id,
        surface.label,
        surface.room,
        list(surface.near),
        round(surface.height - ground, 3),
        round(float(length), 3),
        round(float(width), 3),
        round(surface.area, 3),
        rounded(T[:3, 3]),
        seconds(surface.first_seen_ns),
        seconds(surface.last_seen_ns),
    )
