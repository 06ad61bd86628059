"""Changes of the map during the replay of a recording, as a live node reports them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tccm_ros.scene.base_poses import FreeFloor
from tccm_ros.scene.changes import Change, MapChanges
from tccm_ros.scene.scene import Scene, known_surface

if TYPE_CHECKING:  # slam_node makes scenes from messages and does not load the graph
    from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution


def scene_of(
    solution: SurfaceSolution, frame_id: str, free_floor: FreeFloor | None = None
) -> Scene:
    """Return the scene of a solution, without the messages of its surfaces.

    Parameters
    ----------
    solution
        Solution in map.
    frame_id
        Name of the map frame.
    free_floor
        Free floor for the base; None: unknown.
    """
    previous_ns, newest_ns = sorted([0, 0, *solution.view_stamps_ns.tolist()])[-2:]
    return Scene(
        solution.stamp_ns,
        frame_id,
        solution.floor_z,
        solution.objects,
        free_floor,
        tuple(known_surface(surface) for surface in solution.surfaces),
        newest_ns,
        previous_ns,
        solution.compartments,
        solution.unseen,
        solution.tracked,
    )


class SessionChanges:
    """Solves for the map of a session repeatedly and reports its changes.

    Parameters
    ----------
    slam
        Processor that receives the events of the session.
    is_map_loaded
        Whether the session continues a saved map.
    """

    def __init__(self, slam: SurfaceSlam, *, is_map_loaded: bool):
        self._slam, self._is_map_loaded = slam, is_map_loaded
        self._changes = MapChanges(is_map_loaded=is_map_loaded)
        self._resets = 0
        if is_map_loaded:
            self.solve()

    def solve(self) -> list[Change]:
        """Solve for the map and return the changes since the last call."""
        if self._slam.counts["resets"] != self._resets:
            self._resets = self._slam.counts["resets"]
            self._changes = MapChanges(is_map_loaded=self._is_map_loaded)
        config = self._slam.config
        scene = scene_of(self._slam.solve(with_racks=False), config.frames.map_name)
        return self._changes.note(scene, config.objects.agreeing_views)
