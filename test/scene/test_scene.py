"""Poses of surfaces: the smallest rectangle around them, on their plane."""

from types import SimpleNamespace

import numpy as np
import pytest

from tccm_ros.scene.scene import object_pose, surface_pose


@pytest.mark.parametrize("slope", [0.0, 0.1])
@pytest.mark.parametrize("yaw", [-0.7, 0.0, 0.4])
def test_a_surface_stands_on_its_plane_with_x_along_its_longer_side(slope, yaw):
    normal = np.array([-slope, 0.5 * slope, 1.0]) / np.sqrt(1.0 + 1.25 * slope**2)
    middle, offset = np.array([1.2, -0.4]), 0.7
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = middle + np.array([[-0.8, -0.3], [0.8, -0.3], [0.8, 0.3], [-0.8, 0.3]]) @ R.T
    z = (offset - corners @ normal[:2]) / normal[2]
    surface = SimpleNamespace(boundary=np.column_stack([corners, z]), normal=normal, offset=offset)
    T, size = surface_pose(surface)
    assert size == pytest.approx([1.6, 0.6])
    assert T[:3, :3].T @ T[:3, :3] == pytest.approx(np.eye(3))
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert T[:3, 2] == pytest.approx(normal)
    assert T[:2, 3] == pytest.approx(middle)
    assert normal @ T[:3, 3] == pytest.approx(offset)
    # x lies on the plane, above the direction of the longer side.
    assert np.sin(np.arctan2(T[1, 0], T[0, 0]) - yaw) == pytest.approx(0.0, abs=slope**2 + 1e-9)


def test_an_object_stands_at_its_centre_turned_by_its_yaw():
    T = object_pose(SimpleNamespace(center=np.array([1.0, 2.0, 0.8]), yaw=0.3))
    assert T[:3, 3] == pytest.approx([1.0, 2.0, 0.8])
    assert T[:3, 0] == pytest.approx([np.cos(0.3), np.sin(0.3), 0.0])
    assert T[:3, 2] == pytest.approx([0.0, 0.0, 1.0])
