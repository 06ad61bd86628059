"""Simulated robots with depth cameras and lidars map what is there, judged by the truth."""

from pathlib import Path

import numpy as np
import pytest

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.writer import BagWriter
from tccm_ros.config.reader import read_config
from tccm_ros.evaluate.score import score_trajectory
from tccm_ros.evaluate.surfaces import score_surfaces
from tccm_ros.replay.replay import replay
from tccm_sim.heads import ROBOTS
from tccm_sim.options import Options
from tccm_sim.recording import simulate

ROOT = Path(__file__).resolve().parents[2]
FILES = {"fetch": "fetch", "hsrb": "hsr", "stretch": "stretch", "tiago": "tiago"}


def mapped(folder: Path, world: str, config=None, **options):
    """Simulate a world, replay it and score the surfaces against its truth."""
    simulate(world, folder / "bag", options=Options(**options))
    summary = replay(folder / "bag", folder / "map", config or read_config(), pictures=False)
    return score_surfaces(folder / "map" / "surfaces.json", folder / "bag" / "truth.json"), summary


def test_each_robot_with_a_head_has_a_configuration():
    assert set(FILES) == set(ROBOTS)
    assert {p.stem for p in (ROOT / "config" / "robots").iterdir()} == set(FILES.values())


@pytest.mark.parametrize("robot", FILES)
def test_configuration_of_a_robot_maps_its_recording(robot, tmp_path):
    config = read_config(ROOT / "config" / "robots" / f"{FILES[robot]}.yaml")
    rig = ROBOTS[robot]
    assert config.frames.base == rig.base
    assert config.frames.tilt_joint == rig.tilt_joint
    assert rig.topics.depth == "/" + config.sensors.depth_images[0]
    score, _ = mapped(tmp_path, "situation_a", config, robot=robot, duration=8.0)
    assert score.found == len(score.matches) == 1, score.text()
    assert not score.false, score.text()
    assert abs(score.matches[0].height_error) < 0.006, score.text()


def test_the_bundled_kitchen_is_mapped_with_topics_taken_by_their_types(tmp_path):
    bag = ROOT / "bags" / "rgbd_kitchen"
    summary = replay(bag, tmp_path / "map", read_config(), pictures=False)
    taken = {line.split()[0] for line in summary.found_topics}
    assert taken == {"/head_camera/depth/image_raw/compressedDepth", "/base_scan"}
    score = score_surfaces(tmp_path / "map" / "surfaces.json", bag / "truth.json")
    assert score.found == len(score.matches) == 9, score.text()
    assert not score.false, score.text()
    # sigma of a depth at 2 m is 6 mm; hundreds of pixels are fitted.
    assert all(abs(m.height_error) < 0.005 for m in score.matches), score.text()
    trajectory = score_trajectory(tmp_path / "map" / "trajectory.tum", bag / "truth.tum")
    errors = trajectory.errors["absolute, aligned"].translation
    assert np.sqrt(np.mean(errors**2)) < 0.01


def test_a_lidar_alone_maps_the_tables_that_its_rings_see(tmp_path):
    score, _ = mapped(tmp_path, "moved", tilt=False, lidar=True, people=False, always=True)
    assert not score.false, score.text()
    assert score.found >= 1, score.text()
    assert all(abs(m.height_error) < 0.01 for m in score.matches if m.is_found), score.text()


def lasers_of(bag: Path, out: Path) -> Path:
    """Write the scans of a bag alone."""
    with BagReader(bag) as reader, BagWriter(out) as writer:
        types = {topic: "sensor_msgs/msg/LaserScan" for topic in ("/scan", "/tilt_scan")}
        for message in reader.messages(types):
            writer.write(message.topic, types[message.topic], message.log_ns, message.data)
    return out


def test_a_depth_camera_beside_the_tilting_laser_maps_the_flat_no_worse(tmp_path):
    """The laser alone finds 20 of 20 in bags/flat (test_replay.py).

    A simulation with the camera has the same scans: those of the bundled bag are taken.
    """
    flat, camera = ROOT / "bags" / "flat", Options(depth_camera=True, tilt=False, level=False)
    simulate("flat", tmp_path / "camera", seed=1, options=camera)
    scans = lasers_of(flat, tmp_path / "scans")
    replay([tmp_path / "camera", scans], tmp_path / "map", read_config(), pictures=False)
    score = score_surfaces(tmp_path / "map" / "surfaces.json", flat / "truth.json")
    assert score.found == len(score.matches) == 20, score.text()
    assert not score.false, score.text()
    assert all(abs(m.height_error) < 0.006 for m in score.matches), score.text()
