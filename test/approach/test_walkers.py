"""Who walks near the base, in level scans of a base that drives."""

from dataclasses import replace

import numpy as np
import pytest
from approach_world import ROBOT, SimulatedBase, circle, piece, simple_flat
from shapely import Point, affinity

from tccm_ros.approach.speeds import Speeds
from tccm_ros.approach.walkers import Walkers
from tccm_ros.geometry import compose2, inverse2, transform2

WALKING_M_S = 1.6  # m/s, of a person towards the base: K of ISO 13855:2010

MOTIONS = [Speeds(), Speeds(0.25, 0.0), Speeds(-0.25, 0.1), Speeds(0.0, 0.6), Speeds(0.2, -0.4)]


def moving_points(flat, motion, ticks=60, walkers=None):
    """Return the moving points of each step, in the room, and the base."""
    base, walkers = SimulatedBase(flat, np.random.default_rng(1)), walkers or Walkers(ROBOT)
    steps = []
    for _ in range(ticks):
        walkers.add(base.readings())
        base.tick(motion)
        in_room = compose2(base.truth, inverse2(base.odom))
        steps.append((base.t, transform2(in_room, walkers.points)))
    return steps, base


def furnished(person=None):
    """Return a flat with legs of furniture that hide each other and the walls from the base."""
    flat = simple_flat()
    flat.others = [
        piece(affinity.translate(circle(0.25), x, y), 0.45)
        for x, y in [(-1.0, 1.0), (-0.9, -0.6), (-2.4, -0.9), (-2.5, 1.4)]
    ]
    flat.person = person
    return flat


@pytest.mark.parametrize("motion", MOTIONS)
def test_static_flat_has_no_moving_points(motion):
    steps, _ = moving_points(furnished(), motion)
    assert not sum(len(points) for _, points in steps)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("speed", [0.4, 1.0, 1.6])
def test_a_person_is_seen_while_the_base_drives(motion, speed):
    flat = furnished((np.array([-2.0, -2.5]), np.array([0.0, 1.0]), speed, 0.2, 1.0))
    steps, _ = moving_points(flat, motion, 50)
    assert not sum(len(points) for t, points in steps if t < 1.0)
    walking = [(t, points) for t, points in steps if t > 1.5]
    assert walking
    for t, points in walking:
        assert len(points)
        body = flat.person_at(t).centroid.buffer(0.3 + speed * 0.05)
        assert all(body.contains(Point(p)) for p in points)


def test_a_single_point_in_free_space_is_no_person():
    flat, walkers = furnished(), Walkers(ROBOT)
    moving_points(flat, Speeds(), 20, walkers)
    base = SimulatedBase(flat, np.random.default_rng(1))
    for _ in range(20):
        base.tick(Speeds())
    readings = base.readings()
    stray = np.concatenate([readings.scan, [[0.5, 0.0]]])
    walkers.add(replace(readings, scan=stray, scan_s=readings.scan_s + 0.05))
    assert not len(walkers.points)
    stray = np.concatenate([readings.scan, [[0.5, 0.0], [0.5, 0.05]]])
    walkers.add(replace(readings, scan=stray, scan_s=readings.scan_s + 0.1))
    assert len(walkers.points) == 2


@pytest.mark.parametrize("wanted", [Speeds(0.25, 0.0), Speeds(0.1, -0.3), Speeds(0.0, 0.6)])
def test_base_rests_before_an_approaching_person_is_within_the_margin(wanted):
    limits = ROBOT.limits
    for distance in np.arange(0.0, 3.0, 0.05):
        walkers = Walkers(ROBOT)
        walkers.points = np.array([[0.25 + distance, 0.0]])
        speeds, person = walkers.limit(wanted, np.zeros(3))
        braking_s = max(
            abs(speeds.forward) / limits.acceleration,
            abs(speeds.yaw_rate) / limits.yaw_acceleration,
        )
        until_s = (distance - ROBOT.margin) / WALKING_M_S
        assert (speeds == Speeds()) == (person is not None)
        if speeds != Speeds():
            assert ROBOT.latency_s + 0.3 + braking_s <= until_s + 1e-9
            assert speeds.forward * wanted.yaw_rate == pytest.approx(
                wanted.forward * speeds.yaw_rate
            )
    assert speeds == wanted
