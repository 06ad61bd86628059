"""Views: compact, with exact moments, and moved as a whole with their pose."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from room import Board, Room
from surface_maps import above_floor, build, poses_at

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.geometry import compose2, transform2
from tccm_ros.mapping.saved_map import pack_views, unpack_views
from tccm_ros.records import SurfaceCloud, ViewIntervals
from tccm_ros.surfaces.surface_map import SurfaceMap
from tccm_ros.surfaces.views.thinning import thin_cloud
from tccm_ros.surfaces.views.views import empty_view, with_cloud, with_intervals, with_numbers_of

CONFIG = Config()
TABLE, STOOL = Board(1.5, 0.3, 0.8, 1.2, 0.74), Board(1.2, -1.2, 0.4, 0.4, 0.46)


def cloud(points, surface=None):
    points = np.asarray(points, np.float32)
    surface = np.zeros(len(points)) if surface is None else surface
    return SurfaceCloud(7, "base", points, np.asarray(surface, np.uint32))


def board(count, seed=0, x=1.0, z=0.7):
    rng = np.random.default_rng(seed)
    xy = rng.uniform([x, -0.4], [x + 1.2, 0.4], (count, 2))
    return np.column_stack([xy, z + rng.normal(0.0, 0.003, count)])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 400), st.sampled_from([0.01, 0.02, 0.05]))
def test_thinning_keeps_one_point_for_each_voxel_and_every_weight(seed, count, voxel):
    points = board(count, seed).astype(np.float32)
    thinned, weights = thin_cloud(points, voxel)
    cells = {tuple(c) for c in np.floor(points.astype(float) / voxel).astype(int).tolist()}
    assert len(thinned) == len(cells)
    assert weights.sum() == count
    mean = (thinned.astype(float) * weights[:, None]).sum(axis=0) / count
    assert mean == pytest.approx(points.astype(float).mean(axis=0), abs=1e-6)


def test_moments_are_those_of_all_points_not_of_the_thinned_ones():
    points = np.float32(board(40_000))
    (patch,) = with_cloud(empty_view(7, 0, CONFIG), cloud(points), CONFIG).patches
    assert patch.count == 40_000
    assert len(patch.points) < 0.8 * 40_000
    exact = points.astype(float)
    assert patch.mean == pytest.approx(exact.mean(axis=0), abs=1e-12)
    assert patch.cov == pytest.approx(np.cov(exact.T, bias=True), abs=1e-12)


def test_a_view_of_more_points_is_not_larger():
    """Four times the beams of one board: as many voxels, hardly more bytes."""

    def size(count):
        surface_map = SurfaceMap(CONFIG)
        surface_map.add(cloud(board(count)))
        return sum(a.nbytes for a in pack_views(surface_map.views).values())

    assert size(160_000) < 1.25 * size(40_000)


def test_a_view_moves_with_its_pose_and_with_nothing_else():
    """Another place of the whole graph: the same surfaces, moved; the bag is not asked again."""
    room = Room([TABLE, STOOL])
    looks = [(room, (0.0, 0.0, 0.0), 10), (room, (0.2, 0.9, -0.3), 20)]
    shift = np.array([4.0, -7.0, 0.8])
    here = build(looks)
    there = build(looks, poses=[tuple(compose2(shift, np.array(p, float))) for _, p, _ in looks])
    assert [s.id for s in here.surfaces] == [s.id for s in there.surfaces]
    for one, other in zip(here.surfaces, there.surfaces, strict=True):
        assert (one.label, one.points) == (other.label, other.points)
        assert other.height == pytest.approx(one.height, abs=1e-9)
        assert other.centroid[:2] == pytest.approx(transform2(shift, one.centroid[None, :2])[0])
        moved = shapely.Polygon(transform2(shift, one.boundary[:, :2]))
        assert shapely.Polygon(other.boundary[:, :2]).symmetric_difference(moved).area < (
            0.01 * one.area
        )


def test_each_view_is_moved_by_its_own_pose():
    """Only the second view's pose is corrected: what the first alone saw stays."""
    rooms = Room([STOOL]), Room([Board(1.5, 1.2, 0.8, 0.8, 0.74)])
    looks = [(rooms[0], (0.0, 0.0, 0.0), 10), (rooms[1], (0.0, 0.8, 0.0), 20)]
    before = {round(s.height, 2): s for s in above_floor(build(looks, sees_through=False))}
    poses = [(0.0, 0.0, 0.0), (0.0, 1.1, 0.0)]
    after = {round(s.height, 2): s for s in above_floor(build(looks, poses, sees_through=False))}
    np.testing.assert_array_equal(after[0.46].boundary, before[0.46].boundary)
    assert after[0.74].centroid == pytest.approx(np.add(before[0.74].centroid, (0, 0.3, 0)))


def test_cloud_and_intervals_in_any_order_or_twice_are_one_view():
    records = Room([TABLE]).look((0, 0, 0), 7)
    orders = ([0, 1], [1, 0], [0, 0, 1], [1, 0, 1])
    packed = []
    for order in orders:
        surface_map = SurfaceMap(CONFIG)
        for k in order:
            surface_map.add(records[k])
        packed.append(pack_views(surface_map.views))
    for other in packed[1:]:
        for name, array in packed[0].items():
            np.testing.assert_array_equal(array, other[name])


def test_a_far_table_seen_in_four_scan_lines_is_a_surface():
    """Four scan lines at distances of 12 cm, 48 points: a tenth of the published 500."""
    x, y = np.meshgrid(4.0 + 0.12 * np.arange(4), np.linspace(-0.4, 0.4, 12))
    far = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.74)])
    floor = board(3000, z=0.0)
    points = np.concatenate([floor, far])
    surface_map = SurfaceMap(CONFIG)
    surface_map.add(cloud(points, [0] * len(floor) + [1] * len(far)))
    surface_map.add(ViewIntervals(7, "base", np.zeros((0, 4), np.float32)))
    (table,) = above_floor(surface_map.build(poses_at(np.eye(4)[None])))
    assert table.points == 48
    assert table.area == pytest.approx(0.36 * 0.8, rel=0.35)
    assert table.height == pytest.approx(0.74, abs=1e-6)


def test_the_parts_of_a_surface_are_patches_of_their_own_points():
    """Two boards of 1.2 m, 0.5 m from each other, that have the same number."""
    points = np.float32(np.concatenate([board(6000), board(2000, 1, x=2.7)]))
    view = with_cloud(empty_view(7, 0, CONFIG), cloud(points), CONFIG)
    assert len(view.patches) == 2
    ends = points[:, 0] < 2.5, points[:, 0] > 2.5
    for patch, own in zip(sorted(view.patches, key=lambda patch: patch.mean[0]), ends):
        assert patch.count == own.sum()
        assert patch.weights.shape == (len(patch.points),)
        assert patch.weights.sum() == own.sum()
        assert patch.mean == pytest.approx(points[own].astype(float).mean(axis=0), abs=1e-9)
        thinned, _weights = thin_cloud(points[own], CONFIG.views.voxel_size)
        assert patch.points[np.lexsort(patch.points.T)] == pytest.approx(
            thinned[np.lexsort(thinned.T)], abs=1e-6
        )


def test_a_view_remembers_how_many_patches_it_has_replaced():
    """So that the numbers of patches, and the ids of surfaces, go on from those that are gone."""
    older, newer = (
        with_cloud(empty_view(k, 0, CONFIG), cloud(board(900, k, x)), CONFIG)
        for k, x in ((1, 1.0), (2, 1.0))
    )
    older, newer = replace(older, forgotten=5), replace(newer, forgotten=2)
    assert len(older.patches) == 1
    after = with_numbers_of(newer, older, {0: 0})
    assert after.forgotten == 2 + 5 + 1
    # Patches of the view are numbered from 0: the one before was number -1.
    assert after.patches[0].number == -1
    assert after.patches[0].first_seen_ns == 1


@pytest.mark.parametrize(("xy", "distance"), [((3.0, 4.0), 5.0), ((5.0, 0.0), 5.0)])
def test_a_view_s_max_range_is_to_its_farthest_column_and_a_cell_more(xy, distance):
    rows = np.array([[0.5, 0.5, 0.1, 1.0], [*xy, 0.1, 1.0]], np.float32)
    view = with_intervals(empty_view(7, 0, CONFIG), ViewIntervals(7, "base", rows))
    assert view.max_range == pytest.approx(distance + CONFIG.views.cell_size)


def test_a_view_without_free_intervals_has_no_max_range():
    nothing = ViewIntervals(7, "base", np.zeros((0, 4), np.float32))
    assert with_intervals(empty_view(7, 0, CONFIG), nothing).max_range == 0.0


def test_hits_are_saved_with_their_views_and_maps_without_them_are_read():
    hits = np.array([[0.3, 0.1, 0.40, 0.43], [0.35, 0.1, 0.41, 0.41]], np.float32)
    none = ViewIntervals(8, "base", np.zeros((0, 4), np.float32))
    views = [with_intervals(empty_view(7, 0, CONFIG), ViewIntervals(7, "base", hits[:0], hits))]
    views.append(with_intervals(empty_view(8, 0, CONFIG), none))
    arrays = pack_views(views)
    assert [view.hits.tolist() for view in unpack_views(arrays)] == [hits.tolist(), []]
    older = {name: rows for name, rows in arrays.items() if not name.startswith("hits")}
    assert [len(view.hits) for view in unpack_views(older)] == [0, 0]
    with pytest.raises(MapError, match="damaged"):
        unpack_views({**arrays, "hits_of": np.array([1, 2])})
