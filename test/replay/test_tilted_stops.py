"""A simulated recording of a base that stands askew: heights with its IMU, and without."""

import numpy as np
import pytest
from imu_maps import map_with_and_without_imu, role_of
from shapely import Point, Polygon

from tccm_ros.config import Config
from tccm_ros.records import RollPitch
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.options import Options
from tccm_sim.truth import map_from_world, surfaces
from tccm_sim.worlds import build_world

SIGMA = 0.0015
"""Of roll and pitch by an IMU, rad (`robot.roll_pitch`)."""


def mapped(stop_tilt):
    """Return the simulation, and its map with the IMU and without."""
    options = Options(imu=True, stop_tilt=stop_tilt, tilt_beams=181, people=False)
    return map_with_and_without_imu("moved", 1, options)


@pytest.fixture(scope="module")
def tilted():
    """1 deg of roll and of pitch at a stop is 52 mm of height at 3 m."""
    return mapped(0.0175)


def tilt_errors(simulation, solution):
    """Return the angle, rad, between up in each view and the truth, float64 (V,)."""
    times = (solution.view_stamps_ns - EPOCH_NS) * 1e-9
    true = map_from_world(simulation) @ simulation.true_poses(times)
    return np.linalg.norm(solution.T_map_views[:, 2, :3] - true[:, 2, :3], axis=1)


def height_errors(simulation, solution):
    """Return the errors of height of the table and the crate, float64 (2,), m."""
    found = []
    for true in surfaces(simulation)["surfaces"]:
        if true["label"] == "cupboard":  # its top is out of sight
            continue
        outline = Polygon([place[:2] for place in true["boundary"]])
        there = [s for s in solution.surfaces if outline.contains(Point(s.centroid[:2]))]
        found.append(min((abs(s.height - true["height"]) for s in there), default=np.inf))
    return np.array(found)


def test_views_stand_as_the_base_did(tilted):
    simulation, with_imu, without = tilted
    # Two angles at two sigmas; the floor's unevenness, 1.2 mrad, is among what counts as none.
    assert tilt_errors(simulation, with_imu).max() < 2.0 * np.sqrt(2.0) * SIGMA
    assert tilt_errors(simulation, without).max() > 0.01


def test_heights_are_right_within_a_few_millimetres(tilted):
    simulation, with_imu, without = tilted
    assert height_errors(simulation, with_imu).max() < 0.005
    assert height_errors(simulation, without).max() > 0.01


def test_a_base_that_stands_level_has_the_same_map_with_an_imu():
    simulation, with_imu, without = mapped(0.0)
    # The heading by the gyroscope, too, is not the wheels': a tenth of a millimetre.
    np.testing.assert_allclose(
        height_errors(simulation, with_imu), height_errors(simulation, without), atol=0.0005
    )
    assert tilt_errors(simulation, with_imu).max() <= tilt_errors(simulation, without).max() + 1e-4


@pytest.mark.parametrize(("world", "stop_tilt"), [("ring", 0.0), ("flat", 0.0175)])
def test_roll_and_pitch_of_an_imu_are_true_at_any_time(world, stop_tilt):
    """Also just after the base has begun to move, when the wheels do not show it yet."""
    options = Options(imu=True, stop_tilt=stop_tilt, tilt=False, level=False)
    simulation = Simulation(build_world(world, options), 0, options)
    robot = Robot(Config(), default_streams(), expects_odometry=True)
    measured = []
    for message in simulation.run():
        role = role_of(simulation, message.topic)
        for record in message.records:
            measured += [e for e in robot.add(role, record) if isinstance(e, RollPitch) and e.usual]
    times = (np.array([e.stamp_ns for e in measured]) - EPOCH_NS) * 1e-9
    true = simulation.true_poses(times)[:, :3, :3]
    true = np.column_stack([np.arctan2(true[:, 2, 1], true[:, 2, 2]), -np.arcsin(true[:, 2, 0])])
    errors = np.array([np.subtract(e.measured, e.usual) for e in measured]) - true
    # 1.5 mrad of unevenness of the floor are among what drives tell.
    sigmas = np.hypot(np.array([e.sigma for e in measured]), 0.0015)[:, None]
    assert len(measured) > 200
    assert np.abs(errors / sigmas).max() < 4.0
