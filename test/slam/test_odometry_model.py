import numpy as np
import pytest

from tccm_ros.slam.odometry_model import OdometryScale

COV = np.diag([0.02**2, 0.02**2, 0.01**2])
STRONG, NONE = np.diag([1e6, 1e6, 1e6]), np.diag([0.0, 1e6, 1e6])


def drive(truth, information, steps=200, seed=0):
    """Drive steps of 0.3 m; what is placed is the mean of matching and odometry."""
    random = np.random.default_rng(seed)
    scale = OdometryScale()
    for _ in range(steps):
        odometry = np.array([0.3 / truth + random.normal() * 0.005, 0.0, 0.0])
        weight = information[0, 0] / (information[0, 0] + 1.0 / COV[0, 0])
        placed = weight * 0.3 + (1.0 - weight) * scale.value * odometry[0]
        scale.update(odometry, np.array([placed, 0.0, 0.0]), information, COV)
    return scale


@pytest.mark.parametrize("truth", [0.9, 0.97, 1.0, 1.1])
def test_matching_determines_the_scale_of_odometry(truth):
    # 5 mm on 0.3 m, 200 times: 0.12 %; the rest is what the filter takes for noise.
    assert drive(truth, STRONG).value == pytest.approx(truth, abs=0.01)


@pytest.mark.parametrize("truth", [0.9, 1.1])
def test_weak_matching_determines_the_scale_slowly_but_without_bias(truth):
    weak = np.diag([500.0, 500.0, 500.0])
    assert drive(truth, weak, steps=3000).value == pytest.approx(truth, abs=0.015)


def test_a_corridor_does_not_change_the_scale():
    scale = drive(1.1, NONE)
    assert scale.value == pytest.approx(1.0, abs=0.01)


def test_slips_rotations_and_short_steps_do_not_change_the_scale():
    scale = OdometryScale()
    for odometry in ([0.3, 0.0, 0.5], [0.1, 0.0, 0.0], [1.2, 0.0, 0.0]):
        scale.update(np.array(odometry), np.array([0.3, 0.0, 0.0]), STRONG, COV)
    assert scale.value == 1.0


def test_only_translations_are_scaled():
    assert OdometryScale(1.1).corrected(np.array([1.0, 2.0, 0.5])) == pytest.approx([1.1, 2.2, 0.5])


@pytest.mark.parametrize("steps", [0, 3, 10, 60])
@pytest.mark.parametrize("expected", [0.01, 0.03])
def test_the_error_of_a_scale_is_that_over_robots(steps, expected):
    """400 robots with wheels as expected, and noise as the model has it; 25 % are 3.5 sigmas."""
    random = np.random.default_rng(0)
    matched = np.diag([400.0, 400.0, 400.0])
    v_match, v_odometry = 1.0 / 401.0, COV[0, 0] * 10.0
    weight = v_odometry / (v_odometry + v_match)
    errors, variances = [], []
    for _ in range(400):
        truth = 1.0 + expected * random.normal()
        scale = OdometryScale(error_variance=expected**2)
        for _ in range(steps):
            odometry = np.array([1.0 / truth + random.normal() * v_odometry**0.5, 0.0, 0.0])
            by_matching = 1.0 + random.normal() * v_match**0.5
            placed = weight * by_matching + (1.0 - weight) * scale.value * odometry[0]
            scale.update(odometry, np.array([placed, 0.0, 0.0]), matched, COV * 10.0)
        errors.append(scale.value - truth)
        variances.append(scale.error_variance)
    assert np.mean(np.square(errors)) == pytest.approx(np.mean(variances), rel=0.25)
