"""A kind of landmark that the package does not know: estimated, drawn, saved and gone on with."""

from dataclasses import replace

import gtsam
import numpy as np
import plan
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from scipy.stats import chi2

from tccm_ros.config import Config
from tccm_ros.mapping.saved_map import SavedMap
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import LandmarkObservation
from tccm_ros.report import palette
from tccm_ros.report.map_picture import map_png
from tccm_ros.results.exports import write_solution
from tccm_ros.results.folder_reader import load_results
from tccm_ros.results.map_file import load_map, save_map
from tccm_ros.slam.factors.landmarks import LandmarkFactor, register_landmark
from tccm_ros.slam.wall_slam import WallSlam

LAP = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 2)]
COV = np.diag([0.01, 0.01, 0.03]) ** 2
BEACONS = {3: (6.0, 0.6, 1.4), 8: (12.5, 5.0, 0.4), 9: (3.0, 9.5, 2.0), 11: (-0.6, 4.0, 1.0)}


@register_landmark
class Beacon(LandmarkFactor):
    """Bearing (azimuth and elevation, rad) and range (m) of a beacon from the base."""

    kind, letter = "beacon", "b"

    def add_to(self, graph):
        ray, away = gtsam.Unit3(direction(*self.measurement[:2])), self.measurement[2]
        noise = gtsam.noiseModel.Gaussian.Covariance(self.covariance)
        keys = self.pose.symbol, self.landmark.symbol
        graph.add(gtsam.BearingRangeFactor3D(*keys, ray, away, noise))

    def start(self, T_map_base):
        azimuth, elevation, away = self.measurement
        return T_map_base[:3, :3] @ direction(azimuth, elevation) * away + T_map_base[:3, 3]


def direction(azimuth, elevation):
    c = np.cos(elevation)
    return np.array([np.cos(azimuth) * c, np.sin(azimuth) * c, np.sin(elevation)])


def drive(slam, corners, seed=1, start_ns=10**18, beacons=BEACONS):
    """Drive a route in the ring; between scans, the robot measures what beacons are within 5 m.

    Returns the live pose at the end.
    """
    route, random = plan.route(corners), np.random.default_rng(seed)
    run = plan.drive(plan.ring(), route, seed=seed, start_ns=start_ns)
    for k, scan in enumerate(run.scans):
        found = slam.add_scan(scan)
        x, y, yaw = 0.5 * (route[k] + route[min(k + 1, len(route) - 1)])
        for number, (bx, by, bz) in beacons.items():
            away = np.hypot(bx - x, by - y)
            if k % 5 == 0 and away < 5.0:
                exact = [np.arctan2(by - y, bx - x) - yaw, np.arctan2(bz, away), np.hypot(away, bz)]
                measured = exact + random.normal(size=3) * np.sqrt(np.diag(COV))
                stamp = scan.scan.stamp_ns + 50_000_000
                slam.add_landmark(LandmarkObservation(stamp, "beacon", number, measured, COV))
    return found.pose


def draw(slam, folder):
    """Write results and map of a run; return how many pixels of the picture show landmarks."""
    empty, found = SurfaceSlam(Config()).solve(), slam.solve()
    path = {"trajectory_ns": found.stamps_ns, "trajectory": found.poses}
    solution = replace(empty, graph=found, **path)
    folder.mkdir()
    write_solution(folder, solution, Config())
    save_map(folder / "map.mcap", SavedMap(slam.saved(), ()), solution)
    results = load_results(folder)
    assert [(m.kind, m.id) for m in results.graph.landmarks] == [("beacon", n) for n in BEACONS]
    (folder / "map.png").write_bytes(map_png(results))
    away = np.abs(imread(folder / "map.png")[..., :3] - to_rgb(palette.LANDMARK)).max(axis=-1)
    return int((away < 0.01).sum())


def test_a_beacon_is_estimated_drawn_saved_and_used_by_a_later_session(tmp_path):
    slam = WallSlam(Config())
    drive(slam, LAP)
    first = slam.solve().landmarks
    assert_true(first)
    assert draw(slam, tmp_path / "one") > 4 * 20

    later = WallSlam.from_saved(Config(), load_map(tmp_path / "one" / "map.mcap").walls)
    drive(later, [(12, 4), (12, 9), (3, 9)], 8, 2 * 10**18)
    assert later.is_located
    again = later.solve().landmarks
    assert_true(again)
    more = {a.id: b.observations - a.observations for a, b in zip(first, again)}
    assert more[8] > 0
    assert more[11] == 0
    assert draw(later, tmp_path / "two") > 4 * 20


def assert_true(landmarks):
    """Assert that errors are as the covariances say: within 99 % of chi-square, 3 degrees each."""
    errors = [m.position - BEACONS[m.id] for m in landmarks]
    assert len(errors) == 4
    total = sum(e @ np.linalg.solve(m.covariance, e) for e, m in zip(errors, landmarks))
    assert chi2.ppf(0.005, 12) < total < chi2.ppf(0.995, 12)
    assert np.linalg.norm(errors, axis=1).max() < 0.1


def test_beacons_without_loop_closures_correct_the_live_pose():
    """Odometry turns by 12 mrad/m; nothing but beacons tells, while driving as in the end."""
    config = Config()
    config.matching.enabled = config.loops.enabled = config.walls.enabled = False
    slam = WallSlam(config)
    ends = [drive(slam, LAP)[:2], drive(WallSlam(config), LAP, beacons={})[:2]]
    assert np.hypot(*(ends[1] - LAP[-1])) > 0.5
    assert np.hypot(*(ends[0] - LAP[-1])) < 0.2
    assert np.hypot(*(slam.solve().poses[-1, :2] - LAP[-1])) < 0.2
