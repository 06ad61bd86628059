"""Known errors of a simulated head with a depth camera are recovered."""

from pathlib import Path

import numpy as np
import pytest

from tccm_ros.calibrate.calibration import Calibration, calibrate
from tccm_ros.config.reader import read_config
from tccm_ros.records import JointSample, RobotDescription, TransformSample
from tccm_ros.robot import MountKind, Robot
from tccm_ros.sensors.depth_image import depth_stream
from tccm_sim.engine import Simulation
from tccm_sim.heads import ROBOTS
from tccm_sim.options import Options
from tccm_sim.recording import simulate
from tccm_sim.worlds import build_world

ERRORS = {
    "tilt_offset": 0.04, "laser_roll": 0.02, "laser_height": 0.03, "joint_time_offset": 0.02,
    "pan_offset": 0.03,
}  # fmt: skip

#: Max error: rad, 1, rad, m, s. A tilting laser's of 6 mm noise, twice for the camera's noise.
MAX_ERRORS = {
    "tilt_offset": np.deg2rad(0.1), "tilt_scale": 0.004, "roll": np.deg2rad(0.2), "height": 0.004,
    "joint_time_offset": 0.002, "pan_offset": np.deg2rad(0.2),
}  # fmt: skip


def run(folder: Path, robot: str, **options) -> Calibration:
    settings = {"cycle_period": 2.5, "base_tilt": 0.0, "people": False, "odometry": 0.0} | options
    simulate("room", folder, options=Options(robot=robot, **settings))
    return calibrate(folder, floor_z=0.0)


@pytest.mark.parametrize("robot", ["fetch", "stretch"])
def test_known_errors_of_a_head_are_recovered(robot: str, tmp_path: Path):
    found = run(tmp_path / "bag", robot, **ERRORS)
    expected = {
        "tilt_offset": 0.04, "tilt_scale": 1.0, "roll": 0.02, "height": 0.03,
        "joint_time_offset": 0.02, "pan_offset": 0.03,
    }  # fmt: skip
    assert [q.name for q in found.observability.quantities] == list(expected)
    for quantity in found.observability.quantities:
        error = abs(quantity.value - expected[quantity.name])
        assert quantity.sigma is not None, quantity
        assert error < 3.0 * quantity.sigma, (quantity, error)
        assert error < MAX_ERRORS[quantity.name], (quantity, error)
    # The written file corrects the camera: its tilt joint is named in it.
    (tmp_path / "rig.yaml").write_text(found.yaml())
    config = read_config(tmp_path / "rig.yaml")
    assert config.frames.tilt_joint == ROBOTS[robot].tilt_joint
    assert config.rig.pan_offset == found.rig.pan_offset


def test_without_a_level_laser_the_pan_zero_is_not_estimated(tmp_path: Path):
    found = run(tmp_path / "bag", "fetch", level=False, tilt_offset=0.04)
    by_name = {q.name: q for q in found.observability.quantities}
    assert not by_name["pan_offset"].is_determined
    assert "level laser see" in by_name["pan_offset"].reason
    assert by_name["tilt_offset"].value == pytest.approx(0.04, abs=MAX_ERRORS["tilt_offset"])


@pytest.mark.parametrize("is_named", [True, False])
def test_corrections_count_for_a_camera_whose_tilt_joint_is_named(is_named: bool):
    """The corrected pose is the true one of the simulated robot with these errors."""
    errors = {name: value for name, value in ERRORS.items() if name != "joint_time_offset"}
    options = Options(robot="fetch", base_tilt=0.0, **errors)
    simulation = Simulation(build_world("room", options), 0, options)
    rig = simulation.rig
    config = read_config(None)
    pan = rig.laser_poses("head_pan_link", {}, 1)[0]  # the roll is about the pan joint's origin
    R = np.array([[1, 0, 0], [0, np.cos(0.02), -np.sin(0.02)], [0, np.sin(0.02), np.cos(0.02)]])
    shift = pan[:3, 3] - R @ pan[:3, 3] + [0.0, 0.0, 0.03]
    changed = config.rig.model_copy(
        update={
            "tilt_offset": 0.04, "pan_offset": 0.03,
            "mount_correction": (*shift.tolist(), 0.02, 0.0, 0.0),
        }
    )  # fmt: skip
    frames = config.frames.model_copy(update={"tilt_joint": rig.tilt_joint if is_named else ""})
    config = config.model_copy(update={"rig": changed, "frames": frames})
    stream = depth_stream("depth")
    assert stream.mount is MountKind.ANY
    robot = Robot(config, [stream], expects_odometry=False)
    stamps = []
    for message in simulation.run():
        for record in message.records:
            if isinstance(record, RobotDescription | TransformSample | JointSample):
                kind = {RobotDescription: "robot_description", JointSample: "joint_states"}
                robot.add(kind.get(type(record), "tf_static"), record)
            if isinstance(record, JointSample):
                stamps.append(record.stamp_ns)
        if len(stamps) > 300:
            break
    chain = robot.sensors["depth"].mount.find(rig.camera_frame, final=True)
    at = np.array(stamps[10:-10:20], np.int64)
    expected = np.linalg.inv(simulation.true_poses((at - simulation.start_ns) * 1e-9))
    expected = expected @ simulation.sensor_poses(
        rig.camera_frame, (at - simulation.start_ns) * 1e-9
    )
    off = np.abs(chain.at(at) - expected).max()
    assert off < 1e-3 if is_named else off > 0.02
