"""Experiment (B) of the first paper: a shelf with a drawer, scanned while waist and neck move."""

import numpy as np
import pytest

from tccm_ros.bags.reader import BagReader
from tccm_ros.config import Config
from tccm_ros.records import PlaneKind
from tccm_ros.replay.run import run_bag
from tccm_sim.options import Options
from tccm_sim.recording import simulate

TILT_CYCLES = 3 * 1.575 + 0.2
"""Duration of three tilt cycles, s: waist and neck move by up to 23 and 26 deg in it."""


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    bag = simulate(
        "shelf", tmp_path_factory.mktemp("shelf") / "bag", options=Options(duration=TILT_CYCLES)
    )
    return bag, run_bag(bag, Config())


def test_the_boards_of_a_shelf_are_found_while_waist_and_neck_move(shelf):
    """Noise of 2.5 mm on a few hundred points leaves 0.2 mm; one joint at rest would be 10 cm."""
    _, outcome = shelf
    heights = {s.height for s in outcome.solution.surfaces if s.label != "floor"}
    for truth in (1.200, 0.325):
        assert min(abs(h - truth) for h in heights) < 0.001, (truth, heights)
    assert outcome.solution.floor_z == pytest.approx(0.0, abs=0.001)


def test_the_front_of_the_shelf_is_a_vertical_plane(shelf):
    """0.600 m ahead; the knobs on it stand out by 3 cm, the drawer's front is at 0.350 m."""
    _, outcome = shelf
    inclined = [p for p in outcome.cycles[-1].planes if p.kind == PlaneKind.ANY]
    ahead = [-p.offset for p in inclined if p.normal[0] < -0.999]
    assert min(abs(x - 0.600) for x in ahead) < 0.004
    assert min(abs(x - 0.350) for x in ahead) < 0.001


def test_waist_and_neck_do_move(shelf):
    """Or a chain of fixed joints would pass as well."""
    bag, _ = shelf
    with BagReader(bag) as reader:
        samples = [r for _, _, r in reader.records({"joint_states": "/joint_states"})]
    position = {name: [] for name in ("waist_joint", "neck_yaw_joint", "neck_pitch_joint")}
    for sample in samples:
        for name in position.keys() & set(sample.names):
            position[name].append(sample.positions[sample.names.index(name)])
    assert min(np.ptp(values) for values in position.values()) > 0.25


TWO_CYCLES = 2 * 1.575 + 0.2
"""Duration of two tilt cycles, s."""


@pytest.fixture(scope="module", params=["arm", "gripper"])
def table(request, tmp_path_factory):
    """A recording of a robot that moves a part of itself over a table, in view of its laser.

    Without mixed pixels, which lie between that part and what is behind it.
    """
    options = Options(duration=TWO_CYCLES, faults=False)
    return simulate(request.param, tmp_path_factory.mktemp("table") / "bag", options=options)


def over_the_table(bag, self_filter):
    """Return the result, and the mean points of cuboids 5 cm to 60 cm over the table's height."""
    config = Config()
    config.scan.self_filter = self_filter
    outcome = run_bag(bag, config)
    mean = outcome.tccm.map.cuboids().mean()
    inside = (mean[:, 2] > 0.75) & (mean[:, 2] < 1.30) & (mean[:, 0] > 0.2) & (mean[:, 0] < 1.4)
    return outcome, mean[inside & (abs(mean[:, 1]) < 0.7)]


def test_a_part_that_moves_through_the_view_is_filtered_by_its_joints(table):
    outcome, points = over_the_table(table, self_filter=True)
    assert len(points) == 0
    assert all(not cycle.objects for cycle in outcome.cycles)
    heights = [s.height for s in outcome.solution.surfaces if s.label != "floor"]
    assert heights == [pytest.approx(0.700, abs=0.001)]


def test_that_part_is_in_the_map_without_the_filter(table):
    """Or the test above would pass with a part that nothing sees."""
    _, points = over_the_table(table, self_filter=False)
    assert len(points) > 100
    assert np.ptp(points[:, 2]) > 0.1, "it moves"
