"""Delay of a tilting laser's joint, found while the nodes run."""

import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest
from live_robot import CYCLE_SCANS, STEP_NS, URDF, recording, tccm

from tccm_ros.config import Config
from tccm_ros.nodes.intake.joint_timing_watch import JointTimingWatch
from tccm_ros.records import JointSample, MapReset, RobotDescription
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams

MAX_PAIRS = 4  # pairs of tilt cycles that an estimate uses

CYCLES = MAX_PAIRS + 4
"""Enough tilt cycles for an estimate: the first one is partial."""

SAID = r"rig.joint_time_offset=-0.30 makes tilting up and down agree"


def delayed(late_s: float, cycles: float = CYCLES) -> Iterator[tuple[str, object]]:
    """Yield a recording whose joint samples have late stamps, in the order of their stamps."""
    late_ns = round(late_s * 1e9)
    records = [
        (t, replace(r, stamp_ns=r.stamp_ns + late_ns) if isinstance(r, JointSample) else r)
        for t, r in recording(cycles)
        if t != "scan"
    ]
    yield from sorted(records, key=lambda pair: pair[1].stamp_ns)


def make_watch() -> tuple[JointTimingWatch, list[str]]:
    """Return a watch, and the list to which its reports are appended."""
    said: list[str] = []
    return JointTimingWatch(Config(), "tilt_scan", said.append), said


def feed(watch: JointTimingWatch, records) -> None:
    robot = Robot(Config(), default_streams(), expects_odometry=True)
    robot.add("robot_description", RobotDescription(URDF.format(p="", kind="revolute")))
    for topic, record in records:
        for event in robot.add(topic, record):
            watch.add(event)


def wait_for(watch: JointTimingWatch) -> None:
    for thread in threading.enumerate():
        if thread.name == "joint timing":
            thread.join()
    assert watch.is_done


def test_a_delay_is_in_the_diagnostics_of_the_node(ros):
    node, robot = tccm(ros), ros.robot()
    robot.play(delayed(0.3), node)
    ros.spin_until(lambda: any(SAID in line for line in node.all_problems()), what="the delay")
    assert sum(SAID in line for line in node.all_problems()) == 1


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_a_delay_is_reported_once_with_its_size(late_s):
    watch, said = make_watch()
    feed(watch, delayed(late_s))
    wait_for(watch)
    assert list(watch.problems) == said
    assert len(said) == bool(late_s)
    assert all(SAID in line for line in said)


def test_a_clock_that_jumps_begins_the_collection_anew():
    watch, said = make_watch()
    feed(watch, delayed(0.3, MAX_PAIRS))
    watch.add(MapReset("the clock went back"))
    feed(watch, delayed(0.3, MAX_PAIRS))
    assert not watch.is_done
    watch.add(MapReset("the clock went back"))
    feed(watch, delayed(0.3))
    wait_for(watch)
    assert len(said) == 1


def test_a_joint_that_rests_fills_no_memory():
    """The scans of the last 30 s are kept at most."""
    cycles = 2.0 * 30.0 / (CYCLE_SCANS * STEP_NS * 1e-9)
    resting = (
        (t, replace(r, positions=0.0 * r.positions) if isinstance(r, JointSample) else r)
        for t, r in recording(cycles)
        if t != "scan"
    )
    watch, said = make_watch()
    feed(watch, resting)
    assert not watch.is_done
    assert len(watch._timer._scans) * STEP_NS <= 30e9 + STEP_NS
    assert not said
