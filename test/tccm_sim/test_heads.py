"""Robots with depth cameras on heads, and images and clouds of worlds against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from tccm_ros.errors import ConfigError
from tccm_ros.records import CameraInfo, DepthImage, JointSample, PointCloud
from tccm_sim.engine import Simulation
from tccm_sim.heads import ROBOTS, robot, tilt_sign
from tccm_sim.joints import Profile
from tccm_sim.motion import stand
from tccm_sim.options import Options
from tccm_sim.robots import SEGWAY
from tccm_sim.scene import Scene
from tccm_sim.world import World
from tccm_sim.worlds import build_world

rigs = pytest.mark.parametrize("rig", ROBOTS.values(), ids=list(ROBOTS))


def standing(rig, pan=0.0, pitch=0.5, options=None, duration=2.0, **joints):
    """A robot on a floor before a wall 3 m ahead, which looks down by `pitch`."""
    scene = Scene()
    scene.floor_and_ceiling((-10.0, 10.0), (-10.0, 10.0))
    scene.block("wall", (3.0, 3.2), (-10.0, 10.0), (0.0, 3.0), role="wall")
    profiles = {rig.pan_joint: Profile.rest(pan)} if rig.pan_joint else {}
    if rig.pan_joint:
        profiles[rig.tilt_joint] = Profile.rest(tilt_sign(rig) * pitch)
    world = World("standing", scene, rig, stand(duration), profiles | joints)
    return Simulation(world, 0, options or Options(base_tilt=0.0, self_hits=False))


@rigs
def test_heads_look_ahead_and_nod_down(rig):
    simulation = standing(rig, pitch=0.0)
    T = simulation.sensor_poses(rig.camera_frame, np.zeros(1))[0]
    assert T[:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=2e-3)  # the mast of one is askew
    assert 1.0 < T[2, 3] < 1.5
    down = standing(rig).sensor_poses(rig.camera_frame, np.zeros(1))[0]
    assert down[2, 2] == pytest.approx(-np.sin(0.5), abs=2e-3)
    left = standing(rig, pan=0.4, pitch=0.0).sensor_poses(rig.camera_frame, np.zeros(1))[0]
    assert np.arctan2(left[1, 2], left[0, 2]) == pytest.approx(0.4, abs=2e-3)


@rigs
def test_pixels_meet_floor_and_wall_where_rays_do(rig):
    simulation = standing(rig)
    depths, cosines = simulation.exact_depths(rig.camera, 0.5)
    T = simulation.sensor_poses(rig.camera_frame, np.array([0.5]))[0]
    rays = rig.camera.rays / rig.camera.rays[:, 2:]  # z = 1
    directions = rays @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        to_floor = np.where(directions[:, 2] < 0.0, -T[2, 3] / directions[:, 2], np.inf)
        to_wall = np.where(directions[:, 0] > 0.0, (3.0 - T[0, 3]) / directions[:, 0], np.inf)
    assert depths.ravel() == pytest.approx(np.minimum(to_floor, to_wall), abs=1e-9)
    on_floor = to_floor < to_wall
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    expected = np.where(on_floor, -unit[:, 2], unit[:, 0])
    assert cosines.ravel() == pytest.approx(expected, abs=1e-9)


def test_joints_and_images_agree_on_a_moving_head():
    rig = ROBOTS["fetch"]
    nod = Profile(np.array([[0.0, 2.0, 0.0, 0.8]]), 0.0)
    simulation = standing(rig, duration=2.2, head_tilt_joint=nod)
    messages = list(simulation.run())
    images = [m.records[0] for m in messages if isinstance(m.records[0], DepthImage)]
    samples = [m.records[0] for m in messages if isinstance(m.records[0], JointSample)]
    assert len(images) == 4
    at = np.array([s.stamp_ns for s in samples])
    column = samples[0].names.index("head_tilt_joint")
    tilts = np.array([s.positions[column] for s in samples])
    for image in images:
        tilt = np.interp(image.stamp_ns, at, tilts)
        # The camera is 0.0225 m above the tilt axis and 0.055 m before it, at 1.3384 m.
        height = 1.33843 + 0.0225 * np.cos(tilt) - 0.055 * np.sin(tilt)
        middle = np.median(image.depth[118:122, 158:162]) / 1000.0
        ahead = 0.108781 + 0.055 * np.cos(tilt) + 0.0225 * np.sin(tilt)
        with np.errstate(divide="ignore"):
            expected = min(height / np.sin(tilt), (3.0 - ahead) / np.cos(tilt))
        assert middle == pytest.approx(expected, abs=4 * rig.camera.sigma(np.array([expected]))[0])


def test_an_image_comes_with_its_calibration_and_the_robots_own_arm():
    rig = ROBOTS["fetch"]
    messages = list(standing(rig, options=Options(base_tilt=0.0)).run())
    info = next(m for m in messages if isinstance(m.records[0], CameraInfo))
    image = next(m for m in messages if isinstance(m.records[0], DepthImage))
    assert info.log_ns < image.log_ns
    assert info.records[0].stamp_ns == image.records[0].stamp_ns
    assert info.topic == "/head_camera/depth/camera_info"
    assert info.records[0].K[0, 0] == 285.0
    assert info.records[0].image_size == (320, 240)
    bare = next(
        m.records[0].depth for m in standing(rig).run() if isinstance(m.records[0], DepthImage)
    )
    depth = image.records[0].depth
    nearer = (depth > 0) & (depth.astype(int) < bare.astype(int) - 200)
    assert nearer.mean() > 0.005


def test_a_lidar_measures_each_bearing_from_the_base_at_its_own_time():
    options = Options(base_tilt=0.0, self_hits=False, lidar=True, tilt=False)
    simulation = standing(SEGWAY, options=options)
    clouds = [m.records[0] for m in simulation.run() if isinstance(m.records[0], PointCloud)]
    assert len(clouds) == 9
    T = simulation.sensor_poses("lidar", np.zeros(1))[0]
    points = clouds[0].points @ T[:3, :3].T + T[:3, 3]
    ahead = points[points[:, 0] > 0.0]
    off = np.minimum(np.abs(ahead[:, 2]), np.abs(ahead[:, 0] - 3.0))
    assert np.quantile(off, 0.99) < 4 * 0.008
    assert np.median(clouds[0].since_ns) == pytest.approx(0.1e9, rel=0.2)


def test_options_of_a_mount_change_the_truth_and_not_the_description():
    rig = ROBOTS["hsrb"]
    errors = Options(
        base_tilt=0.0, pan_offset=0.03, tilt_offset=0.02, laser_roll=0.01, laser_height=0.05
    )
    plain, wrong = standing(rig), standing(rig, options=errors)
    assert plain.rig.urdf() == wrong.rig.urdf()
    a, b = (s.sensor_poses(rig.camera_frame, np.zeros(1))[0] for s in (plain, wrong))
    assert b[2, 3] - a[2, 3] == pytest.approx(0.05, abs=0.003)
    assert np.arccos((np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2) == pytest.approx(0.01, abs=1e-6)
    sample = next(m.records[0] for m in wrong.run() if isinstance(m.records[0], JointSample))
    reported = dict(zip(sample.names, sample.positions))
    assert reported["head_pan_joint"] == pytest.approx(-0.03, abs=1e-4)
    assert reported["head_tilt_joint"] == pytest.approx(-0.5 - 0.02, abs=1e-4)


def test_unknown_robot_is_an_error_with_the_nearest_name():
    with pytest.raises(ConfigError, match="fetch"):
        robot("fecth")


def test_head_with_camera_and_laser_records_both():
    options = Options(depth_camera=True)
    simulation = Simulation(build_world("flat", options), 0, options)
    assert simulation.rig.tilt is not None
    assert simulation.rig.camera is not None
    assert "depth_camera_optical" in simulation.rig.urdf()
    plain = Simulation(build_world("flat"), 0)
    assert "depth_camera" not in plain.rig.urdf()
    assert replace(simulation.rig, joints=plain.rig.joints).urdf() == plain.rig.urdf()
