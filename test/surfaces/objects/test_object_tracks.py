"""Objects over many views: ids stay, what is hidden stays, what was looked through leaves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from object_boxes import objects_of

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.geometry import inverse, planar, spatial, transform
from tccm_ros.mapping.saved_map import pack_views, unpack_views
from tccm_ros.records import ViewIntervals
from tccm_ros.surfaces.objects.object_tracks import nearest_pairs, track_objects, with_objects_of
from tccm_ros.surfaces.views.views import empty_view, with_intervals, with_objects

CONFIG = Config()
BOX = (1.2, 0.3, 0.8, 0.2, 0.1, 0.16, 0.4)
"""x, y, z, edges and yaw in map, m and rad."""


def view(stamp_ns, boxes, *, seen_through=(), above=0.5, pose=(0.0, 0.0, 0.0), points=50):
    """Return a view from a planar pose, which looked through columns above a height, and that."""
    T = spatial(np.array(pose))
    rows = np.array(boxes, float).reshape(-1, 7)
    rows[:, :3] = transform(inverse(T), rows[:, :3])
    rows[:, 6] -= planar(T)[2]
    made = with_objects(empty_view(stamp_ns, 0, CONFIG), objects_of(stamp_ns, rows, points))
    if len(seen_through):
        centers = transform(inverse(T), np.array([b[:3] for b in seen_through]))
        near = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2), axis=-1).reshape(-1, 2)
        cells = (np.floor(centers[:, None, :2] / 0.1) + near).reshape(-1, 2)
        columns = np.unique(cells, axis=0) * 0.1 + 0.05
        low = np.column_stack([columns, np.full(len(columns), above), np.full(len(columns), 1.5)])
        made = with_intervals(made, ViewIntervals(stamp_ns, "base", low.astype(np.float32)))
    return made, T


def tracks(*looks, config=CONFIG):
    views, poses = zip(*looks)
    return track_objects(views, np.stack(poses), config).tracks


def test_an_object_keeps_its_id_from_wherever_it_is_seen():
    (track,) = tracks(
        view(10, [BOX]),
        view(20, [BOX], pose=(2.0, 1.5, 2.5)),
        view(30, [BOX], pose=(1.0, -1.0, 1.0)),
    )
    assert (track.id, track.views, track.first_seen_ns, track.last_seen_ns) == (0, 3, 10, 30)
    np.testing.assert_allclose(track.center, BOX[:3], atol=1e-9)
    assert np.sin(2 * (track.shape.yaw - BOX[6])) == pytest.approx(0.0, abs=1e-6)


def test_saved_view_keeps_footprints_and_older_versions_have_boxes():
    (seen,) = view(10, [BOX])[0].objects
    arrays = pack_views([view(10, [BOX])[0], view(20, [])[0]])
    older = {k: v for k, v in arrays.items() if "footprint" not in k and k != "object_z"}
    older["object_boxes"] = np.array([BOX])
    for saved in (arrays, older):
        first, second = unpack_views(saved)
        (item,), none = first.objects, second.objects
        np.testing.assert_allclose(item.footprint, seen.footprint)
        assert (item.low, item.high, none) == (seen.low, seen.high, ())
    arrays |= {"footprints_of": np.array([2]), "footprints": np.eye(2)}
    with pytest.raises(MapError, match="fewer than three corners"):
        unpack_views(arrays)


def test_objects_stay_unless_a_view_looked_through_them():
    looks = [view(10, [BOX]), view(20, [BOX])]
    assert len(tracks(*looks, view(30, []), view(40, []))) == 1
    empty = [view(s, [], seen_through=[BOX]) for s in (30, 40)]
    assert len(tracks(*looks, empty[0])) == 1, "one view may be wrong"
    assert tracks(*looks, *empty) == ()
    again = tracks(*looks, empty[0], view(35, [BOX]), empty[1])
    assert [t.views for t in again] == [3], "misses in a row count"


def test_object_of_a_single_view_leaves_when_seen_through():
    assert tracks(view(10, [BOX]), view(20, [], seen_through=[BOX])) == ()


@pytest.mark.parametrize(("views", "passed", "stays"), [(1, 1, 1), (1, 2, 0), (2, 3, 1), (2, 4, 0)])
def test_objects_that_more_views_look_over_are_noise(views, passed, stays):
    """Two views, for each that measured it, looked just above it: noise on a surface, not a box."""
    seen = [view(10 + k, [BOX]) for k in range(views)]
    over = [view(20 + k, [], seen_through=[BOX], above=0.9) for k in range(passed)]
    assert len(tracks(*seen, *over)) == stays
    assert len(tracks(*seen, *over, view(40, [BOX]))) == 1
    far = [view(20 + k, [], seen_through=[BOX], above=1.2) for k in range(4)]
    assert len(tracks(*seen, *far)) == 1, "they looked higher"


def test_earlier_views_over_the_place_count_unless_it_was_empty():
    """Noise on a surface that the last view measured for the first time; a box that has come."""
    over = [view(10 + k, [], seen_through=[BOX], above=0.9) for k in range(2)]
    assert tracks(*over, view(30, [BOX])) == ()
    empty = [view(10 + k, [], seen_through=[BOX]) for k in range(2)]
    assert len(tracks(*empty, view(30, [BOX]))) == 1


def test_view_of_another_session_with_the_same_stamp_counts():
    """Two simulated drives may both start at t = 0."""
    seen = view(10, [BOX])
    over = [view(10 + k, [], seen_through=[BOX], above=0.9) for k in range(2)]
    other_session = [(replace(passed, session=1), T) for passed, T in over]
    assert tracks(seen, *other_session) == ()


def test_two_sides_of_a_box_are_one_object():
    front = (1.0, 0.0, 0.8, 0.02, 0.3, 0.16, 0.0)
    back = (1.2, 0.0, 0.8, 0.36, 0.3, 0.16, 0.0)
    (track,) = tracks(view(10, [front]), view(20, [back]))
    assert track.id == 0
    assert len(tracks(view(10, [front, BOX]), view(20, [back, BOX]))) == 2


def test_objects_that_are_found_to_be_one_have_the_oldest_id():
    left, right = ((1.0, y, 0.8, 0.1, 0.1, 0.1, 0.0) for y in (-0.12, 0.12))
    whole = (1.0, 0.0, 0.8, 0.1, 0.36, 0.1, 0.0)
    (track,) = tracks(view(10, [left, right]), view(20, [whole]))
    assert track.id == 0


def test_ids_stay_when_a_view_from_the_same_pose_replaces_another():
    other = (2.0, -0.5, 0.8, 0.1, 0.1, 0.1, 0.0)
    first, T = view(10, [other, BOX])
    second, _ = view(20, [BOX, other])
    kept = with_objects_of(second, first, CONFIG)
    before = {t.id: t for t in tracks((first, T), (second, T))}
    after = {t.id: t for t in tracks((kept, T))}
    assert before.keys() == after.keys() == {0, 1}
    for k in before:
        np.testing.assert_allclose(before[k].center, after[k].center)
        assert (before[k].views, before[k].first_seen_ns) == (
            after[k].views,
            after[k].first_seen_ns,
        )
    (loaded,) = unpack_views(pack_views([kept]))
    again = {t.id: t for t in tracks((loaded, T))}
    assert {k: t.views for k, t in again.items()} == {k: t.views for k, t in after.items()}


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 0.5))
def test_nearest_pairs_are_those_of_a_search_one_by_one(seed, max_distance):
    rng = np.random.default_rng(seed)
    first, second = rng.random((7, 3)), rng.random((5, 3))
    expected, left = [], [(i, j) for i in range(7) for j in range(5)]
    while left:
        best = min(left, key=lambda p: np.linalg.norm(first[p[0]] - second[p[1]]))
        if np.linalg.norm(first[best[0]] - second[best[1]]) > max_distance:
            break
        expected.append(best)
        left = [p for p in left if p[0] != best[0] and p[1] != best[1]]
    assert nearest_pairs(first, second, max_distance) == expected
