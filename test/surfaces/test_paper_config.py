"""config/paper.yaml: the second paper's wall SLAM and surfaces as one named configuration."""

from pathlib import Path

import numpy as np
import plan
from room import Board, Room
from surface_maps import above_floor

from tccm_ros.baselines.line_ransac import label_by_ransac
from tccm_ros.config.reader import read_config
from tccm_ros.mapping.surface_slam import SurfaceSlam

PAPER = read_config(Path(__file__).resolve().parents[2] / "config" / "paper.yaml")
LAP = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (4, 0)]


def test_paper_config_enables_only_published_methods():
    """III.A: odometry and walls; registration of views is the paper's future work."""
    assert not PAPER.matching.enabled
    assert not PAPER.loops.enabled
    assert not PAPER.surfaces.registration
    assert PAPER.walls.discount == 1.0
    assert PAPER.lines.extractor == "ransac"
    assert PAPER.surfaces.segmentation == "seed"


def test_walls_and_odometry_alone_correct_a_lap():
    """RANSAC walls as landmarks: 0.5 m of odometry's error become less than 5 cm."""
    run = plan.drive(plan.ring(), plan.route(LAP), seed=3, drift=0.003)
    slam = SurfaceSlam(PAPER)
    for scan in run.scans:
        slam.wall_slam.add_scan(scan)
    solution = slam.solve().graph
    odometry = np.stack([plan.planar(scan.T_odom_base[0]) for scan in run.scans])
    assert plan.errors(run.truth, odometry)[0] > 0.4
    assert plan.errors(run.truth, solution.poses)[0] < 0.05
    assert not solution.loops
    assert len(solution.walls) >= 6


def test_lines_are_those_of_ransac():
    walls = SurfaceSlam(PAPER).wall_slam
    beams = np.column_stack((np.full(50, 2.0), np.linspace(-1.0, 1.0, 50)))
    beams += np.random.default_rng(0).normal(0.0, 0.02, beams.shape)
    np.testing.assert_array_equal(walls.label(beams, PAPER), label_by_ransac(beams, PAPER))


def test_surfaces_are_merged_as_published():
    """A hob 4 cm above a counter is one with it, whatever the heights."""
    counter, hob = Board(1.4, 0.0, 0.6, 2.0, 0.90), Board(1.4, 0.4, 0.5, 0.5, 0.94)
    slam = SurfaceSlam(PAPER)
    run = plan.drive(plan.box(-3, -3, 4, 3), np.zeros((1, 3)), beams=361)
    slam.wall_slam.add_scan(run.scans[0])
    for item in Room([counter, hob]).look((0.0, 0.0, 0.0), int(run.stamps_ns[0])):
        slam.add(item)
    assert len(above_floor(slam.solve().mapped)) == 1
