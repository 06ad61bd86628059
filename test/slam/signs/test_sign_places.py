"""Ten identical offices on a corridor: signs tell where the robot is, where walls cannot."""

from dataclasses import replace

import buildings
import numpy as np
import plan
import pytest
from sign_plates import Pictures, Plate

from tccm_ros.config import Config
from tccm_ros.slam.wall_slam import WallSlam

OFFICES = buildings.offices(5, alike=True)
ROBOT = buildings.ROBOTS["good"]
PLATES = [
    Plate(f"{101 + 2 * k + (side < 0)}", (4.0 * k + 1.1, side * 1.08, 1.5), -side * np.pi / 2)
    for k in range(5)
    for side in (1, -1)
]
"""Beside each door, in the corridor."""

DRIVES = {
    "in the corridor, to the east": [(6.5, 0.2), (12.5, 0.2)],
    "in the corridor, to the west": [(14.5, -0.2), (7.0, -0.2)],
    "in room 105": [(9.95, 3.6), (9.95, 0.0), (15.0, 0.0)],
    "in room 108": [(13.95, -3.6), (13.95, 0.0), (7.0, 0.0)],
    "in room 103": [(5.95, 3.6), (5.95, 0.0), (1.2, 0.0)],
}
NEAR = 0.1
"""Distance from the truth (m) of a robot that has found its place: an office is 4 m wide."""


def drive(slam, path, plates, *, seed, start_ns=2 * 10**18, **options):
    """Drive a path; return the estimated and the true pose of the base at its end in the map."""
    building = buildings.Building(OFFICES.walls, OFFICES.glass, path)
    run = buildings.drive(building, ROBOT, seed=seed, start_ns=start_ns)
    poses = plan.route(path, step=ROBOT.step, yaw_step=ROBOT.yaw_step)
    measurements = Pictures(plates, OFFICES.walls, **options).along(poses, run.stamps_ns, seed=seed)
    for scan in run.scans:
        while measurements and measurements[0].stamp_ns <= scan.scan.stamp_ns:
            slam.add_sign(measurements.pop(0))
        found = slam.add_scan(scan)
    first = plan.matrix((*OFFICES.route[0], 0.0))
    return found.pose, plan.planar(np.linalg.inv(first) @ plan.matrix(poses[-1]))


@pytest.fixture(scope="module")
def saved():
    slam = WallSlam(Config())
    drive(slam, OFFICES.route, PLATES, seed=1, start_ns=10**18)
    solution = slam.solve()
    assert sorted(s.number for s in solution.signs) == sorted(p.number for p in PLATES)
    return slam.saved(solution)


def located(saved, path, plates, **options):
    """Return whether a robot finds its place in the saved map, and how far off it is, m."""
    slam = WallSlam.from_saved(Config(), saved)
    pose, truth = drive(slam, path, plates, **options)
    return slam.is_located, float(np.hypot(*(pose - truth)[:2]))


@pytest.mark.parametrize("where", DRIVES)
def test_robot_is_localised_by_signs_and_never_wrongly_without(saved, where):
    found, away = located(saved, DRIVES[where], PLATES, seed=7)
    assert found
    assert away < NEAR
    found, away = located(saved, DRIVES[where], [], seed=7)
    assert not found or away < NEAR, "only where the end of the corridor tells"


def test_sign_that_localised_the_robot_is_reported(saved):
    """By its id in the saved map."""
    slam = WallSlam.from_saved(Config(), saved)
    assert slam.placed_by_sign == -1
    drive(slam, [(14.5, -0.2), (7.0, -0.2)], PLATES, seed=7)
    sign = next(s for s in slam.solve().signs if s.id == slam.placed_by_sign)
    assert 7.0 < sign.position[0] + OFFICES.route[0][0] < 14.5  # on its way


def test_a_plate_that_was_never_seen_places_nobody(saved):
    others = [replace(plate, number=f"9{plate.number}") for plate in PLATES]
    assert not located(saved, DRIVES["in the corridor, to the east"], others, seed=7)[0]


def test_a_text_at_two_places_places_nobody_until_another_is_read():
    """Two doors have the number 103. Which of them it is, the next door tells."""
    twins = [replace(p, number="103", looks="103") if p.number == "107" else p for p in PLATES]
    slam = WallSlam(Config())
    drive(slam, OFFICES.route, twins, seed=1, start_ns=10**18)
    state = slam.saved()
    only = [plate for plate in twins if plate.number == "103"]
    path = DRIVES["in the corridor, to the east"]
    assert not located(state, path, only, seed=7)[0]
    found, away = located(state, path, twins, seed=7)
    assert found
    assert away < NEAR


def test_a_text_that_is_doubtful_places_nobody(saved):
    """Half of the views of each plate read another number."""

    def misread(text, random):
        return text if random.random() < 0.5 else f"{random.integers(200, 999)}"

    plates = [plate for plate in PLATES if plate.number == "105"]
    path = [(9.5, 0.2), (7.4, 0.2)]
    found, away = located(saved, path, plates, seed=7, misread=misread)
    assert not found or away < NEAR


def test_a_text_does_not_place_a_robot_where_the_walls_are_others(saved):
    """The plate 105 hangs in another building: matching refuses what the text proposes."""
    walls, plates = plan.ring(), [Plate("105", (4.0, -0.98, 1.5), np.pi / 2)]
    slam, route = WallSlam.from_saved(Config(), saved), plan.route([(0, 0), (12, 0), (12, 5)])
    run = plan.drive(walls, route, seed=3, start_ns=2 * 10**18)
    measurements = Pictures(plates, walls).along(route, run.stamps_ns, seed=3, period=0.2)
    assert len(measurements) >= 3
    for sign in measurements:
        slam.add_sign(sign)
    for scan in run.scans:
        slam.add_scan(scan)
    assert not slam.is_located
