"""The mask of what stands over the floor, read by the rules of nav2_map_server."""

import numpy as np
from map_server import as_map_server_reads
from shapely import Point, Polygon

from tccm_ros.records import Surface
from tccm_ros.results.grid_files import grid_files
from tccm_ros.results.keepout_mask import keepout_mask
from tccm_ros.slam.occupancy import OccupancyGrid

UP = np.array([0.0, 0.0, 1.0])
GRID = OccupancyGrid(np.full((60, 80), -1, np.int8), 0.05, np.array([-1.0, -1.5]))


def surface(identity, label, corners, z):
    ring = np.column_stack([np.array(corners, float), np.full(len(corners), z)])
    return Surface(
        identity, label, 0.9, z, UP, z, 1.0, ring.mean(axis=0), ring, (), 9, 0.0, 1, 1, ()
    )


TABLE = surface(1, "table", [(0.3, -0.4), (1.1, -0.2), (0.9, 0.7), (0.1, 0.5)], 0.9)
FLOOR = surface(0, "floor", [(-1, -1), (2, -1), (2, 1), (-1, 1)], 0.2)
LAMP = surface(2, "other", [(-0.9, -1.4), (-0.5, -1.4), (-0.5, -1.0), (-0.9, -1.0)], 2.1)


def test_cells_are_kept_out_of_under_a_table_and_nowhere_else(tmp_path):
    mask = keepout_mask(GRID, [FLOOR, TABLE, LAMP], 0.2)
    for name, content in grid_files("keepout", mask).items():
        (tmp_path / name).write_bytes(content)
    cells, resolution, origin = as_map_server_reads(tmp_path / "keepout.yaml")
    assert (resolution, cells.shape) == (GRID.resolution, GRID.cells.shape)
    outline = Polygon(TABLE.boundary[:, :2])
    for row, column in np.ndindex(cells.shape):
        middle = Point(np.array(origin[:2]) + (np.array([column, row]) + 0.5) * resolution)
        if outline.exterior.distance(middle) > 1e-6:
            assert cells[row, column] == (100 if outline.contains(middle) else 0)
    assert (cells == 100).sum() * resolution**2 > 0.9 * outline.area


def test_surfaces_above_the_robot_are_free(tmp_path):
    assert not keepout_mask(GRID, [LAMP], 0.2).cells.any()
    assert keepout_mask(GRID, [LAMP], 0.4).cells.any()


def test_without_a_grid_the_mask_covers_the_furniture():
    mask = keepout_mask(None, [FLOOR, TABLE, LAMP], 0.2)
    assert (mask.cells == 100).sum() * mask.resolution**2 > 0.9 * Polygon(TABLE.boundary).area
    assert mask.cells.shape == (23, 21)
    assert keepout_mask(None, [FLOOR], 0.2).cells.tolist() == [[0]]
