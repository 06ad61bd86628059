"""The tracker follows the base as the SLAM processor does, in a memory that does not grow."""

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import compose2
from tccm_ros.records import MapReset, Odometry
from tccm_ros.slam.matching.level_scan import make_level_scan
from tccm_ros.slam.tracking import Tracker
from tccm_ros.slam.wall_slam import WallSlam

WALLS = plan.ring()


@pytest.fixture(scope="module")
def run():
    return plan.drive(WALLS, plan.route([(0, 0), (12, 0), (12, 5)]), seed=4)


def test_tracking_matches_as_the_processor_and_takes_solutions(run):
    """Without loop closures the processor's pose of a scan is the front end's."""
    config = Config()
    config.loops.enabled = False
    slam, tracker = WallSlam(config), Tracker(config)
    for scan in run.scans:
        expected = slam.add_scan(scan)
        tracker.add(scan)
        ours = tracker.current_pose()
        assert ours.stamp_ns == expected.stamp_ns
        assert np.allclose(ours.pose, expected.pose, atol=1e-12)
        odom = make_level_scan(scan, config).odom
        assert np.allclose(compose2(ours.map_odom, odom), expected.pose, atol=1e-12)
    solution = slam.solve()
    assert tracker.counts["level scans"] == len(run.scans)
    assert tracker.counts["keyframes"] == len(solution.keyframes)
    corrected = compose2(slam.correction(solution), tracker.current_pose().pose)
    assert np.allclose(corrected, solution.poses[-1], atol=1e-9)


def test_tracking_keeps_only_the_data_for_the_next_match(run):
    config = Config()
    tracker = Tracker(config, (40, 2))
    for scan in run.scans:
        tracker.add(scan)
    front = tracker._front
    assert len(front.keyframes) <= max(config.matching.submap_keyframes, 3)
    assert len(front.tracked) == 1
    assert front.keyframes[-1].id == 40 + tracker.counts["keyframes"] - 1
    assert front.keyframes[-1].session == 2


def test_tracking_without_scans_follows_odometry_and_jumps_reset_it():
    tracker = Tracker(Config())
    for k in range(3):
        T = np.eye(4)
        T[0, 3] = 5.0 + k
        tracker.add(Odometry(k + 1, "odom", "base", T))
    assert np.allclose(tracker.current_pose().pose, [2.0, 0.0, 0.0])
    tracker.add(MapReset("back"))
    assert tracker.counts["resets"] == 1
    assert tracker.current_pose().stamp_ns == -1
