"""A lift: what the robot sees through its door is another floor, though its wheels stood still."""

from dataclasses import replace

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import between2, planar
from tccm_ros.records import PosedScan
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.tracking import LocalisationState, Tracker
from tccm_ros.slam.wall_slam import WallSlam
from tccm_sim.engine import EPOCH_NS, Simulation
from tccm_sim.options import Options
from tccm_sim.worlds import build_world


class Ride:
    """The posed level scans of a ride, their times (N,) in s, true poses (N, 3) and the stop."""

    def __init__(self, *, other_floor, seed=3):
        options = Options(tilt=False, self_hits=False)
        world = build_world("lift", options)
        self.start_s, self.end_s = world.drive.stops[1].tolist()
        if not other_floor:
            # The cabin stays where it was: its door closes and opens on the same corridor.
            middle, solids = 0.5 * (self.start_s + self.end_s), world.scene.solids
            always, before = (-np.inf, np.inf), (-np.inf, middle)
            kept = [s for s in solids if s.span != (middle, np.inf)]
            solids[:] = [replace(s, span=always) if s.span == before else s for s in kept]
        simulation = Simulation(world, seed, options)
        robot = Robot(Config(), default_streams(), expects_odometry=True)
        roles = {topic: role for role, topic in vars(simulation.rig.topics).items()}
        self.scans = [
            event
            for message in simulation.run()
            for record in message.records
            for event in robot.add(roles.get(message.topic, message.topic[1:]), record)
            if isinstance(event, PosedScan) and event.role == "scan"
        ]
        self.times = (np.array([s.stamp_ns for s in self.scans]) - EPOCH_NS) * 1e-9
        true = np.array([planar(T) for T in simulation.true_poses(self.times)])
        self.truth = between2(true[0], true)


@pytest.fixture(scope="module")
def ride():
    return Ride(other_floor=True)


@pytest.fixture(scope="module")
def mapped(ride):
    """Return the processor after the ride, and when it first said that the robot was lost."""
    slam, lost_s = WallSlam(Config()), None
    for t, scan in zip(ride.times, ride.scans):
        slam.add_scan(scan)
        if slam.is_lost and lost_s is None:
            lost_s = t
    return slam, lost_s


def test_another_floor_is_noticed_within_three_seconds_of_the_door(ride, mapped):
    # The door opens half a second before the robot drives out.
    assert ride.end_s - 0.5 < mapped[1] < ride.end_s + 2.5


def test_the_second_floor_is_mapped_beside_the_first_and_not_over_it(ride, mapped):
    solution = mapped[0].solve()
    assert mapped[0].is_unjoined, "the second floor has a place in the map of the first"
    first = ride.times < ride.end_s - 0.5
    count = int(first.sum())
    error = between2(ride.truth[:count], solution.poses[:count])
    assert np.hypot(*error.T[:2]).max() < 0.02
    assert np.abs(error[:, 2]).max() < np.radians(0.6)
    # Of the second floor alone: the wall across the first floor's corridor, 4.5 m before the cabin.
    cabin = ride.truth[count - 1]
    beside = 0
    for wall in solution.walls:
        middle = wall.endpoints.mean(axis=0) - cabin[:2]
        is_across = abs(np.sin(wall.phi)) < 0.1
        assert not (is_across and -4.8 < middle[0] < -4.0), wall
        beside += middle[0] > 30.0
    assert beside >= 3


def test_the_second_floor_is_tracked_as_the_robot_drives(ride):
    front, poses, sessions = FrontEnd(Config()), [], []
    for scan in ride.scans:
        front.add(make_level_scan(scan, Config()))
        poses.append(front.pose)
        sessions.append(front.session)
    begin = int(np.flatnonzero(np.array(sessions) == 1)[0])
    assert max(sessions) == 1
    moved = between2(poses[begin], np.array(poses[begin:]))
    error = between2(between2(ride.truth[begin], ride.truth[begin:]), moved)
    assert np.hypot(*error.T[:2]).max() < 0.03


def test_localisation_says_lost_and_then_that_it_searches(ride):
    tracker, states = Tracker(Config()), []
    for scan in ride.scans:
        tracker.add(scan)
        states.append(tracker.state)
    before = ride.times < ride.end_s - 0.5
    assert {s for s, early in zip(states, before) if early} == {LocalisationState.TRACKING}
    later = [s for s, early in zip(states, before) if not early]
    assert LocalisationState.LOST in later
    assert later[-1] == LocalisationState.SEARCHING


def test_a_door_that_opens_on_the_same_corridor_is_no_other_floor():
    ride = Ride(other_floor=False)
    slam = WallSlam(Config())
    for scan in ride.scans:
        slam.add_scan(scan)
        assert not slam.is_lost
    error = between2(ride.truth, slam.solve().poses)
    assert np.hypot(*error.T[:2]).max() < 0.03
