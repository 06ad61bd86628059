"""Changes of the map while a recording is read, as a live node tells them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tccm_ros.surfaces.base_poses import FreeFloor
from tccm_ros.surfaces.changes import Change, MapChanges
from tccm_ros.surfaces.scene import Scene, known_surface

if TYPE_CHECKING:  # slam_node, which makes scenes of messages, does without the graph
    from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution


def scene_of(
    solution: SurfaceSolution, frame_id: str, free_floor: FreeFloor | None = None
) -> Scene:
    """Return a solution as programs see it, without the messages of its surfaces.

    Parameters
    ----------
    solution
        In map.
    frame_id
        Name of the map frame.
    free_floor
        Where the base can stand, if that is known.
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
    )


class SessionChanges:
    """Solves for the map of a session, again and again, and tells what has changed.

    Parameters
    ----------
    slam
        Gets the events of the session.
    is_map_loaded
        Whether it continues a saved map.
    """

    def __init__(self, slam: SurfaceSlam, *, is_map_loaded: bool):
        self._slam, self._is_map_loaded = slam, is_map_loaded
        self._changes = MapChanges(is_map_loaded=is_map_loaded)
        self._resets = 0
        if is_map_loaded:
            self.solve()

    def solve(self) -> list[Change]:
        """Return what has changed since the last time."""
        if self._slam.counts["resets"] != self._resets:
            self._resets = self._slam.counts["resets"]
            self._changes = MapChanges(is_map_loaded=self._is_map_loaded)
        config = self._slam.config
        scene = scene_of(
            self._slam.solve(every_covariance=False, with_racks=False), config.frames.map_name
        )
        return self._changes.note(scene, config.objects.agreeing_views)
