"""Labels of objects from what detectors recognised."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from object_boxes import prism

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.mapping.saved_map import pack_views, unpack_views
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import Detections, Hypothesis, SurfaceCloud
from tccm_ros.sensors.detections import PosedDetections
from tccm_ros.surfaces.object_labels import (
    NO_VIEW,
    ClassScores,
    PlacedDetections,
    SeenDetection,
    distance_to_box,
    merge_detections,
    seen_detections,
    view_of,
)
from tccm_ros.surfaces.objects.object_tracks import track_objects, with_objects_of
from tccm_ros.surfaces.views.views import SeenObject, View, empty_view, with_detections

MAX_WAIT_NS = 60_000_000_000  # ns that a detection waits for a view

CONFIG = Config()
S = 1_000_000_000
CUP = SeenObject(*prism(1.0, 0.0, 0.8, 0.08, 0.08, 0.1, 0.4), 50)
PAN = SeenObject(*prism(1.0, 0.5, 0.75, 0.3, 0.2, 0.05, 0.0), 90)


def seen(x, y, z, count=1, **scores) -> SeenDetection:
    return SeenDetection(np.array([x, y, z], float), scores, count)


def view(stamp_ns, objects=(CUP, PAN), detections=()) -> View:
    made = replace(empty_view(stamp_ns, 0, CONFIG), objects=tuple(objects))
    return with_detections(made, detections)


def tracked(*views, poses=None):
    poses = np.broadcast_to(np.eye(4), (len(views), 4, 4)) if poses is None else poses
    return track_objects(views, poses, CONFIG)


def labels(found):
    return [track.scores.label() for track in found.tracks]


def test_a_detection_labels_the_object_that_it_is_at_and_no_other():
    found = tracked(view(1, detections=[seen(1.0, 0.01, 0.8, mug=0.9)]))
    assert labels(found) == [Hypothesis("mug", 0.9), None]
    assert found.unused_detections == 0


@pytest.mark.parametrize("place", [(1.0, 0.0, 1.2), (2.0, 0.0, 0.8), (1.0, 0.25, 0.8)])
def test_a_detection_without_an_object_is_counted_and_labels_nothing(place):
    found = tracked(view(1, detections=[seen(*place, count=3, mug=2.7)]))
    assert labels(found) == [None, None]
    assert found.unused_detections == 3


def test_a_detection_before_the_object_came_is_not_the_objects():
    found = tracked(view(1, [PAN], [seen(1.0, 0.0, 0.8, mug=0.9)]), view(2))
    assert labels(found) == [None, None]


def test_the_mean_score_of_the_best_class_over_all_views():
    found = tracked(
        view(1, detections=[seen(1, 0, 0.8, mug=0.9)]),
        view(2, detections=[seen(1, 0, 0.8, bowl=0.8)]),
        view(3, detections=[seen(1, 0, 0.8, mug=0.6)]),
    )
    assert labels(found)[0] == Hypothesis("mug", pytest.approx(0.5))


def test_detections_move_with_their_view():
    poses = np.array([spatial([3.0, -2.0, 1.1]), spatial([3.1, -2.0, 1.1])])
    moved = replace(CUP, footprint=CUP.footprint - [0.0999, 0])
    found = tracked(
        view(1, [CUP], [seen(1, 0, 0.8, mug=0.9)]),
        view(2, [moved], [seen(0.9, 0, 0.8, mug=0.7)]),
        poses=poses,
    )
    assert labels(found) == [Hypothesis("mug", pytest.approx(0.8))]


def test_a_view_that_replaces_another_keeps_its_detections():
    first = view(1, detections=[seen(1, 0, 0.8, mug=0.9)])
    kept = with_objects_of(view(2, detections=[seen(1, 0, 0.81, mug=0.5)]), first, CONFIG)
    (item,) = kept.detections
    assert (item.count, item.scores) == (2, {"mug": pytest.approx(1.4)})
    assert labels(tracked(kept))[0] == Hypothesis("mug", pytest.approx(0.7))


def test_saved_views_have_their_detections_and_classes():
    views = [
        view(1, detections=[seen(1, 0, 0.8, mug=0.9), seen(1, 0.5, 0.7, **{"früh stück": 0.25})]),
        view(2),
        view(3, detections=[seen(2, 0, 0.8, count=4, mug=1.0, bowl=0.0)]),
    ]
    read = unpack_views(pack_views(views))
    for given_view, got in zip(views, read, strict=True):
        for a, b in zip(given_view.detections, got.detections, strict=True):
            assert np.array_equal(a.center, b.center)
            assert (a.scores, a.count) == (dict(b.scores), b.count)


def test_maps_without_detections_have_no_arrays_of_them():
    arrays = pack_views([view(1), view(2)])
    assert not [name for name in arrays if name.startswith("detection")]
    assert [v.detections for v in unpack_views(arrays)] == [(), ()]


def test_view_takes_detections_of_the_previous_minute_and_unclaimed_ones():
    stamps = [100 * S, 110 * S, 500 * S]
    asked = (30, 40, 100, 101, 110, 111, 400, 439, 440, 500, 900)
    expected = [None, 0, 0, 1, 1, 1, 1, 1, 2, 2, 2]
    assert [view_of(t * S, stamps) for t in asked] == expected
    assert view_of(1, []) is None


def test_detections_waiting_for_a_view_are_bounded():
    slam = SurfaceSlam(CONFIG)
    for k in range(200):
        slam.add(detections_at(k * S))
    slam.solve()
    assert len(slam._detections) <= MAX_WAIT_NS // S + 1
    slam.add(SurfaceCloud(200 * S, "base", np.zeros((0, 3), np.float32), np.zeros(0, np.uint32)))
    for k in range(201, 500):
        slam.add(detections_at(k * S))
    solution = slam.solve()
    assert len(slam._detections) <= MAX_WAIT_NS // S + 1
    ((view,),) = ([s.view for s in slam.saved(solution).views],)
    (item,) = view.detections
    assert item.count == 60 + 299, "of one place and class it is one"
    assert solution.unused_detections[NO_VIEW] == 140
    assert slam.solve().unused_detections == solution.unused_detections


def detections_at(stamp_ns) -> PosedDetections:
    record = Detections(stamp_ns, "base", np.ones((1, 3)), ((Hypothesis("mug", 0.5),),))
    T = np.eye(4)[None]
    return PosedDetections(record, np.array([stamp_ns]), T, T, "detections")


def test_detections_of_two_places_or_of_other_classes_stay_two():
    items = [seen(1, 0, 0.8, mug=0.9), seen(1.02, 0, 0.8, mug=0.7), seen(1, 0, 0.8, bowl=0.5)]
    merged = merge_detections([*items, seen(1.2, 0, 0.8, mug=0.1)])
    assert [(m.count, round(sum(m.scores.values()), 3)) for m in merged] == [
        (2, 1.6),
        (1, 0.5),
        (1, 0.1),
    ]
    assert merged[0].center == pytest.approx([1.01, 0.0, 0.8])


def test_a_detection_is_placed_in_its_view():
    hypotheses = ((Hypothesis("mug", 0.5), Hypothesis("mug", 0.25)),)
    placed = PlacedDetections(5, np.array([[1.0, 0.0, 0.5]]), hypotheses, False)
    (item,) = seen_detections(placed, spatial([0.0, 2.0, np.pi / 2]))
    assert item.center == pytest.approx([0.0, 3.0, 0.5])
    assert item.scores == {"mug": 0.75}


@given(st.lists(st.sampled_from(["a", "b", "c"]), min_size=1), st.randoms())
def test_the_label_does_not_depend_on_the_order(classes, random):
    def label(order):
        scores = ClassScores()
        for class_id in order:
            scores.add({class_id: 0.5}, 1)
        return scores.label()

    mixed = list(classes)
    random.shuffle(mixed)
    assert label(mixed) == label(classes)
    assert label(classes).class_id == min(set(classes), key=lambda c: (-classes.count(c), c))


def test_the_distance_from_a_box_is_that_of_its_nearest_point():
    box = np.zeros(3), np.array([2.0, 1.0, 1.0]), np.pi / 2
    assert distance_to_box(np.array([0.4, 0.9, 0.4]), *box) == 0.0
    assert distance_to_box(np.array([0.0, 1.3, 0.9]), *box) == pytest.approx(0.5)
