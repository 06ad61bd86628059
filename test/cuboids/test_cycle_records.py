"""Lines of sight of images and clouds: cut at a range, in the frame that is asked for."""

from types import SimpleNamespace

import numpy as np
import pytest

from tccm_ros.cuboids.cycle_records import CyclePoints
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.sensors.measured import MeasuredPoints

ORIGIN = np.array([1.0, 2.0, 0.5])
DIRECTION = np.array([0.6, 0.0, -0.8])


def lines_of(lengths, hits):
    """Return a record whose lines of sight have some lengths, all in one direction."""
    origins = np.tile(ORIGIN, (len(lengths), 1))
    ends = origins + np.outer(lengths, DIRECTION)
    measured = MeasuredPoints(np.zeros((0, 3)), None, origins, ends, np.array(hits), 0.01)
    return CyclePoints(SimpleNamespace(stamp_ns=7), measured)


def test_longer_lines_end_at_the_max_length_without_a_hit():
    record = lines_of([1.0, 3.0, 5.0, 5.0], [True, True, True, False])
    origins, ends, hits = record.rays(3.0)
    assert origins == pytest.approx(np.tile(ORIGIN, (4, 1)))
    assert ends == pytest.approx(ORIGIN + np.outer([1.0, 3.0, 3.0, 3.0], DIRECTION))
    assert hits.tolist() == [True, True, False, False]


def test_lines_are_given_in_the_frame_that_is_asked_for():
    T = pose_from_rpy(np.array([0.3, -0.2, 0.1, 0.02, -0.03, 1.0]))
    record = lines_of([1.0, 5.0], [True, True])
    origins, ends, _ = record.rays(3.0, T_frame_odom=T)
    assert origins == pytest.approx(np.tile(T[:3, :3] @ ORIGIN + T[:3, 3], (2, 1)))
    expected = (ORIGIN + np.outer([1.0, 3.0], DIRECTION)) @ T[:3, :3].T + T[:3, 3]
    assert ends == pytest.approx(expected)
