"""Experiment (B) of the first paper: a shelf with a drawer, scanned while waist and neck move."""

import numpy as np
import pytest

from tccm_ros.bags.reader import BagReader
from tccm_ros.config import Config
from tccm_ros.pipeline.run import run_bag
from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.recording import simulate
from tccm_ros.records import PlaneKind

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
