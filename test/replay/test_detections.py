"""Recognised objects in a replay: labels of what stands on surfaces, and what gives none.

The detections are those of a perfect recogniser, made of the truth of the recording.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from detections import (
    ARRAY,
    TYPES,
    array_message,
    detection,
    seen_from_base,
    true_objects,
    true_poses,
    write_with_detections,
)
from mcap.reader import make_reader

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.replay.replay import replay
from tccm_ros.results.map_file import load_map
from tccm_ros.ros.surface_messages import SURFACE_OBJECTS

BAG = Path(__file__).resolve().parents[2] / "bags" / "walkthrough"
STAYS, COMES = "box that stays", "box that comes"
MUG = (("mug", 0.8), ("bowl", 0.1))
CRATE = (("crate", 0.6),)


@dataclass
class Labelled:
    """A replay with detections."""

    out: Path
    objects: list
    dropped: dict
    truth: dict

    def at(self, name: str) -> dict:
        """Return the object of objects.json that stands where a true one does."""
        (found,) = [
            o for o in self.objects if np.linalg.norm(o["center"] - self.truth[name]) < 0.05
        ]
        return found


def replayed(tmp, messages, config=None, **options) -> Labelled:
    bag, out = tmp / "bag", tmp / "out"
    write_with_detections(BAG, bag, messages)
    replay(bag, out, config or Config(), pictures=False, **options)
    counts = json.loads((out / "summary.json").read_text())["counts"]
    objects = json.loads((out / "objects.json").read_text())["objects"]
    return Labelled(out, objects, counts["dropped"], true_objects(BAG))


def outside(frame_id: str, name: str, results, part: slice):
    """Yield messages in the map or the odometry frame, which the robot began in."""
    for stamp_ns in true_poses(BAG)[0][::25][part]:
        item = detection(TYPES, true_objects(BAG)[name], results)
        yield int(stamp_ns), array_message(TYPES, int(stamp_ns), frame_id, [item])


def wrong(stamp_ns: int):
    """Yield messages of which nothing can be used."""
    nan = detection(TYPES, (math.nan, 0.0, 0.8), MUG)
    bare = detection(TYPES, (0.8, 0.0, 0.8), ())
    unsure = detection(TYPES, (0.8, 0.0, 0.8), (("mug", math.nan), ("", 0.5), ("cup", 7.0)))
    other = detection(TYPES, (0.8, 0.0, 0.8), MUG, frame_id="base_link")
    in_air = detection(TYPES, (0.8, 0.0, 1.8), MUG)
    yield (
        stamp_ns,
        array_message(TYPES, stamp_ns, "base_footprint", [nan, bare, unsure, other, in_air]),
    )
    lost = array_message(TYPES, stamp_ns + 1, "no_such_frame", [in_air])
    yield stamp_ns + 1, lost
    yield stamp_ns + 2, array_message(TYPES, stamp_ns + 2, "base_footprint", [])


@pytest.fixture(scope="module")
def labelled(tmp_path_factory):
    after = int(true_poses(BAG)[0][600])
    messages = [
        *seen_from_base(BAG, {STAYS: MUG}),
        *outside("map", COMES, CRATE, slice(1, None, 2)),
        *outside("odom", COMES, CRATE, slice(2, None, 2)),
        *wrong(after + 5_000_000),
    ]
    # Two messages of one stamp on one topic are one too many: these have stamps of their own.
    moved = [
        (t + k, _with_stamp(m, t + k)) for k, (t, m) in enumerate(messages) if m.header.frame_id
    ]
    return replayed(tmp_path_factory.mktemp("labelled"), moved)


def _with_stamp(message, stamp_ns):
    return array_message(TYPES, stamp_ns, message.header.frame_id, message.detections)


def test_an_object_has_the_class_with_the_largest_score_and_its_mean(labelled):
    mug = labelled.at(STAYS)
    assert mug["label"] == "mug"
    assert mug["confidence"] == pytest.approx(0.8)


def test_detections_in_the_map_and_the_odometry_frame_count_too(labelled):
    crate = labelled.at(COMES)
    assert crate["label"] == "crate"
    assert crate["confidence"] == pytest.approx(0.6)


def test_unusable_detections_are_counted_by_reason(labelled):
    dropped = {why: n for why, n in labelled.dropped.items() if "no object" not in why}
    assert dropped == {
        "detection: its position is not finite": 1,
        "detection: no class with a score within 0 to 1": 2,
        "detection: in another frame than its message": 1,
        "no way from base to sensor": 1,
    }
    # Before the box came, and in mid-air.
    assert labelled.dropped["detection: no object of the map there"] > 5


def test_the_bag_of_results_has_the_labels(labelled):
    with (labelled.out / "result.mcap").open("rb") as stream:
        read = make_reader(stream).iter_messages(topics=["/surface_slam/objects"])
        ((_, _, message),) = list(read)
        stream.seek(0)
        texts = [
            marker.text
            for _, channel, raw in make_reader(stream).iter_messages()
            if channel.topic == "/surface_slam/surfaces"
            for marker in TYPES.deserialize("visualization_msgs/msg/MarkerArray", raw.data).markers
            if marker.ns == "object label"
        ]
    objects = TYPES.deserialize(SURFACE_OBJECTS, message.data).objects
    found = {o.label: o.confidence for o in objects if o.label}
    assert found == {"mug": pytest.approx(0.8), "crate": pytest.approx(0.6)}
    assert {"mug 0.80", "crate 0.60"} <= set(texts)


def test_a_saved_map_keeps_the_labels(labelled):
    saved = load_map(labelled.out / "map.mcap")
    loaded = SurfaceSlam.from_saved(Config(), saved).solve()
    found = {item.class_id: item for item in loaded.objects}
    assert found["mug"].center == pytest.approx(labelled.truth[STAYS], abs=0.05)
    assert found["mug"].label.score == pytest.approx(0.8)
    assert found["crate"].label.score == pytest.approx(0.6)


def test_detections_are_of_a_type_that_bags_hold():
    assert TYPES.knows(ARRAY)
