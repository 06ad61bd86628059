"""Goals of a simulated base with faults, without DDS."""

import random

import numpy as np
from approach_world import ROBOT, SimulatedBase, a_goal, simple_flat, surroundings

from tccm_ros.approach.approach import Approach
from tccm_ros.approach.retreat import Retreat
from tccm_ros.approach.speeds import STOP

FAULTS = ("odom", "scan", "cycle", "map", "cancel", "next goal", "nothing")
MAX_STEPS = 60
"""Longest time between faults, steps of the control loop."""

AT_REST = 0.02
"""Speed below which the base counts as standing, m/s and rad/s."""

LATE = 0.1
"""Fraction of steps whose command comes late, by up to twice the watchdog's time."""


class FaultyDrive:
    """Goals one after the other, with faults at random steps and a loop that is late at times."""

    def __init__(self, seed):
        self.chance = random.Random(seed)
        self.flat = simple_flat(None, (0.3, -0.2, 0.5))
        self.base = SimulatedBase(self.flat, np.random.default_rng(seed))
        self.machine, self.is_cancelled, self.outcomes = None, False, []
        self.rest_s: list[float] = []

    def tick(self):
        machine, base = self.machine, self.base
        if machine is None:
            base.tick(None)
            return
        readings = base.readings()
        command = machine.cancel(readings) if self.is_cancelled else machine.step(readings)
        late = self.chance.randint(1, 10) if self.chance.random() < LATE else 0
        for _ in range(late):
            base.tick(None)
        # As approach_node: a command for a place that the base has left is not sent.
        base.tick(machine.wait(readings) if late > 1 else command)
        if machine.outcome is not None:
            self.outcomes.append(machine.outcome)
            self.machine = None

    def wait(self):
        for _ in range(self.chance.randint(0, MAX_STEPS)):
            self.tick()

    def send(self):
        is_retreat = self.chance.random() < 0.25
        goal, around = a_goal(self.flat), surroundings(self.flat)
        self.machine = Retreat(ROBOT, 0.2) if is_retreat else Approach(ROBOT, goal, around)
        self.is_cancelled = False

    def make(self, kind):
        if kind == "cancel":
            self.cancel()
        elif kind == "next goal" and self.machine is None:
            self.send()
            while self.machine is not None:
                self.tick()
        elif kind in FAULTS[:4]:
            self.base.mute.add(kind)

    def goal(self):
        self.send()
        for _ in range(self.chance.randint(1, 3)):
            self.wait()
            self.make(self.chance.choice(FAULTS))
            if self.chance.random() < 0.5:
                self.wait()
                self.base.mute.clear()
        self.cancel()
        self.base.mute.clear()

    def cancel(self):
        """Cancel the goal; measure the time to rest, if it drives."""
        start_s, is_driving = self.base.t, self.base.speed > AT_REST
        self.is_cancelled = True
        if self.machine is not None:
            # As approach_node: the cancellation itself sends zero, also while the loop is late.
            self.base.tick(STOP)
        if is_driving:
            while self.base.speed > AT_REST:
                self.base.tick(None)
            self.rest_s.append(self.base.t - start_s)
        while self.machine is not None:
            self.tick()
