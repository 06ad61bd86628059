"""Roll and pitch of the base at views: what later drives tell counts for the first stop too."""

import numpy as np
import plan
import pytest
from scipy.spatial.transform import Rotation

from tccm_ros.config import Config
from tccm_ros.records import RollPitch
from tccm_ros.slam.base_attitude import RollPitchTrack
from tccm_ros.slam.wall_slam import WallSlam

QUANTUM = 0.00025  # rad, step of the usual roll and pitch: 0.75 mm at 3 m

START, STEP_NS, SIGMA = 1_700_000_000_000_000_000, 100_000_000, 0.0015
BIAS, ROLL, PITCH = np.array([0.03, -0.02]), 0.02, -0.015


def samples(count, *, known_from=0, tilt=(ROLL, PITCH), sigma=SIGMA):
    return [
        RollPitch(
            START + k * STEP_NS,
            tuple((BIAS + tilt).tolist()),
            sigma,
            tuple(BIAS.tolist()) if k >= known_from else None,
        )
        for k in range(count)
    ]


def track_of(found):
    track = RollPitchTrack()
    for sample in found:
        track.add(sample)
    return track


def test_usual_roll_and_pitch_of_a_later_drive_apply_to_all_views():
    track = track_of(samples(20, known_from=19))
    stamps = [START, START + 3 * STEP_NS // 2, START + 19 * STEP_NS]
    np.testing.assert_allclose(track.at(stamps), [[ROLL, PITCH]] * 3, atol=QUANTUM)
    assert not track_of(samples(20, known_from=20)).at(stamps).any()


def test_between_samples_they_are_linear_and_beyond_or_in_a_gap_none():
    found = samples(20)
    found[11] = found[11]._replace(measured=tuple((BIAS + np.array([3 * ROLL, PITCH])).tolist()))
    track = track_of(found[:3] + found[10:])
    ((roll, _),) = track.at([found[10].stamp_ns + STEP_NS // 4])
    assert roll == pytest.approx(1.5 * ROLL, abs=QUANTUM)
    assert not track.at([START - 1, found[5].stamp_ns, found[19].stamp_ns + 1]).any()


def test_roll_and_pitch_within_noise_are_exactly_zero():
    assert not track_of(samples(9, tilt=(2.0 * SIGMA, 0.0))).at([START]).any()
    assert not track_of(samples(9, sigma=0.02)).at([START]).any()


def test_a_drive_that_changes_the_usual_values_by_a_little_moves_no_view():
    track = track_of(samples(9))
    before = track.at([START])
    usual = tuple((BIAS + 0.3 * QUANTUM).tolist())
    track.add(samples(10)[-1]._replace(usual=usual))
    np.testing.assert_array_equal(track.at([START]), before)


@pytest.fixture(scope="module")
def run():
    """A robot that turns on its way, so that a view's axes are not those of the map."""
    return plan.drive(plan.ring(), plan.route([(0, 0), (3, 0), (3, 1.5)]))


def solved(run, views, found=()):
    slam = WallSlam(Config())
    for scan in run.scans:
        slam.add_scan(scan)
    for sample in found:
        slam.add_roll_pitch(sample)
    return slam.solve(views)


def with_stamps(run, found):
    """Return samples at the scans of a run."""
    return [s._replace(stamp_ns=int(ns)) for s, ns in zip(found, run.stamps_ns, strict=True)]


def test_a_view_has_roll_and_pitch_about_its_own_axes(run):
    views = [int(run.stamps_ns[3]), int(run.stamps_ns[-2])]
    plain = solved(run, views)
    tilted = solved(run, views, with_stamps(run, samples(len(run.scans))))
    yaw = np.arctan2(plain.T_map_views[:, 1, 0], plain.T_map_views[:, 0, 0])
    assert abs(yaw[1]) > 1.0
    for T, T_plain, psi in zip(tilted.T_map_views, plain.T_map_views, yaw):
        expected = Rotation.from_euler("ZYX", [psi, PITCH, ROLL]).as_matrix()
        np.testing.assert_allclose(T[:3, :3], expected, atol=2 * QUANTUM)
        np.testing.assert_allclose(T[:3, 3], T_plain[:3, 3], atol=1e-6)
    np.testing.assert_allclose(tilted.poses, plain.poses, atol=1e-6)


def test_a_base_that_does_not_tilt_has_the_solution_without_an_imu(run):
    views = [int(run.stamps_ns[3]), int(run.stamps_ns[-2])]
    level = with_stamps(run, samples(len(run.scans), tilt=(0.0, 0.0)))
    assert (
        solved(run, views, level).T_map_views.tobytes() == solved(run, views).T_map_views.tobytes()
    )


def test_without_level_scans_views_have_them_too(run):
    slam, stamps = WallSlam(Config()), [int(ns) for ns in run.stamps_ns]
    for scan in run.scans:
        slam.add_odometry(scan.stamp_ns, scan.T_odom_base[0])
    for sample in with_stamps(run, samples(len(stamps))):
        slam.add_roll_pitch(sample)
    (T,) = slam.solve(stamps[3:4]).T_map_views
    assert np.arctan2(T[2, 1], T[2, 2]) == pytest.approx(ROLL, abs=2 * QUANTUM)
    assert -np.arcsin(T[2, 0]) == pytest.approx(PITCH, abs=2 * QUANTUM)
