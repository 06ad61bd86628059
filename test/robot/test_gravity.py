"""Roll and pitch by gravity against rotations in closed form, and against numpy's means."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tccm_ros.robot.gravity import StopGravity, UsualRollPitch, nearest_gravity, roll_pitch_of

MAX_OFF = 0.03  # rad, from the gyroscope's gravity: 0.3 m/s2
MAX_USUAL = 0.2  # rad, of the usual roll and pitch: 11 deg
MIN_DRIVE_STEPS = 100  # of 20 ms: 2 s

angles = st.floats(-0.99 * MAX_USUAL, 0.99 * MAX_USUAL)


def force_of(roll, pitch, length=9.81):
    """Return the specific force (3,) of a base at rest."""
    return Rotation.from_euler("xyz", [roll, pitch, 0.3]).as_matrix().T @ [0.0, 0.0, length]


@given(angles, angles, st.sampled_from([9.81, 9.5, 1.0]))
def test_roll_and_pitch_are_those_of_the_rotation(roll, pitch, length):
    force = force_of(roll, pitch, length)
    np.testing.assert_allclose(roll_pitch_of(force), [roll, pitch], atol=1e-12)
    assert nearest_gravity(force) == (1.0 if length == 1.0 else 9.81)


@pytest.mark.parametrize(
    "force",
    [force_of(0.0, 0.0, 9.0), force_of(0.0, 0.0, 0.0), force_of(1.2 * MAX_USUAL, 0.0),
     force_of(0.0, -1.2 * MAX_USUAL), force_of(np.pi, 0.0), np.full(3, np.nan)],
)  # fmt: skip
def test_other_accelerations_and_large_angles_give_no_roll_and_pitch(force):
    assert roll_pitch_of(force) is None


def test_a_stop_has_the_mean_of_its_measurements():
    found = 0.005 * np.random.default_rng(0).standard_normal((50, 2))
    gravity = StopGravity()
    for k, offset in enumerate(found):
        assert gravity.is_averaged == (2 * k >= 50)
        assert gravity.add(offset)
    np.testing.assert_allclose(gravity.offset, found.mean(axis=0), atol=1e-12)
    # A running variance lags behind the mean: within a quarter, with 100 numbers.
    assert gravity.scatter == pytest.approx(found.var(), rel=0.25)
    gravity.begin()
    assert not gravity.is_measured


def test_contradicting_accelerations_are_ignored_unless_they_persist():
    gravity, other = StopGravity(), np.array([2.0 * MAX_OFF, 0.0])
    gravity.add(np.zeros(2))
    for _ in range(3):
        for _ in range(25 - 1):
            assert not gravity.add(other)
        assert gravity.add(np.zeros(2))
    np.testing.assert_array_equal(gravity.offset, [0.0, 0.0])
    for _ in range(25):
        assert not gravity.add(other)
    assert not gravity.is_measured
    assert gravity.add(other)
    np.testing.assert_array_equal(gravity.offset, other)


def drive(usual, roll, pitch, steps=MIN_DRIVE_STEPS, ahead=0.5):
    """Drive from stop to stop: the base gains speed, and loses it again."""
    usual.end()
    accelerations = np.column_stack([np.linspace(ahead, -ahead, steps), np.zeros((steps, 2))])
    first, *others = force_of(roll, pitch) + accelerations
    usual.begin([first])
    for force in others:
        usual.add(force, np.zeros(3))
    usual.end()


def test_the_usual_values_are_the_median_of_the_drives():
    usual = UsualRollPitch()
    drive(usual, 0.01, 0.02, steps=MIN_DRIVE_STEPS - 1)
    assert usual.value is None, "the drive was too short"
    drive(usual, 0.01, 0.02)
    np.testing.assert_allclose(usual.value, [0.01, 0.02], atol=1e-9)
    drive(usual, 0.02, 0.03)
    drive(usual, -0.1, 0.1)
    np.testing.assert_allclose(usual.value, [0.01, 0.03], atol=1e-9)


def test_a_drive_that_is_not_known_whole_does_not_count():
    usual = UsualRollPitch()
    usual.begin([force_of(0.01, 0.0)])
    assert not usual.is_driving, "it did not begin at a stop"
    usual.end()
    usual.begin([force_of(0.01, 0.0)] * MIN_DRIVE_STEPS)
    assert usual.is_driving
    usual.lose()
    assert not usual.is_driving
    usual.end()
    assert usual.value is None
