"""The fixtures of tests over DDS."""

import pytest
from ros_harness import domain, ros

from tccm_ros.nodes.interfaces import MISSING, missing_interfaces

__all__ = ["domain", "ros"]


@pytest.fixture(scope="session", autouse=True)
def interfaces():
    """Fail at once where the generated messages are of other definitions.

    The nodes warn of it on /diagnostics all the time: tests would wait for OK until they time out.
    """
    assert missing_interfaces() in ("", MISSING), missing_interfaces()


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
