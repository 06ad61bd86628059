"""Speeds within limits, and where the base will be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.approach.speeds import (
    CommandHistory,
    SpeedLimits,
    Speeds,
    along_line,
    braking_velocity,
    rotate_to,
)

LIMITS = SpeedLimits(0.25, 0.6, 0.3, 1.0)
PERIOD_S = 0.05
speeds = st.builds(Speeds, st.floats(-2.0, 2.0), st.floats(-4.0, 4.0))


@given(st.lists(speeds, min_size=1, max_size=20))
def test_commands_keep_to_the_limits_whatever_is_wanted(wanted):
    history, last = CommandHistory(LIMITS, 0.1), Speeds()
    for k, now in enumerate(wanted):
        sent = history.send(now, k * PERIOD_S, PERIOD_S)
        assert abs(sent.forward) <= LIMITS.speed
        assert abs(sent.yaw_rate) <= LIMITS.yaw_rate
        assert abs(sent.forward - last.forward) <= 2 * LIMITS.acceleration * PERIOD_S + 1e-9
        assert abs(sent.yaw_rate - last.yaw_rate) <= 2 * LIMITS.yaw_acceleration * PERIOD_S + 1e-9
        last = sent
    assert history.stop(1.0) == (0.0, 0.0)


@given(st.floats(-3.0, 3.0))
def test_the_base_stops_within_the_distance_it_is_braked_for(distance):
    speed = braking_velocity(distance, LIMITS.speed, LIMITS.acceleration)
    assert speed * distance >= 0.0
    assert speed**2 / (2 * LIMITS.acceleration) <= abs(distance) + 1e-9


def test_commands_that_have_not_acted_yet_are_driven_ahead():
    history = CommandHistory(LIMITS, 0.1)
    for k in range(40):
        history.send(Speeds(0.25, 0.0), k * PERIOD_S, PERIOD_S)
    now = 40 * PERIOD_S
    # Odometry is 0.05 s old, a command acts in 0.1 s: 0.15 s at 0.25 m/s.
    ahead = history.predict_pose(np.zeros(3), now - 0.05, now)
    assert ahead == pytest.approx([0.0375, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("start", [(-1.0, 0.2, 0.3), (-0.5, -0.1, -0.4), (0.2, 0.0, 0.1)])
def test_a_base_comes_to_the_line_and_stops_at_its_end(start):
    pose, goal = np.array(start), np.zeros(3)
    for _ in range(600):
        wanted = along_line(pose, goal, LIMITS, 0.25)
        v, w = wanted
        pose = pose + np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), w]) * PERIOD_S
    assert abs(pose[0]) < 0.003
    assert abs(pose[2]) < np.radians(0.3)
    if start[0] < -0.9:
        assert abs(pose[1]) < 0.03
    assert rotate_to(0.5, LIMITS).yaw_rate > 0.0
