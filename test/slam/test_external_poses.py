"""Another program's map -> odom in the graph: the trajectory follows it where it agrees."""

from types import SimpleNamespace

import numpy as np
import plan
import pytest

from tccm_ros.config.reader import read_config
from tccm_ros.errors import MessageError
from tccm_ros.geometry import planar, spatial
from tccm_ros.records import MapOdom, Odometry, PoseCovariance
from tccm_ros.ros.reading import pose_covariance_from_message
from tccm_ros.slam.external_poses import MapOdomTrack, white_variance
from tccm_ros.slam.front_end import FrontEnd, GraphKeyframe
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.se2 import between_se2, compose_se2
from tccm_ros.slam.tracking import Tracker
from tccm_ros.slam.wall_slam import WallSlam

MEDIAN_VARIANCE = 0.5 * np.pi  # of a median, over that of the mean, of normal variates

SECOND = 1_000_000_000
STEPS = 200
"""Of 0.1 m and 0.1 s."""

CONFIG = read_config(None, ["localisation.source=tf"])


def truth(k):
    """An S-shaped drive in the other program's map, which begins at (4, -2), looking along y."""
    yaw = np.pi / 2 + 0.8 * np.sin(k / 40)
    along = 0.1 * k
    return np.array([4.0 + 0.5 * np.sin(k / 30), -2.0 + along, yaw])


def records(external, drift=0.0, seed=1):
    """Yield odometry, and every 0.5 s map -> odom, by the poses that `told(k)` gives."""
    rng = np.random.default_rng(seed)
    odom = np.zeros(3)
    for k in range(STEPS):
        if k:
            step = between_se2(truth(k - 1), truth(k)) * (1.0 + drift)
            odom = compose_se2(odom, step + rng.normal(0.0, [5e-4, 2e-4, 2e-4]))
        yield Odometry(k * SECOND // 10, "odom", "base", spatial(odom))
        pose = external(k) if k % 5 == 0 else None
        if pose is not None:
            yield MapOdom(k * SECOND // 10, spatial(pose) @ np.linalg.inv(spatial(odom)))


def drive(external, **options):
    """Return a processor that was fed with `records`."""
    slam = WallSlam(CONFIG)
    for record in records(external, **options):
        if isinstance(record, MapOdom):
            slam.add_map_odom(record)
        else:
            slam.add_odometry(record.stamp_ns, record.T_odom_base)
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


def test_late_external_poses_are_extended_by_odometry_to_the_start():
    late = drive(lambda k: truth(k) if k >= 100 else None)
    assert errors(late).max() < 0.05
    assert not late.waits_for_external_pose


def test_stationary_robot_has_the_median_of_external_poses():
    slam = WallSlam(read_config(None, ["localisation.source=tf"]))
    for k in range(11):
        slam.add_odometry(k * SECOND, np.eye(4))
        x = 0.0 if k < 3 else 1.0  # a filter that converges
        slam.add_map_odom(MapOdom(k * SECOND, spatial(np.array([x, 0.0, 0.0]))))
    assert slam.solve().poses[-1] == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)


def test_live_pose_is_the_last_external_pose():
    tracker = Tracker(CONFIG)
    for record in records(truth):
        tracker.add(record)
    live = tracker.current_pose()
    assert live.stamp_ns == (STEPS - 1) * SECOND // 10
    assert live.pose == pytest.approx(truth(STEPS - 1), abs=0.01)


def test_robot_without_external_pose_is_not_localised():
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


SIGMA = (0.03, 0.02)


def cov_of_rest(poses):
    """Return the covariance of the pose of a keyframe at rest with transforms `poses`."""
    track, nothing = MapOdomTrack(), np.zeros((0, 2))
    for k, pose in enumerate(poses):
        track.add(MapOdom(k * SECOND // 10, spatial(pose)))
    scan = LevelScan(0, np.zeros(3), nothing, np.zeros(2), nothing, nothing)
    keyframe = GraphKeyframe(0, scan, np.zeros(3), np.zeros(3), np.zeros((3, 3)))
    return track.poses_of([keyframe], SIGMA)[0][1]


def test_independent_errors_average_out_and_repeated_ones_do_not():
    white = np.random.default_rng(3).normal(0.0, [SIGMA[0], SIGMA[0], SIGMA[1]], (400, 3))
    stated = np.square([SIGMA[0], SIGMA[0], SIGMA[1]])
    # The variance from 399 differences is within 30 % (three sigma of a median).
    assert np.all(np.diag(cov_of_rest(white)) < 0.3 * stated + MEDIAN_VARIANCE * stated / 400)
    assert np.diag(cov_of_rest(np.tile(white[0], (400, 1)))) == pytest.approx(stated)
    assert np.diag(cov_of_rest(white[:1])) == pytest.approx(stated)


def test_the_covariance_of_the_other_program_is_used_by_its_stamp():
    def end_of(cov):
        """Return the error of the last pose, where the other program is 0.3 m off at the end."""
        slam = drive(lambda k: truth(k) + np.array([0.0, 0.3, 0.0]) * (k > 170))
        slam.add_pose_covariance(PoseCovariance(0, "map", np.diag([1e-4, 1e-4, 1e-4])))
        slam.add_pose_covariance(PoseCovariance(17 * SECOND, "map", cov))
        return errors(slam)[-1]

    # Odometry of 2 m at the end has a standard deviation of 5 % a keyframe.
    assert end_of(np.diag([25.0, 25.0, 25.0])) < 0.03
    assert end_of(np.diag([1e-6, 1e-6, 1e-6])) > 0.2


def test_the_pose_covariance_of_a_message():
    def message(cov):
        header = SimpleNamespace(stamp=SimpleNamespace(sec=3, nanosec=7), frame_id="/map")
        return SimpleNamespace(header=header, pose=SimpleNamespace(covariance=cov.ravel()))

    cov = np.diag([4.0, 5.0, 1.0, 1.0, 1.0, 6.0])
    cov[0, 5] = cov[5, 0] = 0.5
    record = pose_covariance_from_message(message(cov))
    assert record.stamp_ns == 3 * SECOND + 7
    assert record.cov.tolist() == [[4.0, 0.0, 0.5], [0.0, 5.0, 0.0], [0.5, 0.0, 6.0]]
    for bad in (np.zeros((6, 6)), np.full((6, 6), np.nan), -cov):
        with pytest.raises(MessageError, match="no covariance"):
            pose_covariance_from_message(message(bad))


def test_white_variance_ignores_jumps_and_common_errors():
    rng = np.random.default_rng(4)
    groups = [rng.normal(rng.normal(0.0, 1.0, 3), 0.02, (200, 3)) for _ in range(5)]
    groups[0][100:] += 0.5
    assert np.sqrt(white_variance(groups)) == pytest.approx(np.full(3, 0.02), rel=0.15)
    assert white_variance([]) == pytest.approx(np.zeros(3))


def ring_drive(*, with_scans):
    """Return the solution of a drive in a ring of corridors with a true map -> odom."""
    made = plan.drive(plan.ring(), plan.route([(0, 0), (12, 0), (12, 9)]), sigma=0.01)
    slam = WallSlam(read_config(None, ["localisation.source=tf"]))
    for scan, true in zip(made.scans, made.truth):
        T_odom_base = scan.T_odom_base[0]
        slam.add_odometry(scan.stamp_ns, T_odom_base)
        slam.add_map_odom(MapOdom(scan.stamp_ns, spatial(true) @ np.linalg.inv(T_odom_base)))
        if with_scans:
            slam.add_scan_of_walls(scan)
    return slam.solve()


def test_walls_are_at_the_external_poses_and_do_not_move_them():
    solution = ring_drive(with_scans=True)
    without = ring_drive(with_scans=False)
    assert np.array_equal(solution.poses, without.poses)
    assert not solution.is_chain
    assert not without.walls
    start, end = plan.ring().transpose(1, 0, 2)  # the drive begins at the origin
    along = (end - start) / np.hypot(*(end - start).T)[:, None]
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    assert len(solution.walls) >= 4
    for wall in solution.walls:
        ends = wall.endpoints[None] - start[:, None]
        off = np.abs(np.einsum("wek,wk->we", ends, normals)).max(axis=1)
        assert off.min() < 0.04


@pytest.mark.parametrize("is_external", [False, True])
def test_odometry_since_the_last_solution_equals_all_samples_at_once(is_external):
    """Also after a sample in the past, after a replaced one, and after an earlier map -> odom."""

    def records():
        for k in range(60):
            yield k, truth(k)
        yield 20.5, truth(20)
        yield 59, truth(58)
        for k in range(60, 90):
            yield k, truth(k)

    def make():
        return WallSlam(read_config(None, ["localisation.source=tf"] if is_external else []))

    def add(slam, number, k, pose):
        slam.add_odometry(round(k * SECOND / 10), spatial(pose))
        if is_external and k in (40, 50, 59):
            stamp = -1 if k == 50 else round(k * SECOND / 10)
            slam.add_map_odom(MapOdom(stamp, spatial(np.array([0.01 * number, 2.0, 0.5]))))

    growing = make()
    for number, (k, pose) in enumerate(records()):
        add(growing, number, k, pose)
        if number in (30, 45, 55, 60, 61, 75, 91):
            whole = make()
            for i, (other_k, other_pose) in enumerate(records()):
                if i <= number:
                    add(whole, i, other_k, other_pose)
            grown, batch = growing.solve(), whole.solve()
            for a, b in zip(grown.keyframes, batch.keyframes, strict=True):
                assert (a.id, a.stamp_ns) == (b.id, b.stamp_ns)
                assert a.pose.tobytes() == b.pose.tobytes()
            assert grown.poses.tobytes() == batch.poses.tobytes()
            assert grown.cov_keyframes.tobytes() == batch.cov_keyframes.tobytes()


def test_an_odometry_sample_is_tracked_once(monkeypatch):
    tracked = []
    add = FrontEnd.add
    monkeypatch.setattr(
        FrontEnd,
        "add",
        lambda self, scan, start: tracked.append(scan.stamp_ns) or add(self, scan, start),
    )
    slam = WallSlam(read_config(None, []))
    for k in range(60):
        slam.add_odometry(k * SECOND // 10, spatial(truth(k)))
        if k % 20 == 19:
            slam.solve()
    assert tracked == [k * SECOND // 10 for k in range(60)]
