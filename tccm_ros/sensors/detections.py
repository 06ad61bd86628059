"""Object detections: their stream, and conversion of messages to records.

Detections give labels to objects on surfaces; they are no measurements of surfaces.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.geometry import inverse, transform
from tccm_ros.records import Detections, Hypothesis, Posed
from tccm_ros.records.building import frame_name, stamp_ns_from_message
from tccm_ros.robot import MountKind, Stream

NOT_FINITE = "detection: its position is not finite"
NO_CLASS = "detection: no class with a score within 0 to 1"
OTHER_FRAME = "detection: in another frame than its message"
"""Reasons of unused detections."""


class PosedDetections(Posed):
    """Detections with the pose of their frame."""

    __slots__ = ()

    @property
    def detections(self) -> Detections:
        """The detections."""
        detections: Detections = self.record
        return detections

    @property
    def center_base(self) -> Float64:
        """The centres in the base frame, float64 (N, 3), m; not for detections in the map frame."""
        T_base_sensor = self.T_base_sensor[0]
        if self.detections.frame_id == self.odom_frame:
            T_base_sensor = inverse(self.T_odom_base[0])
        return transform(T_base_sensor, self.detections.center)


def detections_from_message(message: Any) -> tuple[Detections, ...]:
    """Return the record of a vision_msgs/Detection3DArray; empty where nothing was detected.

    The position of a detection is the centre of its box, or the pose of its best hypothesis if the
    box has no size. Unusable detections are left out and counted.
    """
    if not len(message.detections):
        return ()
    header = message.header
    frame = frame_name(header.frame_id) or frame_name(message.detections[0].header.frame_id)
    unusable: Counter[str] = Counter()
    centers, hypotheses = [], []
    for detection in message.detections:
        own_frame = frame_name(detection.header.frame_id)
        found = _hypotheses(detection.results)
        center = _center(detection)
        if own_frame not in ("", frame):
            unusable[OTHER_FRAME] += 1
        elif not np.isfinite(center).all():
            unusable[NOT_FINITE] += 1
        elif not found:
            unusable[NO_CLASS] += 1
        else:
            centers.append(center)
            hypotheses.append(found)
    stamp_ns = stamp_ns_from_message(header.stamp)
    center = np.array(centers, np.float64).reshape(-1, 3)
    return (Detections(stamp_ns, frame, center, tuple(hypotheses), unusable),)


def _hypotheses(results: Sequence[Any]) -> tuple[Hypothesis, ...]:
    found = (Hypothesis(str(r.hypothesis.class_id), float(r.hypothesis.score)) for r in results)
    return tuple(h for h in found if h.class_id and 0.0 <= h.score <= 1.0)


def _center(detection: Any) -> Float64:
    """Return the position (3,) of a detection, m."""
    box, results = detection.bbox, detection.results
    point = box.center.position
    if not (box.size.x or box.size.y or box.size.z) and len(results):
        best = max(results, key=lambda r: -math.inf if math.isnan(s := r.hypothesis.score) else s)
        point = best.pose.pose.position
    return np.array([point.x, point.y, point.z], np.float64)


DETECTIONS_READER = MessageReader("vision_msgs/msg/Detection3DArray", detections_from_message)


def detections_stream(topic: str) -> Stream:
    """Return the stream of the detections on a topic, whose name is the role of the stream."""
    return Stream(
        role=topic,
        record=Detections,
        reader=DETECTIONS_READER,
        mount=MountKind.ANY,
        processor="slam",
        event=PosedDetections,
        is_occasional=True,
    )
