"""Another program's map -> odom in the graph: the trajectory follows it where it agrees."""

import numpy as np
import pytest

from tccm_ros.config.reader import read_config
from tccm_ros.geometry import planar, spatial
from tccm_ros.records import MapOdom
from tccm_ros.slam.se2 import between, compose
from tccm_ros.slam.wall_slam import WallSlam

SECOND = 1_000_000_000
STEPS = 200
"""Of 0.1 m and 0.1 s."""


def truth(k):
    """An S-shaped drive in the other program's map, which begins at (4, -2), looking along y."""
    yaw = np.pi / 2 + 0.8 * np.sin(k / 40)
    along = 0.1 * k
    return np.array([4.0 + 0.5 * np.sin(k / 30), -2.0 + along, yaw])


def drive(told, drift=0.0, seed=1):
    """Return a processor that was fed with odometry, and with what `told(k)` gives every 0.5 s."""
    rng = np.random.default_rng(seed)
    slam = WallSlam(read_config(None, ["localisation.source=tf"]))
    odom = np.zeros(3)
    for k in range(STEPS):
        if k:
            step = between(truth(k - 1), truth(k)) * (1.0 + drift)
            odom = compose(odom, step + rng.normal(0.0, [5e-4, 2e-4, 2e-4]))
        slam.add_odometry(k * SECOND // 10, spatial(odom))
        pose = told(k) if k % 5 == 0 else None
        if pose is not None:
            T_map_odom = spatial(pose) @ np.linalg.inv(spatial(odom))
            slam.add_map_odom(MapOdom(k * SECOND // 10, T_map_odom))
    return slam


def errors(slam):
    """Return the distance of each pose of the solution from the truth, m."""
    solution = slam.solve()
    true = np.array([truth(round(s / SECOND * 10)) for s in solution.stamps_ns])
    return np.hypot(*(solution.poses - true)[:, :2].T)


def test_the_map_is_that_of_the_other_program():
    assert errors(drive(truth)).max() < 0.01


def test_noise_is_smoothed_and_drift_of_odometry_is_corrected():
    rng = np.random.default_rng(7)

    def noisy(k):
        return truth(k) + rng.normal(0.0, [0.03, 0.03, np.radians(1.0)])

    # Odometry alone ends 0.6 m off.
    assert errors(drive(noisy, drift=0.03)).max() < 0.04


def test_poses_that_contradict_the_rest_for_a_while_count_little():
    def jumping(k):
        return truth(k) + np.array([0.5, 0.0, 0.0]) * (80 <= k < 100)

    assert errors(drive(jumping)).max() < 0.02


def test_where_it_begins_late_odometry_leads_back_to_the_start():
    late = drive(lambda k: truth(k) if k >= 100 else None)
    assert errors(late).max() < 0.05
    assert not late.waits_for_external_pose


def test_a_robot_that_stands_has_the_median_of_what_is_told():
    slam = WallSlam(read_config(None, ["localisation.source=tf"]))
    for k in range(11):
        slam.add_odometry(k * SECOND, np.eye(4))
        x = 0.0 if k < 3 else 1.0  # a filter that converges
        slam.add_map_odom(MapOdom(k * SECOND, spatial(np.array([x, 0.0, 0.0]))))
    assert slam.solve().poses[-1] == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)


def test_the_live_pose_is_what_was_told_last():
    slam = drive(truth)
    live = slam.current_pose()
    assert live.stamp_ns == (STEPS - 1) * SECOND // 10
    assert live.pose == pytest.approx(truth(STEPS - 1), abs=0.01)


def test_without_a_word_the_robot_is_nowhere():
    assert drive(lambda k: None).waits_for_external_pose
    assert not WallSlam(read_config(None, [])).waits_for_external_pose


def test_yaw_is_compared_over_the_wrap():
    def turned(k):
        pose = np.array([0.1 * k, 0.0, np.pi - 1e-3 * (-1) ** (k // 5)])
        return planar(spatial(pose))

    slam = WallSlam(read_config(None, ["localisation.source=tf"]))
    for k in range(50):
        odom = np.array([-0.1 * k, 0.0, 0.0])
        slam.add_odometry(k * SECOND // 10, spatial(odom))
        if k % 5 == 0:
            T = spatial(turned(k)) @ np.linalg.inv(spatial(odom))
            slam.add_map_odom(MapOdom(k * SECOND // 10, T))
    solution = slam.solve()
    assert solution.poses[:, 0] == pytest.approx(0.1 * np.arange(50), abs=0.01)
