"""Edges of a compartment for pictures."""

import numpy as np
import pytest
from shapely import Polygon

from tccm_ros.racks.outline import ARROW, box_edges

FRONT = np.array([[1.0, 2.0, 0.5], [1.0, 1.2, 0.5]])
INWARD = np.array([1.0, 0.0, 0.0])


def test_the_edges_are_those_of_the_box_and_an_arrow_that_ends_at_its_front():
    edges = box_edges(FRONT, INWARD, 0.3, 0.4)
    box, arrow = edges[:12], edges[12:]
    lengths = np.sort(np.linalg.norm(box[:, 1] - box[:, 0], axis=1))
    np.testing.assert_allclose(lengths, [0.3] * 4 + [0.4] * 4 + [0.8] * 4)
    assert len(np.unique(box.reshape(-1, 3).round(9), axis=0)) == 8
    assert Polygon(box[:4, 0, :2]).area == pytest.approx(0.24)
    np.testing.assert_allclose(arrow[:, 1], np.tile([1.0, 1.6, 0.5], (3, 1)))
    np.testing.assert_allclose(arrow[0, 0], [1.0 - ARROW, 1.6, 0.5])
    assert (arrow[:, 0, 0] < 1.0).all()
