"""The check while mapping names the error that a simulated rig has, and is silent without one."""

import pytest

from tccm_ros.calibrate import RigCheck
from tccm_ros.config import Config
from tccm_ros.mapping.tccm import TccmProcessor
from tccm_ros.sim import Options, run


def findings(**errors) -> dict[str, float]:
    options = Options(tilt_beams=181, sweep_period=2.0, people=False, **errors)
    processor, check = TccmProcessor(Config(), expects_odometry=True), RigCheck()
    for message in run("room", options=options):
        if message.topic != "/scan":
            for record in message.records:
                for result in processor.add(record):
                    check.add(result)
    for result in processor.finish():
        check.add(result)
    return {finding.name: finding.size for finding in check.findings()}


def test_a_good_rig_gives_no_finding():
    assert findings() == {}


@pytest.mark.parametrize(
    ("errors", "name", "size"),
    [
        ({"tilt_offset": 0.02}, "tilt zero", 0.02),
        ({"laser_roll": 0.02}, "roll", -0.02),
        ({"tilt_scale": 0.93}, "tilt scale", None),
        ({"joint_time_offset": 0.012}, "delay", 0.024),
        ({"joint_time_offset": 0.030}, "delay", None),
    ],
)
def test_an_error_is_named_first(errors: dict, name: str, size: float | None):
    found = findings(**errors)
    assert next(iter(found)) == name
    # The base leans by 0.07 deg at each place.
    assert size is None or found[name] == pytest.approx(size, abs=0.004)
