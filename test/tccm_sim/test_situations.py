"""Situations A to D against what TARGETS' numbers say of them, computed by hand."""

import numpy as np
import pytest
from situation_cycle import FLOOR, OTHER, SUBJECT, WALL, cycle

from tccm_sim.situations import SITUATIONS


def subject(c):
    return c.points[c.labels == SUBJECT]


@pytest.mark.parametrize("name", SITUATIONS)
def test_points_are_on_the_planes_of_their_labels(name):
    c = cycle(name, 0.0)
    assert np.abs(subject(c) @ c.normal - c.offset).max() < 1e-9
    assert np.abs(c.points[c.labels == FLOOR][:, 2]).max() < 1e-9
    assert np.abs(c.points[c.labels == WALL][:, 0] - 2.6).max() < 1e-9
    assert np.bincount(c.labels, minlength=4)[SUBJECT] > 1500


def test_planes_of_the_situations_are_at_their_stated_positions():
    yaw = np.radians(20.0)
    facing = (-np.cos(yaw), -np.sin(yaw), 0.0)
    for name, normal, offset in (
        ("a", (0, 0, 1), 0.700),
        ("b", (-1, 0, 0), -0.600),
        ("c", (0, 0, 1), 0.700),
        ("d", facing, -0.6 * np.cos(yaw)),  # the front rotates about its own centre
    ):
        c = cycle(name, 0.0)
        assert c.normal == pytest.approx(normal)
        assert c.offset == pytest.approx(offset)


def test_table_and_shelf_have_their_stated_extents():
    table, shelf = subject(cycle("a", 0.0)), subject(cycle("b", 0.0))
    step = 0.03
    assert table[:, 0].min() == pytest.approx(0.5, abs=step)
    assert table[:, 0].max() == pytest.approx(1.3, abs=step)
    assert np.abs(table[:, 1]).max() == pytest.approx(0.6, abs=step)
    assert np.abs(shelf[:, 1]).max() == pytest.approx(0.45, abs=step)
    assert shelf[:, 2].max() == pytest.approx(1.2, abs=step)


def test_points_follow_from_ranges_tilts_and_bearings():
    """The closed form, beam by beam: p = (r cos b cos t, r sin b, h - r cos b sin t)."""
    c = cycle("c", 0.0025, seed=5)
    hit = np.isfinite(c.ranges)
    r, t = c.ranges[hit], c.tilts[hit]
    b = np.broadcast_to(c.bearings, c.ranges.shape)[hit]
    points = np.stack(
        [r * np.cos(b) * np.cos(t), r * np.sin(b), 1.52 - r * np.cos(b) * np.sin(t)], -1
    )
    assert c.points == pytest.approx(points)
    assert c.ranges.shape == (40, 569)


def test_the_tilt_changes_within_a_scan():
    c = cycle("a", 0.0)
    assert c.tilts[0, 0] == pytest.approx(np.radians(5.0))
    assert np.degrees(c.tilts[0, -1] - c.tilts[0, 0]) == pytest.approx(60 * 0.028 / 1.575 * 2 / 3)
    upwards = cycle("a", 0.0, downwards=False)
    assert upwards.tilts[0, 0] == pytest.approx(np.radians(65.0))


def test_noise_is_along_the_beam():
    exact, noisy = cycle("a", 0.0), cycle("a", 0.005, seed=2)
    hit = np.isfinite(exact.ranges)
    error = noisy.ranges[hit] - exact.ranges[hit]
    assert error.std() == pytest.approx(0.005, rel=0.03)
    assert np.array_equal(exact.labels, noisy.labels)
    again = cycle("a", 0.005, seed=2)
    assert again.ranges.tobytes() == noisy.ranges.tobytes()


@pytest.mark.parametrize("pitch", np.radians([20.0, 50.0, 80.0]))
def test_subject_can_be_tilted_and_moved(pitch):
    c = cycle("a", 0.0, yaw=0.3, pitch=pitch, translation=(0.1, 0.05, 0.02))
    assert c.normal[2] == pytest.approx(np.cos(pitch))
    assert c.normal[0] < 0.0  # it faces the robot
    pivot = np.array([0.9 + 0.1, 0.05, 0.72])
    assert c.offset == pytest.approx(c.normal @ pivot)
    assert np.abs(subject(c) @ c.normal - c.offset).max() < 1e-9
    assert len(subject(c)) > 100


def test_in_a_room_every_beam_has_a_return():
    assert len(cycle("a", 0.0, room=True).points) == 22_760


def test_the_arm_moves_and_the_drawer_is_out():
    first, later = cycle("c", 0.0, start=0.0), cycle("c", 0.0, start=0.8)
    assert not np.array_equal(first.labels, later.labels)
    d = cycle("d", 0.0)
    before = d.points[d.labels == OTHER] @ d.normal - d.offset
    # The knobs stand out 3 cm, the drawer 25 cm.
    assert before.max() == pytest.approx(0.25, abs=0.01)
    assert np.any((before > 0.02) & (before < 0.031))


def test_an_unknown_situation_is_an_error():
    with pytest.raises(ValueError, match="no situation 'e'"):
        cycle("e")
