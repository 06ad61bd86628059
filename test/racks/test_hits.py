"""Hits of views in map, and those that have gone."""

import numpy as np
import shapely

from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.geometry import spatial
from tccm_ros.racks.compartment import SeenView
from tccm_ros.racks.hits import HitsInMap

EYE = np.array([0.0, 0.0, 1.0])
WALL_X, BOX_X = 2.0, 1.5
GRID = np.array([[y, z] for y in np.arange(-0.5, 0.5, 0.04) for z in np.arange(0.5, 1.5, 0.04)])


def everywhere(views):
    return HitsInMap(views).near(shapely.box(-9.0, -9.0, 9.0, 9.0), 0.0)


def view(hits, pose=(0.0, 0.0, 0.0)):
    return SeenView(spatial(np.array(pose)), EYE, hits, FreeColumns.of(None, 0.1))


def rows(x, yz):
    """Return hits of 2 cm at a distance x."""
    return np.column_stack([np.full(len(yz), x), yz[:, 0], yz[:, 1] - 0.01, yz[:, 1] + 0.01])


def is_box(yz):
    return (np.abs(yz) <= [0.1, np.inf]).all(axis=1) & (np.abs(yz[:, 1] - 1.0) <= 0.1)


def test_hits_and_sensors_move_with_the_pose_of_their_view():
    hits = everywhere([view(rows(1.0, np.array([[0.0, 0.5]])), (1.0, 2.0, np.pi / 2))])
    np.testing.assert_allclose(hits.ends, [[1.0, 3.0, 0.5]], atol=1e-12)
    np.testing.assert_allclose(hits.origins, [[1.0, 2.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(hits.half, [0.01])


def test_hits_seen_through_by_a_newer_view_are_removed_and_others_kept():
    box, wall = rows(BOX_X, GRID[is_box(GRID)]), rows(WALL_X, GRID)
    left = everywhere([view(np.concatenate([box, wall])), view(wall, (0.02, 0.0, 0.0))])
    ends = left.without_removed().ends
    assert not (np.abs(ends[:, 0] - BOX_X) < 0.1).any()
    assert (np.abs(ends[:, 0] - WALL_X) < 0.1).sum() == 2 * len(wall)


def test_hits_unseen_by_newer_views_are_kept():
    box, wall = rows(BOX_X, GRID[is_box(GRID)]), rows(WALL_X, GRID)
    beside = wall[np.abs(wall[:, 1]) > 0.3]
    hits = everywhere([view(np.concatenate([box, wall])), view(beside)])
    assert len(hits.without_removed().ends) == len(box) + len(wall) + len(beside)
    newer = everywhere([view(wall), view(np.concatenate([box, wall]))])
    assert len(newer.without_removed().ends) == len(box) + 2 * len(wall)


def test_hits_near_an_outline_are_those_in_the_box_around_it():
    hits = HitsInMap([view(rows(1.0, GRID)), view(rows(1.0, GRID)[:0]), view(rows(5.0, GRID))])
    near = hits.near(shapely.box(0.9, -0.1, 1.1, 0.1), 0.2)
    assert len(near.ends) == (np.abs(GRID[:, 0]) < 0.3).sum()
    assert set(near.view) == {0}
    assert len(hits.near(shapely.box(7.0, 7.0, 8.0, 8.0), 0.5).ends) == 0
