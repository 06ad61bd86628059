"""A scene as pickled pieces from the solver process.

Unpickling a large scene at once would hold the interpreter for milliseconds.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import TYPE_CHECKING

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.ros.surface_messages import SURFACE, surface_message
from tccm_ros.scene.base_poses import FreeFloor
from tccm_ros.scene.scene import Scene
from tccm_ros.scene.session_changes import scene_of
from tccm_ros.slam.occupancy import OccupancyGrid

if TYPE_CHECKING:  # the node that unpacks a scene does not import the graph
    from tccm_ros.mapping.surface_slam import SurfaceSolution

SURFACES_IN_PIECE = 50
"""Number of surfaces per piece. Chosen: a piece is unpickled in 2 ms."""


def pack_scene(
    solution: SurfaceSolution, frame_id: str, grid: OccupancyGrid | None, types: TypestoreMessages
) -> tuple[bytes, ...]:
    """Return the pickled pieces of a solution's scene.

    Parameters
    ----------
    solution
        Solution in the map frame.
    frame_id
        Name of the map frame.
    grid
        Occupancy grid of the level scans, if there is one.
    types
        Message classes.
    """
    floor = None if grid is None else FreeFloor(grid, solution.surfaces)
    scene = scene_of(solution, frame_id, floor)
    known = []
    for surface, without in zip(solution.surfaces, scene.surfaces, strict=True):
        message = surface_message(types, solution.stamp_ns, frame_id, surface, solution.floor_z)
        known.append(without._replace(message=bytes(types.serialize(SURFACE, message))))
    parts = [known[k : k + SURFACES_IN_PIECE] for k in range(0, len(known), SURFACES_IN_PIECE)]
    pieces = scene._replace(surfaces=()), *parts
    return tuple(pickle.dumps(piece, pickle.HIGHEST_PROTOCOL) for piece in pieces)


def unpack_scene(pieces: Sequence[bytes]) -> Scene:
    """Return the scene of `pack_scene`."""
    scene: Scene = pickle.loads(pieces[0])
    surfaces = tuple(known for piece in pieces[1:] for known in pickle.loads(piece))
    return scene._replace(surfaces=surfaces)
