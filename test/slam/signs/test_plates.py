"""Size and attitude of plates on walls, and texts that are no door sign by them."""

import numpy as np
import pytest

from tccm_ros.slam.signs.plates import PlateOnWall, misplacement, plate_on_wall

POSITION, NORMAL = np.array([2.0, 3.0, 1.5]), np.array([0.0, -1.0, 0.0])
ORIGINS = np.array([[1.0, 1.5, 1.1], [2.0, 1.0, 1.1], [3.5, 2.0, 1.2]])


def rays(width, height, tilt=0.0):
    """Return the bearings of the corners of a plate on the wall y = 3, read from y < 3."""
    right, up = (
        np.array([np.cos(tilt), 0.0, np.sin(tilt)]),
        np.array([-np.sin(tilt), 0, np.cos(tilt)]),
    )
    sides = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * [0.5 * width, 0.5 * height]
    corners = POSITION + sides[:, :1] * right + sides[:, 1:] * up
    away = corners - ORIGINS[:, None]
    return away / np.linalg.norm(away, axis=2, keepdims=True)


@pytest.mark.parametrize("tilt", [0.0, 0.1, 0.5 * np.pi, np.pi])
def test_size_and_tilt_are_those_on_the_wall(tilt):
    plate = plate_on_wall(POSITION, NORMAL, ORIGINS, rays(0.2, 0.12, tilt))
    assert plate.size == pytest.approx([0.2, 0.12])
    assert plate.tilt == pytest.approx(tilt)


def test_view_along_the_wall_or_without_corners_gives_no_pose():
    corners = rays(0.2, 0.12)
    corners[0] = np.nan
    assert plate_on_wall(POSITION, NORMAL, ORIGINS, corners).size == pytest.approx([0.2, 0.12])
    along = np.broadcast_to([np.cos(0.1), np.sin(0.1), 0.0], (3, 4, 3))
    assert np.isnan(plate_on_wall(POSITION, NORMAL, ORIGINS, along).size).all()
    corners[:] = np.nan
    unknown = plate_on_wall(POSITION, NORMAL, ORIGINS, corners)
    assert np.isnan(unknown.tilt)
    assert misplacement(POSITION, unknown) == ""


@pytest.mark.parametrize(
    ("z", "width", "tilt", "reason"),
    [
        (1.5, 0.2, 0.0, ""),
        (0.85, 0.04, 0.1, ""),
        (2.35, 0.59, 0.0, ""),
        (0.4, 0.2, 0.0, "at a height of 0.40 m"),
        (2.6, 0.2, 0.0, "at a height of 2.60 m"),
        (1.5, 0.9, 0.0, "90 cm long"),
        (1.5, 0.01, 0.0, "1 cm long"),
        (1.5, 0.2, 1.57, "its lines are at 90 deg to the horizontal"),
    ],
)
def test_refused_plates_have_a_reason(z, width, tilt, reason):
    plate = PlateOnWall(np.array([width, 0.5 * width]), tilt)
    assert misplacement(np.array([2.0, 3.0, z]), plate) == reason
