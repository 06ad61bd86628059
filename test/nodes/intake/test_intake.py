"""The intake takes messages without an executor, goes on after an error, and ends when told to."""

from threading import Thread

import pytest
from rclpy.node import Node
from std_msgs.msg import String

from tccm_ros.nodes.intake.inputs import Inputs
from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.nodes.qos import sensor_qos

STRING = "std_msgs/msg/String"


@pytest.fixture
def heard(ros):
    """Return (intake, texts received, errors, publish): the listener's node is never spun."""
    node, errors, got = Node("probe", context=ros.another_context()), [], []
    intake = Intake(node, errors.append)
    inputs = Inputs(node, 0.0, intake)

    def take(message) -> None:
        if message.data == "bad":
            raise ValueError(message.data)
        got.append(message.data)

    inputs.subscribe(STRING, "words", take, sensor_qos("reliable"))
    timer = node.create_timer(0.01, lambda: got.append("tick"), callback_group=intake.group)
    intake.add_timer(timer)
    talker = ros.add(Node("talker", context=ros.another_context()))
    publisher = talker.create_publisher(String, "words", 10)
    intake.start()
    ros.connect(talker, node, "/words")
    yield intake, got, errors, lambda text: publisher.publish(String(data=text))
    intake.close()
    node.destroy_node()


def test_messages_and_timers_need_no_executor(ros, heard):
    _, got, _, publish = heard
    publish("one")
    ros.spin_until(lambda: "one" in got)
    ros.spin_until(lambda: got.count("tick") >= 3)
    assert got.count("one") == 1


def test_an_error_in_a_callback_does_not_end_the_intake(ros, heard):
    _, got, errors, publish = heard
    publish("bad")
    publish("one")
    ros.spin_until(lambda: "one" in got)
    assert [str(error) for error in errors] == ["bad"]


def test_timer_added_while_running_counts_from_the_next_start(ros, heard):
    intake, got, _, _ = heard
    other = ros.add(Node("other", context=ros.another_context()))
    intake.add_timer(
        other.create_timer(0.01, lambda: got.append("tock"), callback_group=intake.group)
    )
    before = got.count("tick")
    ros.spin_until(lambda: got.count("tick") >= before + 3)
    assert "tock" not in got
    intake.start()
    ros.spin_until(lambda: "tock" in got)


def test_no_message_is_lost_where_the_intake_starts_anew(ros):
    node, got = Node("probe", context=ros.another_context()), []
    intake = Intake(node, print)
    inputs = Inputs(node, 0.0, intake)
    restarts = []

    def take(message) -> None:
        got.append(message.data)
        if not restarts:
            restarts.append(Thread(target=intake.start))
            restarts[0].start()
            ros.spin_until(lambda: intake._is_done)

    talker = ros.add(Node("talker", context=ros.another_context()))
    publishers = []
    for topic in ("words", "more_words"):
        inputs.subscribe(STRING, topic, take, sensor_qos("reliable"))
        publishers.append(talker.create_publisher(String, topic, 10))
        ros.connect(talker, node, f"/{topic}")
    for publisher in publishers:
        publisher.publish(String(data=publisher.topic_name))
        assert publisher.wait_for_all_acked()
    intake.start()
    ros.spin_until(lambda: len(got) == 2)
    restarts[0].join()
    intake.close()
    node.destroy_node()
    assert sorted(got) == ["/more_words", "/words"]


def test_no_message_is_taken_after_the_intake_is_closed(ros, heard):
    intake, got, _, publish = heard
    ros.spin_until(lambda: "tick" in got)
    intake.close()
    before = len(got)
    publish("late")
    for _ in range(5):
        ros.executor.spin_once(timeout_sec=0.02)
    assert len(got) == before
