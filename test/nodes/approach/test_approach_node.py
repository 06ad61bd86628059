"""approach_node over DDS, with a simulated base and the map of a flat."""

import math
import threading
import time

import numpy as np
import pytest
from approach_driver import ABORTED, CANCELED, SUCCEEDED
from approach_robot import WAIT_S
from approach_world import circle, l_shape, simple_flat
from geometry_msgs.msg import PointStamped
from live_robot import Listener

from tccm_ros.approach.approach import Approach
from tccm_ros.approach.outcome import Reason
from tccm_ros.nodes.interfaces import has_interfaces

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")


@pytest.mark.parametrize(
    ("top", "move"),
    [
        (None, (0.3, -0.2, 0.5)),
        (circle(0.5), (0.2, 0.3, 0.0)),
        (l_shape(1.6, 1.4, 0.6), (0.1, -0.2, -0.4)),
    ],
    ids=["straight", "round", "L"],
)
def test_a_table_that_was_moved_is_approached(drive, top, move):
    driver = drive(simple_flat(top, move))
    status, result = driver.ask()
    assert (status, result.success, result.reason) == (SUCCEEDED, True, 0), result.message
    assert result.surface_id == 1
    assert result.has_moved
    gap, yaw = driver.robot.base.true_figures()
    assert gap == pytest.approx(0.05, abs=0.02)
    assert abs(math.degrees(yaw)) < 1.5
    assert result.gap == pytest.approx(gap, abs=0.01)
    assert driver.robot.base.contacts == 0
    assert set(driver.phases) == {0, 1, 2, 3}
    assert driver.stands()


def test_a_named_spot_is_found_and_approached_though_its_table_was_moved(ros, drive, tmp_path):
    from tccm_interfaces.msg import SurfaceFilter

    from tccm_ros.client import RequestError, SurfaceMapClient

    file = tmp_path / "map" / "named_poses.yaml"
    driver = drive(simple_flat(None, (0.3, -0.2, 0.5)), approach__names=str(file))
    client = SurfaceMapClient(Listener(ros, "namer").node)
    ros.spin_until(lambda: client.can_approach and client.surfaces, what="the client")

    def answer(asked):
        driver.robot.drive_until(asked.done, 200.0)
        return asked.result()

    with pytest.raises(RequestError, match="no spot is called 'home/table'"):
        answer(client.resolve_name("home/table"))
    with pytest.raises(RequestError, match="'home table' is no name"):
        answer(client.set_name("home table", SurfaceFilter(ids=[1])))
    [table] = (s for s in client.surfaces if s.id == 1)
    # 10 cm beside the middle of the table, in its own frame.
    spot = table.T_map_surface[:3, :3] @ [0.0, 0.1, 0.0] + table.T_map_surface[:3, 3]
    assert answer(client.set_name("home/table", SurfaceFilter(ids=[1]), spot=spot)) == "a new name"
    assert "ids: [1]" in file.read_text()
    found = answer(client.resolve_name("home/table"))
    assert found.surface.id == 1
    np.testing.assert_allclose(found.position, spot, atol=1e-3)
    assert len(found.T_map_bases)
    for T in found.T_map_bases:
        assert np.linalg.norm(T[:2, 3] - spot[:2]) <= 0.9 + 1e-6
    there = answer(client.approach(name="home/table"))
    assert there.surface_id == 1
    assert there.has_moved
    assert there.distance <= 0.9 + 0.01
    assert driver.robot.base.contacts == 0
    assert "it was" in answer(client.forget_name("home/table"))
    with pytest.raises(RequestError, match="no spot is called"):
        answer(client.approach(name="home/table"))
    client.close()


def test_inputs_during_a_long_plan_are_read_before_they_count_as_lost(drive, monkeypatch):
    driver = drive(simple_flat())
    plan = Approach._plan

    def long_plan(self, readings):
        speeds, until = plan(self, readings), driver.robot.base.t + 1.0
        end_s = time.monotonic() + 60.0
        driver.robot.wait_s = 0.0  # no command comes now
        while driver.robot.base.t < until and time.monotonic() < end_s:
            time.sleep(0.001)
        driver.robot.wait_s = WAIT_S
        return speeds

    monkeypatch.setattr(Approach, "_plan", long_plan)
    status, result = driver.ask()
    assert (status, result.reason) == (SUCCEEDED, 0), result.message
    assert driver.robot.base.contacts == 0


def test_a_step_that_fails_stops_the_base_as_the_end_of_a_goal_does(drive, monkeypatch):
    """A best-effort subscriber may lose one zero command."""
    driver = drive(simple_flat())
    step = Approach.step

    def fail_on_the_way(self, readings):
        if driver.robot.base.speed > 0.1:
            raise ValueError("no such row")
        return step(self, readings)

    monkeypatch.setattr(Approach, "step", fail_on_the_way)
    status, result = driver.ask()
    assert (status, result.reason) == (ABORTED, Reason.BLOCKED)
    assert result.message == "stopped, as a step failed: no such row"
    assert driver.stands()
    assert driver.robot.commands[-2:] == [(0.0, 0.0), (0.0, 0.0)]


def test_bad_goals_are_answered_with_sentences_and_nothing_moves(drive):
    driver = drive(simple_flat())
    for fields, reason, words in (
        ({"ids": (77,)}, Reason.NO_SURFACE, "no surface of the map meets the conditions"),
        ({"gap": math.nan}, Reason.BAD_GOAL, "gap is nan m; expected 0.02 to 1 m"),
        ({"gap": 5.0}, Reason.BAD_GOAL, "gap is 5 m"),
        ({"reach": -1.0}, Reason.BAD_GOAL, "reach is -1 m"),
        ({"footprint": [0.1, 0.1]}, Reason.BAD_GOAL, "footprint has 2 numbers"),
        ({"footprint": [1.0, 1.0, 2.0, 1.0, 2.0, 2.0]}, Reason.BAD_GOAL, "base's origin"),
        ({"has_side": True, "side": math.inf}, Reason.BAD_GOAL, "side is inf"),
    ):
        status, result = driver.ask(**fields)
        assert (status, result.reason) == (ABORTED, reason), result.message
        assert words in result.message
    status, result = driver.ask(1, distance=9.0)
    assert (status, result.reason) == (ABORTED, Reason.BAD_GOAL)
    assert not driver.robot.commands
    spot = PointStamped()  # the middle of the table, 0.65 m from the base before any of its edges
    spot.header.frame_id = "map"
    status, result = driver.ask(spot=spot, reach=0.4)
    assert (status, result.reason) == (ABORTED, Reason.NO_PLACE)
    assert "from which the spot is within 0.4 m" in result.message
    assert all(speeds == (0.0, 0.0) for speeds in driver.robot.commands)


def test_odometry_on_tf_alone_is_driven_by_and_its_silence_stops(drive):
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed")
    driver = drive(simple_flat(None, (0.3, -0.2, 0.5)), is_on_tf=True)
    status, result = driver.ask()
    assert (status, result.reason) == (SUCCEEDED, 0), result.message
    gap, yaw = driver.robot.base.true_figures()
    assert gap == pytest.approx(0.05, abs=0.02)
    assert abs(math.degrees(yaw)) < 1.5
    goal = driver.send(1, distance=0.5)
    driver.robot.drive_until(lambda: driver.robot.base.speed > 0.1)
    driver.robot.base.mute.add("odom")
    status, result = driver.result(goal, 5.0)
    assert (status, result.reason) == (ABORTED, Reason.LOST_POSE), result.message
    assert driver.stands()
    assert driver.robot.base.contacts == 0


@pytest.mark.every_distro
def test_second_goal_is_refused_and_cancelling_stops_within_100_ms(drive):
    driver = drive(simple_flat())
    goal = driver.send()
    driver.robot.drive_until(lambda: driver.robot.base.speed > 0.1)
    assert driver.ask()[1].reason == Reason.BUSY
    cancelled = goal.cancel_goal_async()
    driver.ros.spin_until(cancelled.done)
    count = len(driver.robot.commands)
    status, result = driver.result(goal)
    assert (status, result.reason) == (CANCELED, Reason.CANCELLED)
    # Two steps of 0.05 s, whatever was on its way.
    assert all(speeds == (0.0, 0.0) for speeds in driver.robot.commands[count + 2 :])
    assert driver.stands()


def test_cancelling_stops_the_base_while_a_step_computes(drive, monkeypatch):
    driver = drive(simple_flat())
    goal = driver.send()
    driver.robot.drive_until(lambda: driver.robot.base.speed > 0.1)
    is_computing, may_end = threading.Event(), threading.Event()
    step = Approach.step

    def slow(machine, readings):
        command = step(machine, readings)
        is_computing.set()
        assert may_end.wait(60.0)
        return command

    monkeypatch.setattr(Approach, "step", slow)
    while not is_computing.is_set():
        driver.robot.step()
    cancelled = goal.cancel_goal_async()
    driver.ros.spin_until(lambda: driver.robot.commands[-1] == (0.0, 0.0), what="zero")
    assert not may_end.is_set()
    count = len(driver.robot.commands)
    monkeypatch.setattr(Approach, "step", step)
    may_end.set()
    driver.ros.spin_until(cancelled.done)
    assert driver.result(goal)[0] == CANCELED
    assert set(driver.robot.commands[count:]) <= {(0.0, 0.0)}
    assert driver.stands()


@pytest.mark.parametrize(
    ("lose", "reason"),
    [
        (lambda r: r.base.mute.add("odom"), Reason.LOST_POSE),
        (lambda r: r.base.mute.add("scan"), Reason.LOST_SCANS),
        (lambda r: setattr(r, "is_localised", False), Reason.LOST_POSE),
    ],
    ids=["odometry", "scans", "localisation"],
)
def test_input_lost_on_the_way_stops_the_base(drive, lose, reason):
    driver = drive(simple_flat())
    goal = driver.send()
    driver.robot.drive_until(lambda: driver.robot.base.speed > 0.1)
    lose(driver.robot)
    status, result = driver.result(goal, 5.0)
    assert (status, result.reason) == (ABORTED, reason), result.message
    assert driver.stands()
    assert driver.robot.base.contacts == 0


@pytest.mark.every_distro
def test_the_base_backs_off(drive):
    driver = drive(simple_flat())
    before = driver.robot.base.truth.copy()
    status, result = driver.ask(1, distance=0.3)
    assert (status, result.success) == (SUCCEEDED, True), result.message
    assert result.distance == pytest.approx(0.3, abs=0.01)
    way = np.hypot(*(driver.robot.base.truth - before)[:2])
    assert way == pytest.approx(0.3, abs=0.02)
    assert driver.stands()


def test_a_python_program_drives_backs_off_and_cancels(drive):
    from tccm_interfaces.msg import SurfaceFilter

    from tccm_ros.client import RequestError, SurfaceMapClient

    driver = drive(simple_flat(None, (0.0, 0.0, 0.0), (-1.2, 0.0, 0.0)))
    client = SurfaceMapClient(Listener(driver.ros, "program").node)
    driver.ros.spin_until(lambda: client.can_approach, what="the actions")
    asked = client.retreat(0.1)
    driver.robot.drive_until(asked.done)
    assert asked.result() == pytest.approx(0.1, abs=0.01)
    asked = client.approach(SurfaceFilter(ids=[1]), spot=(-0.4, 0.0), gap=0.07)
    driver.robot.drive_until(asked.done)
    there = asked.result()
    assert there.surface_id == 1
    assert there.gap == pytest.approx(0.07, abs=0.02)
    assert there.distance == pytest.approx(0.62, abs=0.05)
    asked = client.retreat(1.0)
    driver.robot.drive_until(lambda: driver.robot.base.speed > 0.1)
    client.cancel()
    driver.robot.drive_until(asked.done)
    with pytest.raises(RequestError, match="cancelled"):
        asked.result()
    client.close()


def test_the_end_of_the_node_stops_the_base(drive):
    driver = drive(simple_flat())
    driver.send()
    driver.robot.drive_until(lambda: driver.robot.base.speed > 0.1)
    driver.node.interrupt()
    driver.ros.spin_until(lambda: driver.robot.commands[-1] == (0.0, 0.0))
    driver.node.close()
    driver.is_closed = True
    driver.robot.step()
    assert driver.robot.commands[-1] == (0.0, 0.0)
