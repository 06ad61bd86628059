"""Figures and problems of inputs, from counts alone."""

import math
from collections import Counter

import pytest

from tccm_ros.errors import MessageError
from tccm_ros.nodes.intake.diagnostics import message_counts
from tccm_ros.nodes.intake.drops import DropWatch
from tccm_ros.nodes.intake.inputs import Input, Inputs
from tccm_ros.nodes.intake.refusals import Refusals

LATENCIES = 15  # records behind the median


class Counted(Inputs):
    """Inputs without a node; nothing is silent."""

    def __init__(self, *entries, max_lag_s=0.5):
        super().__init__(None, 5.0, max_lag_s=max_lag_s)
        self._inputs += entries

    def problem(self, entry):
        return None


def entry(topic, latency_s, count=10):
    made = Input(topic, topic, "sensor_msgs/msg/LaserScan", "stream", count)
    for k in range(LATENCIES):
        made.note(round((k + latency_s) * 1e9), k * 1_000_000_000)
    return made


@pytest.fixture
def refusals():
    return Refusals(lambda text: None)


def test_an_input_that_lags_is_a_problem_of_its_own_topic():
    inputs = Counted(entry("/scan", 2.0), entry("/odom", 0.02), entry("/joint_states", 0.01))
    (text,) = inputs.problems()
    assert text.startswith("'/scan' comes 2.0 s later")
    assert inputs.late() == {"/scan": text}


def test_stamps_on_receipt_have_no_lag():
    inputs = Counted(entry("/scan", 2.0), entry("/odom", 0.02), max_lag_s=math.inf)
    assert not inputs.problems()


def test_no_more_is_used_than_was_received_and_read():
    scan, odom = entry("/scan", 0.0), entry("/odom", 0.0)
    odom.refused = 3
    assert (scan.values(12)["used"], odom.values(None)["used"]) == (10, 7)


def test_figures_name_topics_and_reasons(refusals):
    refusals.note("/scan", MessageError("cut short"))
    inputs = Counted(entry("/scan", 0.0))
    assert message_counts(inputs, refusals, Counter({"no odometry": 2})) == {
        "received /scan": 10, "refused /scan": 1, "dropped: no odometry": 2,
    }  # fmt: skip


def test_only_new_drops_are_a_problem():
    drops = DropWatch()
    assert drops.problems(Counter({"no odometry": 5}))
    assert not drops.problems(Counter({"no odometry": 5}))
