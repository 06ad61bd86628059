"""The SLAM node and pictures: subscribed to, posed, read in a process of their own, fed to SLAM."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from live_robot import START_NS, STEP_NS, URDF, recording, slam, wait_until_done
from posed_pictures import needs_reader, picture_of, wall_with

from tccm_ros.config import Config
from tccm_ros.nodes import slam_node
from tccm_ros.records import RobotDescription
from tccm_ros.replay.processors import Pipeline
from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement


def with_pictures(records, pixels, every=10):
    """Yield a recording with pictures of a camera at the level laser, two a second.

    The light changes from each to the next: a view that does not change is not read again.
    """
    darker = itertools.cycle((0, 40))
    for topic, record in records:
        yield topic, record
        if topic == "scan" and (record.stamp_ns - START_NS) // STEP_NS % every == 1:
            pixels_now = pixels - np.minimum(pixels, np.uint8(next(darker)))
            image = picture_of(pixels_now, record.stamp_ns, frame="low")
            yield "camera/camera_info", image.camera
            yield "camera/image_raw", image


def offline_events(records):
    """Return what pictures tell the map of a replay: the same records, without nodes."""
    pipeline, events = Pipeline(Config(), expects_odometry=True), []
    urdf = URDF.format(p="", kind="revolute")
    pipeline.add("robot_description", RobotDescription(urdf))
    take = pipeline.slam.add
    pipeline.slam.add = lambda event: (events.append(event), take(event))[1]
    for topic, record in records:
        pipeline.add(topic, record)
    pipeline.finish()
    return [event for event in events if type(event) in (SearchedPicture, SignMeasurement)]


def content(event):
    """Return all that an event of a picture tells, as bytes."""
    names = [name for name in event.__slots__ if name != "text"]
    return [np.asarray(getattr(event, name)).tobytes() for name in names]


@needs_reader
def test_signs_of_pictures_are_fed_to_the_solver_as_in_a_replay(ros, monkeypatch):
    node, robot = slam(ros), ros.robot()
    fed = []
    monkeypatch.setattr(node.solver, "add", fed.append)
    robot.play(with_pictures(recording(2), wall_with("317")), node)
    node.robot.flush()
    wait_until_done(ros, node)
    node.signs.wait(lambda: False)
    wait_until_done(ros, node)
    signs = [event for event in fed if type(event) is SignMeasurement]
    assert {sign.number for sign in signs} == {"317"}
    assert len(signs) == node.signs.counts["pictures"] >= 3
    # The camera is 0.3 m over the base.
    assert signs[0].T_base_camera[:3, 3] == pytest.approx([0.0, 0.0, 0.3])
    assert node.used()["camera/image_raw"] == len(signs)
    assert node.processor.counts["level scans"] > 10
    # What the solver makes of it is a function of the records: live equals offline from here on.
    live = [event for event in fed if type(event) in (SearchedPicture, SignMeasurement)]
    offline = offline_events(with_pictures(recording(2), wall_with("317")))
    assert len(live) == 2 * len(signs)
    assert [content(event) for event in live] == [content(event) for event in offline]


def test_missing_extra_is_reported_and_no_pictures_are_subscribed(ros, monkeypatch):
    monkeypatch.setattr(slam_node, "missing_extra", lambda: "rapidocr-onnxruntime is missing")
    node, robot = slam(ros), ros.robot()
    assert not node.inputs.has("/camera/image_raw")
    assert not [text for text in node.all_problems() if "door signs" in text]
    robot.publish("camera/image_raw", robot.message(picture_of(np.zeros((4, 4, 3), np.uint8))))
    ros.spin_until(lambda: node.inputs.is_published("/camera/image_raw"))
    (text,) = [text for text in node.all_problems() if "door signs" in text]
    assert "rapidocr-onnxruntime is missing" in text
    robot.play(recording(1), node)
    assert node.processor.counts["level scans"] > 5


def test_signs_can_be_turned_off(ros):
    node = slam(ros, signs__enabled=False)
    assert not node.inputs.has("/camera/image_raw")
    assert "camera/image_raw" not in node.roles


def test_the_process_that_reads_knows_no_ros():
    import ast

    path = Path(slam_node.__file__).parent / "signs" / "process.py"
    names = {
        name
        for line in ast.walk(ast.parse(path.read_text()))
        if isinstance(line, (ast.Import, ast.ImportFrom))
        for name in [getattr(line, "module", None) or line.names[0].name]
    }
    assert not [name for name in names if name.startswith("rclpy")]
