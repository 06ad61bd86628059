from dataclasses import replace

import gtsam
import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.geometry import compose2, spatial, transform
from tccm_ros.records import LandmarkObservation, PoseGuess
from tccm_ros.slam.factors.landmarks import LandmarkFactor, register_landmark
from tccm_ros.slam.factors.noise import gaussian
from tccm_ros.slam.wall_slam import WallSlam

COV = np.eye(3) * 0.02**2
POST = np.array([2.0, 1.5, 0.8])


@register_landmark
class Post(LandmarkFactor):
    """Where a post is in the base frame, (x, y, z) in m."""

    kind, letter = "post", "p"

    def add_to(self, graph):
        direction, away = gtsam.Unit3(self.measurement), float(np.linalg.norm(self.measurement))
        noise = gaussian(np.diag([0.01, 0.01, 0.02]) ** 2)
        keys = self.pose.symbol, self.landmark.symbol
        graph.add(gtsam.BearingRangeFactor3D(*keys, direction, away, noise))

    def start(self, T_map_base):
        return transform(T_map_base, self.measurement[None])[0]


def observation(pose, stamp_ns, number=4):
    """Return what is seen of the post from a planar pose, without noise."""
    seen = transform(np.linalg.inv(spatial(np.asarray(pose))), POST[None])[0]
    return LandmarkObservation(stamp_ns, "post", number, seen, COV)


@pytest.fixture(scope="module")
def run():
    return plan.drive(plan.ring(), plan.route([(0, 0), (4, 0)]), odometry=True)


def slam_of(run, observations):
    slam = WallSlam(Config())
    for seen in observations:
        slam.add_landmark(seen)
    for scan in run.scans:
        slam.add_scan(scan)
    return slam


def seen_along(run, every=6):
    rows = list(zip(run.truth, run.stamps_ns.tolist()))[::every]
    return [observation(pose, stamp) for pose, stamp in rows]


def test_landmarks_stay_while_the_robot_has_no_place(run):
    """It is told a pose within the block that the ring goes round, and people hide all walls."""
    slam = WallSlam(Config())
    for scan in run.scans[:30]:
        slam.add_scan(scan)
    seen = [o for o in seen_along(run) if o.stamp_ns <= run.stamps_ns[29]]
    for observation in seen:
        slam.add_landmark(observation)
    stamp = int(run.stamps_ns[30])
    slam.add_guess(PoseGuess(stamp, np.array([6.0, 4.5, 0.3]), np.diag([0.04, 0.04, 0.01])))
    hidden = replace(run.scans[30].scan, ranges=np.full_like(run.scans[30].scan.ranges, 0.4))
    slam.add_scan(replace(run.scans[30], record=hidden))
    assert not slam.is_located
    assert [m.observations for m in slam.solve().landmarks] == [len(seen)]


def test_the_order_of_observations_does_not_change_the_solution(run):
    """Early and backwards, or each before the scan at its stamp."""
    seen, slam = seen_along(run), WallSlam(Config())
    by_stamp = {o.stamp_ns: o for o in seen}
    for scan in run.scans:
        if scan.scan.stamp_ns in by_stamp:
            slam.add_landmark(by_stamp[scan.scan.stamp_ns])
        slam.add_scan(scan)
    one, other = slam.solve(), slam_of(run, seen[::-1]).solve()
    assert one.poses.tobytes() == other.poses.tobytes()
    for a, b in zip(one.landmarks, other.landmarks, strict=True):
        assert a.observations == b.observations == len(seen)
        assert np.allclose(a.position, POST, atol=0.03)
        assert a.position.tobytes() == b.position.tobytes()
        assert a.covariance.tobytes() == b.covariance.tobytes()


def test_an_observation_that_comes_late_has_the_same_weight(run):
    slam = slam_of(run, [])
    for seen in seen_along(run):
        slam.add_landmark(seen)
    (late,), (early,) = slam.solve().landmarks, slam_of(run, seen_along(run)).solve().landmarks
    assert np.allclose(late.position, early.position, atol=1e-6)


def test_without_observations_the_solution_has_no_landmarks(run):
    solution = slam_of(run, []).solve()
    assert solution.landmarks == ()
    assert "landmark_kinds" in slam_of(run, []).saved()


def test_a_saved_map_of_an_earlier_version_without_landmarks_is_loaded(run):
    state = slam_of(run, seen_along(run)).saved()
    assert len(WallSlam.from_saved(Config(), state).solve().landmarks) == 1
    older = {name: x for name, x in state.items() if not name.startswith("landmark_")}
    assert WallSlam.from_saved(Config(), older).solve().landmarks == ()


def test_landmarks_are_estimated_on_odometry_alone(run):
    slam = WallSlam(Config())
    for pose, stamp in zip(run.truth, run.stamps_ns):
        slam.add_odometry(int(stamp), spatial(pose))
    slam.add_landmark(observation(run.truth[20], int(run.stamps_ns[20])))
    (post,) = slam.solve().landmarks
    assert np.allclose(post.position, POST, atol=1e-3)


def test_unlocalised_session_has_only_landmarks_of_the_saved_map(run):
    later = WallSlam.from_saved(Config(), slam_of(run, seen_along(run)).saved())
    box = plan.drive(plan.box(-1, -1, 1.5, 1.2), np.zeros((3, 3)), start_ns=2 * 10**18)
    for scan in box.scans:
        later.add_scan(scan)
    later.add_landmark(observation(compose2([0.5, 0.0, 0.1], np.zeros(3)), 2 * 10**18, number=5))
    assert [landmark.id for landmark in later.solve().landmarks] == [4]


def test_a_kind_of_landmark_that_is_not_registered_is_refused(run):
    stray = LandmarkObservation(0, "lighthouse", 1, np.zeros(3), COV)
    with pytest.raises(ValueError, match="no landmark of kind 'lighthouse' is registered"):
        WallSlam(Config()).add_landmark(stray)
    state = slam_of(run, seen_along(run)).saved()
    unknown = np.frombuffer(b'["lighthouse"]', np.uint8)
    with pytest.raises(MapError, match="'lighthouse'"):
        WallSlam.from_saved(Config(), {**state, "landmark_kinds": unknown})
    with pytest.raises(MapError, match="damaged"):
        WallSlam.from_saved(Config(), {**state, "landmark_size": state["landmark_size"] + 1})
    with pytest.raises(ValueError, match="the letter 'x' is taken"):
        register_landmark(type("Mirror", (Post,), {"kind": "mirror", "letter": "x"}))


def test_landmarks_count_from_the_ground_of_odometry_also_in_a_saved_map(run):
    """tf tells that the base walks 0.4 m above the ground."""
    slam, up = WallSlam(Config()), np.array([0.0, 0.0, 0.4])
    for seen in seen_along(run):
        slam.add_landmark(replace(seen, measurement=seen.measurement - up))
    for scan in run.scans:
        T = scan.T_odom_base.copy()
        T[:, :3, 3] += up
        slam.add_scan(replace(scan, T_odom_base=T))
    assert slam.solve().landmarks[0].position[2] == pytest.approx(POST[2], abs=0.002)
    saved = slam.saved()
    assert (saved["landmark_attitude"] == [0.4, 0.0, 0.0]).all()
    again = WallSlam.from_saved(Config(), saved).solve()
    assert again.landmarks[0].position[2] == pytest.approx(POST[2], abs=0.002)
    assert "landmark_attitude" not in slam_of(run, seen_along(run)).saved()
