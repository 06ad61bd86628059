"""~/scan_here over DDS, with a simulated controller, laser and room."""

import sys

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from live_robot import TABLE, Listener, slam, tccm
from moving_head import MovingHead
from processes import PATIENCE_S
from rcl_interfaces.msg import Log
from rclpy.action import ActionClient

from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.services.view_taker import movement_ends

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED,
)  # fmt: skip

WAITING, MOVING, MAPPING = 0, 1, 2
"""Phases of tccm_interfaces/ScanHere."""


class Viewer:
    """A client of the action."""

    def __init__(self, ros, world):
        from tccm_interfaces.action import ScanHere

        self.kind, self.ros, self.world = ScanHere, ros, world
        self.client = ActionClient(Listener(ros, "viewer").node, ScanHere, "surface_slam/scan_here")
        self.phases: list[int] = []
        self.progress: list[float] = []

    def send(self, **fields):
        """Send a goal; return its handle."""
        self.world.until(self.client.server_is_ready, what="the action")
        sent = self.client.send_goal_async(self.kind.Goal(**fields), self._note)
        self.world.until(sent.done, what="the goal's answer")
        assert sent.result().accepted
        return sent.result()

    def result(self, goal):
        """Return status and result of a goal."""
        done = goal.get_result_async()
        self.world.until(done.done, what="the result")
        return done.result().status, done.result().result

    def ask(self, **fields):
        return self.result(self.send(**fields))

    def _note(self, message) -> None:
        self.phases.append(message.feedback.phase)
        self.progress.append(message.feedback.progress)


@pytest.fixture
def world(ros, monkeypatch):
    """Return what makes the nodes, a moving head and a client."""
    made = []
    # A loaded machine takes many times what a free one takes.
    for name in ("PATIENCE_S", "VIEW_S", "SOLUTION_S"):
        monkeypatch.setattr(f"tccm_ros.nodes.services.view_taker.{name}", PATIENCE_S)
    for name in ("ANSWER_S", "LATE_S"):
        monkeypatch.setattr(f"tccm_ros.nodes.services.joint_mover.{name}", PATIENCE_S)

    def make(controller="head_controller/follow_joint_trajectory", **values):
        values = {"frames__tilt_joint": "tilt", "scan_here__tilt_range": [0.2, 1.2]} | values
        head = MovingHead(ros, tccm(ros), slam(ros, **values), controller=controller)
        ros.connect(*head.nodes, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
        viewer = Viewer(ros, head)
        made.append((head, viewer))
        return head, viewer

    yield make
    for head, viewer in made:
        head.close()
        viewer.client.destroy()


def test_a_view_is_taken_and_has_the_table_where_it_stands(world):
    head, viewer = world()
    status, result = viewer.ask()
    assert (status, result.success) == (SUCCEEDED, True), result.message
    assert head.tilts == [pytest.approx(0.2), pytest.approx(1.2)]
    assert head.durations == [pytest.approx(1.0), pytest.approx(1.0 / 0.3)]
    assert viewer.phases == [WAITING, MOVING, MAPPING]
    assert viewer.progress == sorted(viewer.progress)
    assert result.surfaces.header.frame_id == "map"
    labels = {s.label: s for s in result.surfaces.surfaces}
    assert "table" in labels, (labels, result.message)
    table = labels["table"]
    place, size = table.pose.position, (table.size_x, table.size_y)
    # The room of live_robot: 0.4 to 1.2 m ahead, 1 m wide. From one scan line to the next it is
    # 1.6 cm at the near edge and 6.8 cm at the far one, and what lies between is not seen.
    assert np.allclose((place.x, place.y), (0.8, 0.0), atol=0.05)
    assert abs(place.z - TABLE) < 0.005
    assert np.allclose(size, (1.0, 0.8), atol=0.084)
    assert "surfaces were measured" in result.message


def test_answer_has_measurements_of_this_view_alone(world):
    head, viewer = world()
    assert viewer.ask()[1].surfaces.surfaces
    status, result = viewer.ask(min_tilt=-0.8, max_tilt=0.0, max_velocity=0.5)
    assert status == SUCCEEDED, result.message
    assert head.tilts[2:] == [pytest.approx(-0.8), pytest.approx(0.0)], "it reverses there"
    assert head.durations[-1] == pytest.approx(0.8 / 0.5)
    assert list(result.surfaces.surfaces) == []


def test_a_goal_that_is_cancelled_stops_the_controller(world):
    head, viewer = world()
    head.holds = True
    goal = viewer.send()
    head.until(lambda: head.tilts, what="the controller's goal")
    second = viewer.ask()[1]
    assert not second.success
    assert "another view is being taken" in second.message
    cancelled = goal.cancel_goal_async()
    head.until(cancelled.done)
    status, result = viewer.result(goal)
    assert (status, result.success) == (CANCELED, False)
    head.until(lambda: head.was_cancelled, what="the end of the movement")
    head.holds = False
    assert viewer.ask()[1].success, "the next one is taken"


def test_a_base_that_does_not_stand_is_waited_for_and_no_longer(world):
    head, viewer = world()
    head.speed = 0.02
    status, result = viewer.ask(patience=Duration(nanosec=300_000_000))
    assert status == ABORTED
    assert "the base has not stood still within 0.3 s" in result.message
    assert not head.tilts
    assert set(viewer.phases) == {WAITING}


def test_motion_during_the_scan_is_reported(world):
    head, viewer = world()
    head.moving_speed = 0.01
    status, result = viewer.ask()
    assert status == ABORTED
    assert "the robot has moved while the view was taken" in result.message


def test_controller_that_refuses_or_fails_is_reported(world):
    head, viewer = world()
    head.refuses = True
    status, result = viewer.ask()
    assert status == ABORTED
    assert "refuses to move tilt" in result.message
    head.refuses, head.error_code = False, -4
    status, result = viewer.ask()
    assert status == ABORTED
    assert "the joint is blocked (error_code -4, status 6)" in result.message


def test_missing_controller_is_reported(world, monkeypatch):
    _, viewer = world(controller="")
    monkeypatch.setattr("tccm_ros.nodes.services.joint_mover.ANSWER_S", 0.5)
    status, result = viewer.ask()
    assert status == ABORTED
    assert "nobody offers the action 'head_controller/follow_joint_trajectory'" in result.message


def test_invalid_goals_are_reported(world):
    _, viewer = world()
    for fields, word in (
        ({"min_tilt": 1.0, "max_tilt": 0.5}, "min_tilt is 1, above max_tilt, 0.5"),
        ({"max_tilt": float("nan")}, "max_tilt is nan"),
        ({"max_velocity": -1.0}, "max_velocity is -1"),
        ({"pan_angles": [0.1]}, "scan_here.pan_joint is not set"),
    ):
        status, result = viewer.ask(**fields)
        assert (status, result.success) == (ABORTED, False)
        assert word in result.message


@pytest.mark.parametrize(
    ("joint", "word"), [("", "set frames.tilt_joint"), ("neck", "joints heard: tilt")]
)
def test_unknown_joint_is_reported(world, joint, word):
    _, viewer = world(frames__tilt_joint=joint)
    status, result = viewer.ask()
    assert status == ABORTED
    assert word in result.message


@pytest.mark.parametrize(
    ("now", "first"), [(-0.5, 1.0), (0.0, 0.0), (-0.01, 0.0), (0.4, 0.0), (0.6, 1.0), (1.5, 0.0)]
)
def test_the_joint_reverses_at_the_first_end_or_stands_there(now, first):
    assert movement_ends(now, 0.0, 1.0) == (first, 1.0 - first)


def test_missing_control_msgs_is_reported_and_the_action_not_offered(ros, monkeypatch):
    monkeypatch.setitem(sys.modules, "control_msgs", None)
    log = Listener(ros, "log").listen(Log, "/rosout", latched=True, depth=1000)
    node = slam(ros)
    services = [service for service, _ in node.get_service_names_and_types()]
    assert not any("scan_here" in name for name in services)
    ros.spin_until(lambda: any("~/scan_here is not offered" in m.msg for m in log))
