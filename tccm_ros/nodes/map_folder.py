"""The folder that ~/save_map of the SLAM node writes and ~/load_map reads."""

from __future__ import annotations

from pathlib import Path

from tccm_ros.atomic import output_folder
from tccm_ros.results.exports import write_solution
from tccm_ros.results.map_file import load_map, save_map
from tccm_ros.results.occupancy import occupancy_grid, save_grid
from tccm_ros.surfaces.saved_map import SavedMap
from tccm_ros.surfaces.surface_slam import SurfaceSlam, SurfaceSolution

MAP_FILE = "map.mcap"
"""What a later session goes on with, beside the files that a replay writes."""

GRID_NAME = "map"
"""Of map.pgm and map.yaml, for nav2_map_server."""


def write_map(
    folder: Path, processor: SurfaceSlam, solution: SurfaceSolution, map_frame: str
) -> None:
    """Write a solution of a processor; after a kill at any moment the map is the old or the new.

    Parameters
    ----------
    folder
        Replaced as a whole.
    processor
        Gives keyframes, walls and what else a later session needs.
    solution
        Newest solution of that processor.
    map_frame
        Name of the map frame in the saved map.

    Raises
    ------
    OutputError
        If the folder cannot be written; what was there is still there.
    """
    with output_folder(folder) as made:
        write_solution(made, solution, processor.config)
        grid = occupancy_grid(processor.walls.saved())
        if grid is not None:
            save_grid(made, GRID_NAME, grid)
        save_map(made / MAP_FILE, processor.saved(solution), solution, map_frame)


def read_map(folder: Path) -> SavedMap:
    """Read the map of a folder.

    Raises
    ------
    MapError
        If there is none, or it is damaged.
    """
    return load_map(folder / MAP_FILE)
