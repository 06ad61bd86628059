"""Edges of a compartment for pictures."""

import numpy as np
import pytest
from shapely import Polygon

from tccm_ros.geometry import spatial
from tccm_ros.racks.compartment import OpenPart
from tccm_ros.racks.outline import box_edges, part_edges

ARROW = 0.16  # m, length of the arrow into a compartment

FRONT = np.array([[1.0, 2.0, 0.5], [1.0, 1.2, 0.5]])
INWARD = np.array([1.0, 0.0, 0.0])


def test_outline_is_the_edges_of_the_box_and_an_arrow_to_its_front():
    edges = box_edges(FRONT, INWARD, 0.3, 0.4)
    box, arrow = edges[:12], edges[12:]
    lengths = np.sort(np.linalg.norm(box[:, 1] - box[:, 0], axis=1))
    np.testing.assert_allclose(lengths, [0.3] * 4 + [0.4] * 4 + [0.8] * 4)
    assert len(np.unique(box.reshape(-1, 3).round(9), axis=0)) == 8
    assert Polygon(box[:4, 0, :2]).area == pytest.approx(0.24)
    np.testing.assert_allclose(arrow[:, 1], np.tile([1.0, 1.6, 0.5], (3, 1)))
    np.testing.assert_allclose(arrow[0, 0], [1.0 - ARROW, 1.6, 0.5])
    assert (arrow[:, 0, 0] < 1.0).all()


def test_an_open_part_has_the_twelve_edges_of_its_box():
    door = OpenPart(spatial(np.array([1.0, 2.0, 0.5 * np.pi])), np.array([0.4, 0.02, 0.3]))
    edges = part_edges([door])
    lengths = np.sort(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1))
    np.testing.assert_allclose(lengths, [0.02] * 4 + [0.3] * 4 + [0.4] * 4)
    corners = edges.reshape(-1, 3)
    np.testing.assert_allclose(corners.min(axis=0), [0.99, 1.8, -0.15])
    np.testing.assert_allclose(corners.max(axis=0), [1.01, 2.2, 0.15])
    assert len(np.unique(corners.round(9), axis=0)) == 8
    assert part_edges([]).shape == (0, 2, 3)
