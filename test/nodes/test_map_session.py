"""What a session does with objects between solutions: views count at poses in the map alone."""

from collections import Counter
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from table_views import AHEAD, FIRST, SECOND, S, parts

from tccm_ros.config import Config
from tccm_ros.geometry import compose2, inverse2, spatial
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.nodes.map_session import MapSession
from tccm_ros.records import Odometry
from tccm_ros.scene.session_changes import scene_of
from tccm_ros.slam.tracking import LivePose, LocalisationState


class StandInTracker:
    """A tracker whose pose, state and correction a test sets."""

    is_localised, odom_frame = True, "odom"

    def __init__(self):
        self.counts = Counter({"level scans": 1})
        self.state, self.pose, self.stamp_ns = LocalisationState.TRACKING, np.zeros(3), -1
        self.correction = np.zeros(3)

    def add(self, event):
        self.stamp_ns = max(self.stamp_ns, event.stamp_ns)

    def take(self, solved):
        return self.correction

    def current_pose(self):
        return LivePose(self.stamp_ns, self.pose, np.zeros(3))

    def current_covariance(self):
        return np.eye(3)


class Session:
    """A session without DDS and solver process, which was given the solution of one view."""

    def __init__(self):
        self.client_api, solver = MagicMock(has_scene_listeners=True), MagicMock(next_number=1)
        others = [MagicMock() for _ in range(3)]
        self.session = MapSession(
            Config(), solver, *others, self.client_api, MagicMock(), lambda: True
        )
        self.tracker = self.session.tracker = StandInTracker()
        self.client_api.show.side_effect = self._show
        slam = SurfaceSlam(Config())
        slam.add(Odometry(10 * S, "odom", "base", np.eye(4)))
        for part in parts(10 * S, np.zeros(3), FIRST):
            slam.add(part)
        self.solution, self.shown = scene_of(slam.solve(), "map"), None
        self.solve()

    def _show(self, number, after_newest_view):
        self.shown = after_newest_view(self.solution)

    def solve(self):
        map_, resets = SimpleNamespace(is_unjoined=False), self.tracker.counts["resets"]
        solved = SimpleNamespace(duration_s=0.1, resets=resets, map=map_, messages=(), number=1)
        self.session.take_solved(solved)

    def move(self, stamp_ns, pose):
        self.tracker.pose = pose
        self.session.track(Odometry(stamp_ns, "odom", "base", spatial(pose)))

    def look(self, stamp_ns, *cups):
        for part in parts(stamp_ns, AHEAD, *cups):
            self.session.track(part)

    @property
    def shown_between(self):
        """The places of the objects in the newest scene between solutions."""
        (scene,) = self.client_api.show_objects.call_args.args
        return [item.center[:2] for item in scene.objects]


def test_a_view_is_shown_at_the_live_pose():
    session = Session()
    session.move(20 * S, AHEAD)
    session.look(20 * S, FIRST, SECOND)
    assert session.shown_between == [pytest.approx(place, abs=0.02) for place in (FIRST, SECOND)]


@pytest.mark.parametrize("state", [LocalisationState.SEARCHING, LocalisationState.LOST])
def test_views_of_a_robot_that_is_not_in_the_map_change_no_object(state):
    session = Session()
    session.tracker.state = state
    session.move(20 * S, AHEAD)
    session.look(20 * S, SECOND)
    session.client_api.show_objects.assert_not_called()
    session.solve()
    assert session.shown.objects is session.solution.objects
    session.tracker.state = LocalisationState.TRACKING
    session.solve()
    assert session.shown.objects is session.solution.objects, (
        "it is in the next solution that has it"
    )


def test_a_robot_that_is_lost_takes_its_newest_views_back():
    session = Session()
    session.move(20 * S, AHEAD)
    session.look(20 * S, SECOND)
    session.tracker.state = LocalisationState.LOST
    session.move(21 * S, AHEAD)
    session.solve()
    assert session.shown.objects is session.solution.objects


def test_a_place_that_is_found_moves_the_views_before_it():
    session, T = Session(), np.array([0.1, -0.1, 0.2])
    session.move(20 * S, compose2(inverse2(T), AHEAD))
    session.look(20 * S, FIRST, SECOND)
    assert np.linalg.norm(session.shown_between[-1] - SECOND) > 0.1
    session.tracker.correction = T
    localised = SimpleNamespace(
        resets=0, waits_for="", map=SimpleNamespace(is_unjoined=False), is_at_given_pose=True
    )
    session.session.take_localised(localised)
    session.move(21 * S, AHEAD)
    session.look(21 * S, FIRST, SECOND)
    assert session.shown_between == [pytest.approx(place, abs=0.02) for place in (FIRST, SECOND)]


def test_after_a_reset_no_object_is_left():
    session = Session()
    session.move(20 * S, AHEAD)

    def add(event):
        session.tracker.counts["resets"] += 1

    session.tracker.add = add
    session.move(30 * S, AHEAD)
    session.tracker.add = lambda event: None
    session.look(30 * S, FIRST)
    session.client_api.show_objects.assert_not_called()
