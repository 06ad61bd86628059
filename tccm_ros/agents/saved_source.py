"""A saved map as a source for agents."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tccm_ros.agents.facts import PlacementQuery
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.results.map_file import load_map
from tccm_ros.ros.map_records import MapEvent, MapObject, MapPlacement, MapSurface
from tccm_ros.ros.surface_messages import SURFACE_MAP, typed_map_message
from tccm_ros.scene.base_poses import BasePose, FreeFloor
from tccm_ros.scene.queries import SurfaceFilter, SurfaceQueries
from tccm_ros.scene.scene import placement_pose, surface_pose
from tccm_ros.tabletop.placements import Placement, PlacementRequest

MAX_BASE_POSES = 3
"""Maximum number of base poses per placement, the default of FindPlacements."""


class SavedMapSource:
    """The content of a saved map; see `MapSource`.

    Parameters
    ----------
    solution
        Solution of the map.
    """

    changes_note = "a saved map does not record removals; compare two maps with tccm compare"

    def __init__(self, solution: SurfaceSolution):
        self._solution = solution
        self._queries = SurfaceQueries(
            solution.surfaces, solution.objects, solution.floor_z, solution.compartments
        )
        grid = solution.grid
        self._floor = None if grid is None else FreeFloor(grid, solution.surfaces)
        seen_ns = (surface.last_seen_ns for surface in solution.surfaces)
        self.stamp_ns = max(solution.stamp_ns, *seen_ns, 0)
        types = TypestoreMessages()
        made = typed_map_message(types, self.stamp_ns, "map", solution, "")
        message = types.deserialize(SURFACE_MAP, bytes(types.serialize(SURFACE_MAP, made)))
        self.surfaces: Sequence[MapSurface] = [*map(MapSurface.of, message.surfaces)]
        self.objects: Sequence[MapObject] = [*map(MapObject.of, message.objects)]
        self.rooms = sorted(room.name for room in solution.rooms if room.name)

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

    def placements(self, query: PlacementQuery) -> tuple[list[MapPlacement], str]:
        """Return placements, the best first, and a sentence.

        Raises
        ------
        MessageError
            If base poses are requested and the map has no free floor.
        """
        wanted = SurfaceFilter(ids=frozenset(query.surface_ids))
        request = PlacementRequest(*query.size_m, query.clearance_m, query.limit)
        if query.reach_m > 0.0:
            reach = query.reach_m, query.robot_radius_m
            found = self._queries.find_reachable(
                wanted, request, self._floor, *reach, MAX_BASE_POSES
            )
        else:
            found = [(p, []) for p in self._queries.find_placements(wanted, request)]
        reached = " in reach of a free place on the floor" if query.reach_m > 0.0 else ""
        note = f"{len(found)} placements{reached} on {len(query.surface_ids)} surfaces"
        return [_placement(placement, bases) for placement, bases in found], note

    def changes(self) -> list[MapEvent]:
        """Return which surfaces were moved."""
        found = []
        for s in self._solution.surfaces:
            if s.label != "floor" and s.previous_pose is not None:
                poses = surface_pose(s.previous_pose)[0], surface_pose(s)[0]
                found.append(MapEvent("moved", (s.id,), (s.id,), -1, s.label, *poses, s.placed_ns))
        return found


def _placement(placement: Placement, bases: Sequence[BasePose]) -> MapPlacement:
    poses = np.array([(base.x, base.y, base.yaw) for base in bases]).reshape(-1, 3)
    T = placement_pose(placement)
    return MapPlacement(
        placement.surface, T, placement.clearance, placement.free_height, spatial(poses)
    )
