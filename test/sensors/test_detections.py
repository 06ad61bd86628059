"""Detections: from messages to records, and where they are in the base frame."""

import math

import numpy as np
import pytest
from detections import VISION, array_message, detection
from message_families import family, to_bag_message

from tccm_ros.config import Config
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import Detections, Hypothesis, JointSample, Odometry, RobotDescription
from tccm_ros.robot import Robot
from tccm_ros.sensors.detections import (
    DETECTIONS_READER,
    NO_CLASS,
    NOT_FINITE,
    OTHER_FRAME,
    PosedDetections,
    detections_stream,
)

ARRAY = VISION + "Detection3DArray"
S = 1_000_000_000
MUG = [("mug", 0.8), ("bowl", 0.1)]
URDF = """<robot name="r"><link name="base"/><link name="head"/><link name="eye"/>
<joint name="neck" type="revolute"><parent link="base"/><child link="head"/>
  <origin xyz="0 0 1"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
</joint>
<joint name="mount" type="fixed"><parent link="head"/><child link="eye"/>
  <origin xyz="0.1 0 0"/></joint></robot>"""


@pytest.fixture(params=["typestore", "rosidl"])
def types(request):
    if request.param == "rosidl":
        pytest.importorskip("vision_msgs.msg", reason="vision_msgs is not installed")
    return family(request.param)


def read(types, *items, frame_id="eye", stamp_ns=5 * S):
    """Return the records of a message that went through CDR."""
    message = array_message(types, stamp_ns, frame_id, items)
    return DETECTIONS_READER.of_message(to_bag_message(types, ARRAY, message))


def test_a_record_has_the_middle_of_each_box_and_its_classes(types):
    (record,) = read(
        types, detection(types, (1, 2, 3), MUG), detection(types, (4, 5, 6), [("a", 0.0)])
    )
    assert (record.stamp_ns, record.frame_id) == (5 * S, "eye")
    assert record.center.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert record.hypotheses == (
        (Hypothesis("mug", 0.8), Hypothesis("bowl", 0.1)),
        (Hypothesis("a", 0.0),),
    )
    assert not record.unusable


def test_without_a_box_the_pose_of_the_best_class_counts(types):
    item = detection(types, (9, 9, 9), [("a", 0.2), ("b", 0.9), ("c", math.nan)], size=(0, 0, 0))
    for k, result in enumerate(item.results):
        result.pose.pose.position.x = float(k)
    (record,) = read(types, item)
    assert record.center.tolist() == [[1, 0, 0]]
    assert [h.class_id for h in record.hypotheses[0]] == ["a", "b"]


@pytest.mark.parametrize(
    ("center", "results", "frame_id", "why"),
    [
        ((math.nan, 0, 0), MUG, "", NOT_FINITE),
        ((0, math.inf, 0), MUG, "eye", NOT_FINITE),
        ((0, 0, 0), [], "", NO_CLASS),
        ((0, 0, 0), [("", 0.5)], "", NO_CLASS),
        ((0, 0, 0), [("mug", math.nan)], "", NO_CLASS),
        ((0, 0, 0), [("mug", -0.1), ("cup", 1.1)], "", NO_CLASS),
        ((0, 0, 0), MUG, "hand", OTHER_FRAME),
    ],
)
def test_unusable_detections_are_counted_and_the_rest_is_used(
    types, center, results, frame_id, why
):
    wrong = detection(types, center, results, frame_id=frame_id)
    (record,) = read(types, wrong, detection(types, (1, 1, 1), MUG))
    assert record.unusable == {why: 1}
    assert record.center.tolist() == [[1, 1, 1]]


def test_where_nothing_was_detected_there_is_no_record(types):
    assert read(types) == ()


def test_the_frame_of_the_detections_counts_where_the_message_has_none(types):
    (record,) = read(types, detection(types, (1, 1, 1), MUG, frame_id="hand"), frame_id="")
    assert record.frame_id == "hand"


def posed(frame_id):
    """Return posed detections of a robot that has driven and turns its head."""
    robot = Robot(Config(), [detections_stream("detections")], expects_odometry=True)
    events = robot.add("robot_description", RobotDescription(URDF))
    for k in range(30):
        now = S + k * S // 20
        T = pose_from_rpy([0.1 * k, 0.0, 0.0, 0.0, 0.0, 0.02 * k])
        events += robot.add("odom", Odometry(now, "odom", "base", T))
        events += robot.add("joint_states", JointSample(now, ("neck",), np.array([0.05 * k])))
        if k == 20:
            stamp_ns = S + 10 * S // 20  # as a recogniser is half a second late
            record = Detections(stamp_ns, frame_id, np.array([[1.0, 0.0, 0.0]]), (MUG,))
            events += robot.add("detections", record)
    events += robot.flush()
    return robot, [e for e in events if isinstance(e, PosedDetections)]


def test_detections_of_a_moving_camera_are_placed_at_their_stamp():
    _, (event,) = posed("eye")
    c, s = math.cos(0.5), math.sin(0.5)
    assert event.center_base == pytest.approx(np.array([[1.1 * c, 1.1 * s, 1.0]]))


def test_detections_in_the_odometry_frame_are_placed_by_where_the_base_was():
    _, (event,) = posed("odom")
    T = pose_from_rpy([1.0, 0.0, 0.0, 0.0, 0.0, 0.2])
    expected = T[:3, :3].T @ (np.array([1.0, 0.0, 0.0]) - T[:3, 3])
    assert event.center_base == pytest.approx(expected[None])


def test_detections_in_the_map_frame_are_given_on():
    _, (event,) = posed("map")
    assert event.detections.frame_id == "map"


def test_detections_in_an_unknown_frame_are_dropped_with_a_reason():
    robot, events = posed("nowhere")
    assert not events
    assert robot.dropped == {"no way from base to sensor": 1}
    assert "nowhere" in str(robot.sensors["detections"].problem)
