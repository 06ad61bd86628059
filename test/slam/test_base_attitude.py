"""Height, roll and pitch of the base by odometry: legged robots, and wheels that have none."""

from dataclasses import replace

import numpy as np
import pytest
from room import Board, Room
from surface_maps import above_floor

from tccm_ros.config import Config
from tccm_ros.geometry import inverse, pose_from_roll_pitch, transform
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import Odometry
from tccm_ros.slam.base_attitude import AttitudeTrack, attitude_of, with_attitude

ROOM = Room([Board(1.5, 0.0, 0.8, 1.4, 0.74)], [], Board(0.5, 0.3, 6.0, 4.6, 0.0))
PLACES = np.array([(0.0, 0.0, 0.0), (0.1, 0.3, 0.1), (0.2, -0.2, -0.2)])
STANCES = np.array([(0.76, 0.0, 0.0), (0.70, 0.03, -0.05), (0.80, -0.02, 0.04)])
"""Height (m), roll and pitch (rad) at each place."""


def walked(slam, stances):
    """Look from each place, the base standing as `stances` (N, 3) say; clouds alone."""
    for k, (place, stance) in enumerate(zip(PLACES, stances)):
        stamp, T = (k + 1) * 10**9, with_attitude(place, stance)
        for at_ns in (stamp - 10**8, stamp + 10**8):
            slam.add(Odometry(at_ns, "odom", "base", T))
        cloud, _ = ROOM.look(place, stamp, seed=k, noise=0.001)
        to_base = inverse(with_attitude(np.zeros(3), stance))
        points = transform(to_base, cloud.points).astype(np.float32)
        viewpoint = cloud.viewpoint
        if viewpoint is not None:
            viewpoint = transform(to_base, viewpoint[None])[0].astype(np.float32)
        slam.add(replace(cloud, points=points, viewpoint=viewpoint))
        slam.add_pose_stamp(stamp)
    return slam.solve()


def test_surfaces_count_from_the_ground_whatever_the_attitude_of_the_base():
    solution = walked(SurfaceSlam(Config()), STANCES)
    (table,) = above_floor(solution.mapped)
    # Noise of 1 mm, over hundreds of points.
    assert table.height == pytest.approx(0.74, abs=0.002)
    assert solution.floor_z == pytest.approx(0.0, abs=0.002)
    assert [attitude_of(T) for T in solution.T_map_base] == pytest.approx(STANCES, abs=1e-9)


def test_wheels_have_poses_of_the_same_bytes_as_planar_ones():
    solution = walked(SurfaceSlam(Config()), 0.0 * STANCES)
    assert not len(solution.attitudes)
    assert not len(solution.graph.attitudes)
    assert np.array_equal(solution.T_map_base[:, 2], [[0.0, 0.0, 1.0, 0.0]] * 3)


def test_attitudes_are_interpolated_and_repeated_samples_kept_once():
    track = AttitudeTrack()
    for k in range(1000):
        track.add(k * 10, (0.5, 0.0, 0.0))
    track.add(10_000, (0.7, 0.1, -0.1))
    assert len(track._samples) == 3
    assert track.at([-5, 5000, 9990, 9995, 20_000]) == pytest.approx(
        np.array([[0.5, 0, 0], [0.5, 0, 0], [0.5, 0, 0], [0.6, 0.05, -0.05], [0.7, 0.1, -0.1]])
    )


def test_an_attitude_is_that_of_the_pose_that_it_makes():
    T = with_attitude(np.array([1.0, 2.0, 3.0]), np.array([0.4, 0.2, -0.3]))
    assert attitude_of(T) == pytest.approx((0.4, 0.2, -0.3))
    assert T[:3, :3] @ pose_from_roll_pitch((0.2, -0.3))[:3, :3].T @ [0, 0, 1] == pytest.approx(
        [0, 0, 1]
    )
