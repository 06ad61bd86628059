"""Commands of a control loop that is late at times, obeyed by a base with a watchdog."""

import numpy as np
from approach_world import ROBOT, TICK_S, WATCHDOG_S
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.approach.drive import Driver
from tccm_ros.approach.guard import Obstacles
from tccm_ros.approach.readings import Readings
from tccm_ros.approach.speeds import STOP, Speeds
from tccm_ros.geometry import compose2, inverse2, transform2

LATENCY_TICKS = round(ROBOT.latency_s / TICK_S)
MAX_LATE = round(WATCHDOG_S / TICK_S)
HELD_M = 0.03
"""What the margin allows for: motion along arcs, checked as a straight motion and a turn, m."""

coordinates = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


class IdealBase:
    """Obeys each command after the latency, and stops itself when none comes."""

    def __init__(self):
        self.t, self.pose = 0.0, np.zeros(3)
        self._queue = [STOP] * LATENCY_TICKS
        self._last, self._silent = STOP, 0

    def tick(self, command):
        self._silent = 0 if command is not None else self._silent + 1
        self._last = self._last if command is None else command
        self._queue.append(STOP if self._silent > MAX_LATE else self._last)
        ahead, yaw_rate = self._queue.pop(0)
        middle = np.array([0.0, 0.0, 0.5 * yaw_rate * TICK_S])
        step = compose2(middle, np.array([ahead * TICK_S, 0.0, 0.5 * yaw_rate * TICK_S]))
        self.pose, self.t = compose2(self.pose, step), self.t + TICK_S


@given(
    st.lists(coordinates, min_size=1, max_size=5),
    st.sampled_from([-0.25, 0.0, 0.1, 0.25]),
    st.sampled_from([-0.6, -0.1, 0.0, 0.3, 0.6]),
    st.lists(st.integers(0, MAX_LATE), min_size=5, max_size=30),
)
@settings(max_examples=300, deadline=None)
def test_a_late_loop_carries_the_base_into_nothing(points, ahead, yaw_rate, delays):
    """Each command acts until the next one comes, at most for the watchdog's time."""
    points = np.array(points)
    start = ROBOT.footprint.distance(points)
    points = points[start > ROBOT.margin]
    if not len(points):
        return
    obstacles = Obstacles(points, np.zeros(len(points)), np.full(len(points), ROBOT.margin))
    base, driver = IdealBase(), Driver(ROBOT)
    for late in [k for delay in delays for k in (0, 0, delay)]:
        readings = Readings(base.t, base.pose, base.t, np.zeros(3))
        base.tick(driver.move(Speeds(ahead, yaw_rate), readings, obstacles))
        for _ in range(late):
            base.tick(None)
        local = transform2(inverse2(base.pose), points)
        assert ROBOT.footprint.distance(local).min() > ROBOT.margin - HELD_M
