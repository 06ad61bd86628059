"""Occupancy grid files for nav2_map_server."""

from __future__ import annotations

import numpy as np

from tccm_ros.slam.occupancy import OccupancyGrid


def grid_files(name: str, grid: OccupancyGrid) -> dict[str, bytes]:
    """Return ``name.pgm`` and ``name.yaml`` in the trinary mode of nav2_map_server."""
    shades = np.full(grid.cells.shape, 205, np.uint8)
    shades[grid.cells == 0] = 254
    shades[grid.cells == 100] = 0
    height, width = len(shades), len(shades[0])
    about = (
        f"image: {name}.pgm\nmode: trinary\nresolution: {grid.resolution:g}\n"
        f"origin: [{grid.origin[0]:.6f}, {grid.origin[1]:.6f}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    header = f"P5\n{width} {height}\n255\n".encode()
    return {f"{name}.pgm": header + shades[::-1].tobytes(), f"{name}.yaml": about.encode()}
