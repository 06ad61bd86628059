"""A false is_bigendian is recognised by the numbers, and by nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tccm_ros.sensors.byte_order import is_swapped

RNG = np.random.default_rng(5)
NOISE = RNG.integers(-4, 5, (60, 80))
PLANE = (1000 + np.add.outer(2 * np.arange(60), np.arange(80)) + NOISE).astype(np.uint16)
HOLES = np.where(RNG.random((60, 80)) < 0.5, 0, PLANE).astype(np.uint16)
METRES = np.where(HOLES > 0, HOLES * np.float32(0.001), np.nan).astype(np.float32)
POINTS = RNG.normal(0.0, 3.0, (500, 3))
FLAT = POINTS * [1e-17, 1.0, 1.0]
"""Points in a plane of the sensor: x is rounding alone."""


@pytest.mark.parametrize(
    "values", [PLANE, HOLES, METRES, POINTS.astype(np.float32), POINTS, FLAT.astype(np.float32)]
)
def test_the_other_byte_order_is_recognised(values):
    assert not is_swapped(values)
    assert is_swapped(values.byteswap())


@pytest.mark.parametrize("value", [0, 1, 255, 256, 65535])
def test_images_of_one_number_are_as_they_say(value):
    assert not is_swapped(np.full((60, 80), value, np.uint16))


@given(
    hnp.arrays(np.float32, st.tuples(st.integers(0, 30), st.just(3)), elements=st.floats(width=32))
)
def test_few_points_are_as_they_say(points):
    assert not is_swapped(points)


def test_steps_of_depth_are_no_other_byte_order():
    """Boxes, one in each ten pixels: neighbours within a box differ by noise."""
    boxes = np.repeat(RNG.integers(500, 8000, (60, 8)), 10, axis=1)
    assert not is_swapped((boxes + RNG.integers(0, 5, boxes.shape)).astype(np.uint16))
