"""Errors of points: white noise by range, and what all points of a view have in common."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tccm_ros.config import Config
from tccm_ros.records import SensorKind
from tccm_ros.sensors.noise import systematic_errors

CONFIG = Config()


def test_a_scale_moves_points_along_their_beams():
    config = CONFIG.model_copy(
        update={
            "sensors": CONFIG.sensors.model_copy(update={"depth_systematic": (0.0, 0.01, 0.0, 0.0)})
        }
    )
    eye = np.array([0.0, 0.0, 1.0])
    points = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 1.0]])
    errors = systematic_errors(points, eye, SensorKind.DEPTH_IMAGE, config)
    assert errors[:, 1] == pytest.approx(0.01 * (points - eye))
    assert np.abs(errors[:, [0, 2, 3, 4]]).max() == 0.0


@pytest.mark.parametrize("kind", SensorKind)
def test_systematic_errors_are_those_of_the_range(kind):
    """Numerically: ranges that are wrong by each term, measured again in the same direction."""
    sigmas = {
        SensorKind.LASER: CONFIG.sensors.laser_systematic,
        SensorKind.DEPTH_IMAGE: CONFIG.sensors.depth_systematic,
        SensorKind.POINT_CLOUD: CONFIG.sensors.cloud_systematic,
    }[kind]
    rng = np.random.default_rng(3)
    eye, points = rng.normal(size=3), rng.normal([4.0, 0.0, 0.0], size=(20, 3))
    ranges = np.linalg.norm(points - eye, axis=1)
    rays = (points - eye) / ranges[:, None]
    found = systematic_errors(points, eye, kind, CONFIG)
    for k, sigma in enumerate(sigmas[:3]):
        moved = eye + (ranges + sigma * ranges**k)[:, None] * rays
        assert found[:, k] == pytest.approx(moved - points, abs=1e-12)
    turned = Rotation.from_rotvec([1e-6, 0.0, 0.0]).apply(points - eye) + eye
    assert found[:, 3] == pytest.approx(sigmas[3] * 1e6 * (turned - points), abs=1e-6)
    turned = Rotation.from_rotvec([0.0, 1e-6, 0.0]).apply(points - eye) + eye
    assert found[:, 4] == pytest.approx(sigmas[3] * 1e6 * (turned - points), abs=1e-6)
