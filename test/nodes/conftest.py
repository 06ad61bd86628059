"""The fixtures of tests over DDS."""

import pytest
from ros_harness import domain, ros

__all__ = ["domain", "ros"]


@pytest.fixture
def drive(ros):
    from approach_driver import Driver

    made = []

    def make(*args, **values):
        made.append(Driver(ros, *args, **values))
        return made[-1]

    yield make
    for driver in made:
        driver.close()
