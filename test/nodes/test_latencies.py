"""Inputs that lag: compared with the others, and told with the figure."""

import pytest

from tccm_ros.nodes.intake.inputs import lagging


@pytest.mark.parametrize(
    ("latencies_s", "late"),
    [
        ({"/scan": 0.05, "/odom": 0.01, "/joint_states": 2.05}, ["/joint_states"]),
        ({"/scan": 2.05, "/odom": 0.01}, ["/scan"]),
        ({"/scan": 0.05, "/odom": 0.01, "/joint_states": -2.0}, []),
        ({"/scan": 3.05, "/odom": 3.0, "/joint_states": 3.01}, []),
        ({"/scan": 0.4, "/odom": 0.0}, []),
        ({"/scan": 9.0}, []),
    ],
)
def test_an_input_that_lags_behind_the_others_is_late(latencies_s, late):
    assert sorted(lagging(latencies_s, 0.5)) == late


def test_latency_is_reported():
    (text,) = lagging({"/scan": 2.05, "/odom": 0.01}, 0.5).values()
    assert "'/scan' comes 2.0 s later than the other inputs (2.05 s" in text
