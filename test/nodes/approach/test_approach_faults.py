"""Cancellations and dropouts at random moments: a goal always ends, and the base then stands."""

import os
import random
from collections import deque

import pytest
from approach_driver import ABORTED, CANCELED, SUCCEEDED
from approach_world import simple_flat

from tccm_ros.nodes.interfaces import has_interfaces

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

ROUNDS = int(os.environ.get("TCCM_ROUNDS", "8"))
"""Goals of a seed; many with TCCM_ROUNDS=1000."""

SEEDS = int(os.environ.get("TCCM_SEEDS", "2"))
"""Number of seeds; 20 with TCCM_SEEDS=20."""

MAX_STEPS = 60
"""Longest time between faults, steps of 0.05 s: from looking to closing in."""

INPUTS = ("odom", "scan", "cycle")
FAULTS = (*INPUTS, "localisation", "cancel", "second goal", "nothing")


class Faults:
    """Makes faults and repairs them."""

    def __init__(self, driver, chance):
        self.driver, self.robot, self.chance = driver, driver.robot, chance

    def wait(self):
        for _ in range(self.chance.randint(0, MAX_STEPS)):
            self.robot.step()

    def make(self, kind, goal):
        if kind in INPUTS:
            self.robot.base.mute.add(kind)
        elif kind == "localisation":
            self.robot.is_localised = False
        elif kind == "cancel":
            goal.cancel_goal_async()
        elif kind == "second goal":
            status, result = self.driver.ask(0)
            assert status in (ABORTED, SUCCEEDED), result.message
            assert result.message

    def repair(self):
        self.robot.base.mute.clear()
        self.robot.is_localised = True


@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_goal_ends_and_the_base_stands_whatever_happens(drive, seed):
    driver, chance = drive(simple_flat(None, (0.3, -0.2, 0.5))), random.Random(seed)
    faults, robot = Faults(driver, chance), driver.robot
    # What the integration map forgets has a test of its own (test_approach.py).
    robot.base.window = deque(robot.base.window)
    for number in range(ROUNDS):
        which = chance.choice([0, 0, 0, 1])
        goal = driver.send(which, **({"distance": 0.2} if which else {}))
        made = []
        for _ in range(chance.randint(1, 3)):
            faults.wait()
            made.append(chance.choice(FAULTS))
            faults.make(made[-1], goal)
            if chance.random() < 0.5:
                faults.wait()
                faults.repair()
        goal.cancel_goal_async()
        status, result = driver.result(goal)
        assert status in (SUCCEEDED, CANCELED, ABORTED), (number, made)
        assert result.message, (number, made)
        faults.repair()
        assert driver.stands(), (number, made, result.message)
        assert robot.base.contacts == 0, (number, made)
