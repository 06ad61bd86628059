"""Figures and problems of inputs, from counts alone."""

from collections import Counter

import pytest

from tccm_ros.config import Config
from tccm_ros.errors import MessageError
from tccm_ros.nodes.intake.inputs import LATENCIES, Input
from tccm_ros.nodes.intake.node_status import NodeStatus
from tccm_ros.nodes.intake.refusals import Refusals


class Counted:
    """Stands for `Inputs`: nothing is silent."""

    def __init__(self, *entries):
        self.entries = entries

    def __iter__(self):
        return iter(self.entries)

    def problems(self):
        return []

    def problem(self, entry):
        return None

    def counts(self):
        return {entry.topic: entry.count for entry in self.entries}

    def lost(self):
        return {}

    def latencies(self):
        return {entry.topic: entry.latencies_s[-1] for entry in self.entries if entry.latencies_s}


def entry(topic, latency_s, count=10):
    made = Input(topic, topic, "sensor_msgs/msg/LaserScan", "stream", count)
    for k in range(LATENCIES):
        made.note(round((k + latency_s) * 1e9), k * 1_000_000_000)
    return made


@pytest.fixture
def refusals():
    return Refusals(lambda text: None)


def test_an_input_that_lags_is_a_problem_of_its_own_topic(refusals):
    inputs = Counted(entry("/scan", 2.0), entry("/odom", 0.02), entry("/joint_states", 0.01))
    status = NodeStatus(Config(), inputs, refusals)
    (text,) = status.problems_of_inputs()
    assert text.startswith("'/scan' comes 2.0 s later")
    states = {state.topic: state.problems for state in status.input_states({})}
    assert states == {"/scan": (text,), "/odom": (), "/joint_states": ()}


def test_stamps_on_receipt_have_no_lag(refusals):
    config = Config()
    config.qos.stamp = "receive"
    inputs = Counted(entry("/scan", 2.0), entry("/odom", 0.02))
    assert not NodeStatus(config, inputs, refusals).problems_of_inputs()


def test_no_more_is_used_than_was_received_and_read(refusals):
    scan, odom = entry("/scan", 0.0), entry("/odom", 0.0)
    odom.refused = 3
    states = NodeStatus(Config(), Counted(scan, odom), refusals).input_states({"/scan": 12})
    assert [state.values["used"] for state in states] == [10, 7]


def test_figures_name_topics_and_reasons(refusals):
    refusals.note("/scan", MessageError("cut short"))
    status = NodeStatus(Config(), Counted(entry("/scan", 0.0)), refusals)
    assert status.values(Counter({"no odometry": 2})) == {
        "received /scan": 10, "refused /scan": 1, "dropped: no odometry": 2,
    }  # fmt: skip


def test_only_new_drops_are_a_problem(refusals):
    status = NodeStatus(Config(), Counted(), refusals)
    assert status.problems_of_drops(Counter({"no odometry": 5}))
    assert not status.problems_of_drops(Counter({"no odometry": 5}))
