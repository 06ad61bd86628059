"""The truth files against what is known of the worlds by hand."""

import numpy as np
import pytest

from tccm_sim.engine import Simulation
from tccm_sim.motion import Waypoint, drive, stand
from tccm_sim.options import Options
from tccm_sim.robots import SEGWAY, UPSIDE_DOWN
from tccm_sim.scene import Motion, Scene
from tccm_sim.truth import map_from_world, surfaces, trajectory, walls
from tccm_sim.world import World
from tccm_sim.worlds import build_world


def simulation_of(scene, path=None, rig=SEGWAY):
    return Simulation(World("test", scene, rig, path or stand(1.0)))


def rows(truth, key="surfaces"):
    return {row["label"]: row for row in truth[key]}


def test_an_l_of_two_boxes_is_one_surface():
    scene = Scene()
    scene.block("bar", (0, 2), (0, 0.6), (0, 0.9), surface="bar")
    scene.block("bar", (0, 0.6), (0.6, 2), (0, 0.9), surface="bar")
    (row,) = surfaces(simulation_of(scene))["surfaces"]
    assert (row["id"], row["label"], row["height"]) == (0, "bar", 0.9)
    assert row["area"] == pytest.approx(2 * 0.6 + 1.4 * 0.6)
    ring = np.array(row["boundary"])
    assert len(ring) == 6  # open, and without the seam
    x, y = ring[:, 0], ring[:, 1]
    signed = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert signed == pytest.approx(row["area"])  # counter-clockwise seen from above


def test_furniture_on_a_top_is_cut_out_and_objects_are_not():
    scene = Scene()
    scene.block("bar", (0, 2), (0, 1), (0, 0.9), surface="bar")
    scene.block("stove", (0.5, 1.0), (0.2, 0.7), (0.9, 0.95), surface="stove")
    scene.box("mug", (0.1, 0.2, 0.1), (1.5, 0.5, 0.95), (0, 0, 0.3), role="object")
    truth = surfaces(simulation_of(scene))
    assert rows(truth)["bar"]["area"] == pytest.approx(2.0 - 0.25)
    assert len(rows(truth)["bar"]["holes"]) == 1
    assert rows(truth)["stove"]["height"] == pytest.approx(0.95)
    (mug,) = truth["objects"]
    assert mug["center"] == pytest.approx([1.5, 0.5, 0.95])
    assert mug["size"] == pytest.approx([0.1, 0.2, 0.1])
    assert mug["yaw"] == pytest.approx(0.3)


def test_moved_furniture_is_at_its_last_pose_and_removed_furniture_is_gone():
    scene = Scene()
    away = Motion.through([(0.2, 0, 0, 0), (0.5, 1.0, -2.0, 0)])
    scene.table("table", (1, 1), 0.7, (1.0, 0.0), motion=away)
    scene.table("stool", (0.4, 0.4), 0.4, (3.0, 0.0), span=(-np.inf, 0.5))
    truth = surfaces(simulation_of(scene))
    assert rows(truth)["table"]["centroid"] == pytest.approx([2.0, -2.0, 0.7])
    assert list(rows(truth)) == ["table"]
    assert list(rows(truth, "gone")) == ["stool"]


def test_the_map_frame_is_the_first_base_pose_without_roll_and_pitch():
    """By hand: the base starts at (2, 1) heading +y, so world x is map -y, and it is tilted."""
    scene = Scene()
    scene.block("box", (1.5, 2.5), (3.0, 4.0), (0, 0.5), surface="box")
    scene.wall("wall", (5.0, -5.0), (5.0, 5.0))
    path = drive([Waypoint(2, 1, np.pi / 2, 0.5), Waypoint(2, 2)])
    simulation = simulation_of(scene, path, UPSIDE_DOWN)
    truth = surfaces(simulation)
    assert truth["floor_z"] == pytest.approx(-0.12)
    assert truth["surfaces"][0]["centroid"] == pytest.approx([2.5, 0.0, 0.38], abs=1e-6)
    assert truth["surfaces"][0]["normal"] == [0, 0, 1]
    (wall,) = walls(simulation)["walls"]
    assert wall["rho"] == pytest.approx(3.0)
    assert wall["phi"] == pytest.approx(-np.pi / 2)
    assert np.array(wall["endpoints"])[:, 1] == pytest.approx([-3.0, -3.0])
    first = np.array(next(iter(trajectory(simulation))).split(), float)
    assert first[0] == 1.6e9
    assert first[1:4] == pytest.approx([0, 0, 0])
    assert np.abs(first[4:6]).max() > 0  # roll and pitch stay in the trajectory
    assert first[6] == pytest.approx(0, abs=1e-6)
    assert map_from_world(simulation)[2, :3] == pytest.approx([0, 0, 1])


def test_the_true_trajectory_is_that_of_the_drive():
    path = drive([Waypoint(0, 0, 0.0), Waypoint(2, 0)], base_tilt=0.0)
    scene = Scene()
    scene.floor_and_ceiling((-1, 1), (-1, 1))
    lines = np.array([line.split() for line in trajectory(simulation_of(scene, path))], float)
    assert lines[-1, 1] == pytest.approx(
        np.interp(lines[-1, 0] - 1.6e9, path.times, path.states[:, 0]), abs=1e-6
    )
    assert np.diff(lines[:, 0]) == pytest.approx(0.02, abs=1e-6)


def test_the_truth_of_the_flat_has_the_surfaces_of_its_plan():
    truth = surfaces(Simulation(build_world("flat")))
    found = rows(truth)
    assert len(truth["surfaces"]) == 20
    assert all(row["area"] >= 0.1 for row in truth["surfaces"])
    assert found["counter"]["area"] == pytest.approx(2.4 * 0.6 + 1.5 * 0.6 - 0.6 * 0.5)
    assert found["stove"]["height"] - found["counter"]["height"] == pytest.approx(0.05)
    # The robot starts at (2.6, 1.7) and looks along -x: the sideboard is behind it, to its left.
    assert found["sideboard"]["centroid"] == pytest.approx([2.6 - 6.7, 1.7 - 0.225, 0.8])
    assert len(truth["objects"]) == 22
    assert all(row["area"] < 0.1 or row["height"] > 1.6 for row in truth["others"])


def test_the_truth_of_worlds_with_changes_has_gone_surfaces():
    walkthrough = surfaces(Simulation(build_world("walkthrough")))
    assert {o["name"] for o in walkthrough["objects"]} == {"box that stays", "box that comes"}
    assert list(rows(walkthrough, "gone")) == ["stool"]
    moved = surfaces(Simulation(build_world("moved", Options(base_tilt=0.0))))
    assert set(rows(moved)) == {"moved table", "cupboard", "crate"}
    assert rows(moved)["moved table"]["centroid"] == pytest.approx([2.4, 0.6, 0.7])
