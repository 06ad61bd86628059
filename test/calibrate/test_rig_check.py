"""The check while mapping finds the error of a simulated rig, and nothing where there is none."""

import numpy as np
import pytest
from fed import fed_tccm

from tccm_ros.calibrate.rig_check import RigCheck, _doubled
from tccm_ros.records import PlaneRecord
from tccm_sim.options import Options
from tccm_sim.recording import run


def findings(**errors) -> dict[str, float]:
    options = Options(tilt_beams=181, cycle_period=2.0, people=False, **errors)
    fed, check = fed_tccm(expects_odometry=True), RigCheck()
    for message in run("room", options=options):
        if message.topic != "/scan":
            for record in message.records:
                for result in fed.add(record):
                    check.add(result)
    for result in fed.finish():
        check.add(result)
    return {finding.name: finding.size for finding in check.findings()}


def test_a_rig_without_errors_gives_no_finding():
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
def test_the_error_of_a_rig_is_the_first_finding(errors: dict, name: str, size: float | None):
    found = findings(**errors)
    assert next(iter(found)) == name
    # The base is tilted by 0.07 deg at each place.
    assert size is None or found[name] == pytest.approx(size, abs=0.004)


def square(height, *, side=1.0, at=(0.0, 0.0), slope=0.0, hole=None) -> PlaneRecord:
    """Return a horizontal plane over a square, or one with a slope along x."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2.0

    def ring(width):
        xy = width * corners + at
        return np.column_stack([xy, height + slope * xy[:, 0]])

    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    boundary = ring(side)
    return PlaneRecord(
        id=0, kind="horizontal", normal=normal, offset=float(normal @ boundary[0]),
        covariance=np.eye(3), support=1000, area=side**2, quality=1.0, boundary=boundary,
        holes=() if hole is None else (ring(hole),), rms=0.002, centroid=boundary.mean(axis=0),
    )  # fmt: skip


def findings_at_origin(planes) -> list[tuple[str, float]]:
    check = RigCheck()
    check._doubled = _doubled(planes, np.eye(4))
    return [(finding.name, finding.size) for finding in check.findings()]


def test_two_planes_one_above_the_other_are_a_surface_mapped_twice():
    found = findings_at_origin([square(0.70), square(0.72, side=0.8)])
    assert found == [("doubled surface", pytest.approx(0.02))]


def test_distance_of_doubled_planes_grows_with_range_if_the_base_is_tilted():
    planes = [square(0.70, at=(2.0, 0.0)), square(0.73, at=(2.0, 0.0), side=0.8)]
    base_tilt = 0.02  # rad: 40 mm at 2 m
    assert _doubled(planes, np.eye(4)) is not None
    assert _doubled(planes, np.eye(4), base_tilt) is None


@pytest.mark.parametrize(
    "planes",
    [
        pytest.param([square(0.70), square(0.71)], id="noise"),
        pytest.param([square(0.70), square(0.78)], id="a shelf"),
        pytest.param([square(0.70), square(0.72, at=(2.0, 0.0))], id="beside"),
        pytest.param([square(0.70, hole=0.6), square(0.72, side=0.5)], id="in a hole"),
        pytest.param(
            [square(0.0, side=9.0, slope=0.005), square(0.02, side=0.8, at=(4.0, 0.0))],
            id="on a tilted floor",
        ),
        pytest.param([square(0.70, at=(4.0, 0.0)), square(0.72, at=(4.0, 0.0))], id="far away"),
    ],
)
def test_planes_that_may_both_be_seen_are_not_a_surface_mapped_twice(planes):
    assert findings_at_origin(planes) == []
