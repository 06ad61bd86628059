"""examples/fetch_mug.py with the simulated base, while somebody moves the table."""

import re

import numpy as np
import pytest
import shapely
from approach_world import ROBOT, Flat, piece, rectangle
from example_process import example
from shapely import Polygon

from tccm_ros.nodes.interfaces import has_interfaces

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

NAMES = """
kitchen/counter: {ids: [2], spot: [0.0, 0.0]}
living/table: {ids: [1], spot: [0.3, 0.1]}
"""
MOVE = (0.2, 0.2, 0.3)
NEAR_M = 0.3
"""The table is moved once the base is as near to the counter."""

MAX_DISTANCE_M = 0.9


def gap(driver, top) -> float:
    return Polygon(ROBOT.footprint.at(driver.robot.base.truth)).distance(top)


def test_a_mug_is_fetched_though_the_table_is_moved_meanwhile(drive, tmp_path):
    names = tmp_path / "named_poses.yaml"
    names.write_text(NAMES)
    table = piece(rectangle(1.4, 0.8), 0.72).moved(0.9, 0.6, 0.0)
    counter = piece(rectangle(1.6, 0.6), 0.9).moved(-1.0, -2.2, 0.0)
    flat = Flat(
        shapely.box(-3.0, -3.0, 3.0, 3.0), table, table, [counter], [counter],
        start=np.array([-1.0, -1.0, -1.5]),
    )  # fmt: skip
    driver = drive(flat, approach__names=str(names), approach__reach=MAX_DISTANCE_M)
    gaps, stood = [], []

    def is_over():
        gaps.append(gap(driver, counter.top))
        if flat.target is table and gaps[-1] < NEAR_M:
            flat.target = table.moved(*MOVE)
        stood.append((gap(driver, flat.target.top), *driver.robot.base.true_figures()))
        return fetching.poll() is not None

    with example(driver.ros, "fetch_mug.py") as fetching:
        driver.robot.drive_until(is_over, 300.0)
        said = fetching.stdout.read()
    assert fetching.returncode == 0, said
    lines = said.splitlines()
    assert lines[0].startswith("kitchen/counter is ")
    assert lines[3].startswith("living/table is ")
    measured = [np.array(re.findall(r"\d+\.\d+", lines[k]), float) for k in (1, 4)]
    assert [lines[k].rpartition(" ")[2] for k in (1, 4)] == ["False", "True"]
    assert (lines[2], lines[5]) == ("take the mug", "put the mug down")
    # As near as asked for to the true edges, and the spots in reach.
    assert min(gaps) == pytest.approx(0.05, abs=0.02)
    nearest = min(stood)
    assert nearest[0] == pytest.approx(0.05, abs=0.02)
    assert abs(np.degrees(nearest[2])) < 1.5
    for (measured_m, distance), true in zip(measured, (min(gaps), nearest[0])):
        assert measured_m == pytest.approx(true, abs=0.01)
        assert distance <= MAX_DISTANCE_M + 0.01
    assert driver.robot.base.contacts == 0
    assert driver.stands()
