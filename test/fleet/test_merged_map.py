"""The new id of a surface is that of its patch, else of what is at its place."""

import numpy as np
import pytest
import shapely

from tccm_ros.fleet.map_inputs import SurfaceFootprint
from tccm_ros.fleet.merge_file import IdEntry
from tccm_ros.fleet.merged_map import id_table
from tccm_ros.geometry import inverse2

TABLE = SurfaceFootprint(5, shapely.box(0, 0, 1.4, 0.8), 0.74, False)
MERGED = (
    SurfaceFootprint(0, shapely.box(-4, -3, 4, 3), 0.0, True),
    SurfaceFootprint(7, shapely.box(0, 0, 1.3, 0.8), 0.75, False),
    SurfaceFootprint(8, shapely.box(0, 0, 1.4, 0.8), 1.2, False),
    SurfaceFootprint(9, shapely.box(0.9, 0, 2.0, 0.8), 0.74, False),
)


def new_id(surface, owners=None, T=(0.0, 0.0, 0.0)):
    (entry,) = id_table([surface], 100, np.array(T), owners or {}, MERGED)
    assert entry == IdEntry(surface.id, entry.new)
    return entry.new


def test_a_patch_that_is_in_a_surface_decides():
    assert new_id(TABLE, {105: 8, 5: 9}) == 8


@pytest.mark.parametrize("T", [(0.0, 0.0, 0.0), (3.0, -2.0, 1.2)])
def test_else_it_is_the_surface_at_its_place_and_height(T):
    old = TABLE.moved(inverse2(np.array(T)))
    assert new_id(old, T=T) == 7


def test_removed_surface_has_no_new_id():
    assert new_id(SurfaceFootprint(5, shapely.box(5, 5, 6, 6), 0.74, False)) is None
    assert new_id(SurfaceFootprint(5, TABLE.polygon, 0.5, False)) is None
    assert new_id(SurfaceFootprint(5, TABLE.polygon, 0.0, False)) is None, "the floor is no table"
    assert new_id(SurfaceFootprint(5, shapely.box(0, -3, 1.4, 0.8), 0.74, False)) is None
