"""The files of a saved map, built by the solver process."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from tccm_ros.mapping.saved_map import SavedMap
from tccm_ros.mapping.surface_slam import SurfaceSlam, SurfaceSolution
from tccm_ros.results.exports import solution_files
from tccm_ros.results.grid_files import grid_files
from tccm_ros.results.keepout_mask import keepout_mask
from tccm_ros.results.labels_file import MAP_FILE
from tccm_ros.results.map_file import map_content

GRID_NAME = "map"
"""Stem of map.pgm and map.yaml, for nav2_map_server."""

MASK_NAME = "keepout"
"""Stem of keepout.pgm and keepout.yaml, for the costmap filters of Nav2."""


def map_files(
    processor: SurfaceSlam, solution: SurfaceSolution, map_frame: str, saved: SavedMap
) -> dict[str, bytes]:
    """Return the files of a map by name.

    Parameters
    ----------
    processor, solution
        The processor, and its newest solution.
    map_frame
        Name of the map frame.
    saved
        `SurfaceSlam.saved` of the solution.
    """
    files = solution_files(solution, processor.config)
    grid = solution.grid
    if grid is not None:
        files |= grid_files(GRID_NAME, grid)
        mask = solution.stages.run(
            "keepout mask", lambda: keepout_mask(grid, solution.surfaces, solution.floor_z)
        )
        files |= {} if mask is None else grid_files(MASK_NAME, mask)
    return files | {MAP_FILE: map_content(saved, solution, map_frame)}


def pack_files(files: Mapping[str, bytes], stream: Any) -> None:
    """Write an archive: one line of JSON with names and sizes, then the concatenated contents."""
    sizes = {name: len(content) for name, content in files.items()}
    stream.write(json.dumps(sizes).encode() + b"\n")
    for content in files.values():
        stream.write(content)
    stream.flush()
