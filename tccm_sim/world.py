"""A world: a scene, a robot, and the robot's motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_sim.accelerometers import Accelerometer
from tccm_sim.gyros import Gyro
from tccm_sim.heads import with_colour_camera, with_depth_camera, with_lidar
from tccm_sim.joints import Profile
from tccm_sim.lasers import Laser
from tccm_sim.motion import Drive
from tccm_sim.options import Options
from tccm_sim.panels import Panel
from tccm_sim.rigs import Rig
from tccm_sim.scene import Scene


@dataclass(frozen=True, eq=False)
class Room:
    """A room of a world.

    Attributes
    ----------
    name
        Number on its door sign, or another name.
    boundary
        float64 (N, 2), open ring of its walls' faces in the world, m.
    """

    name: str
    boundary: Float64


@dataclass(frozen=True)
class World:
    """The input of a simulation.

    Attributes
    ----------
    name
        Name on the command line.
    scene
        Its solids.
    rig
        The robot as in its description.
    drive
        Its true motion.
    joints
        True positions over time by joint name; the other joints rest at zero.
    tilt_windows
        float64 (W, 2), start and end of the times in which the tilting laser publishes, s.
    panels
        Pictures on its walls.
    rooms
        Its rooms, if defined.
    """

    name: str
    scene: Scene
    rig: Rig
    drive: Drive
    joints: dict[str, Profile] = field(default_factory=dict)
    tilt_windows: Float64 = field(default_factory=lambda: np.array([[-np.inf, np.inf]]))
    panels: tuple[Panel, ...] = ()
    rooms: tuple[Room, ...] = ()

    @property
    def duration(self) -> float:
        """Time of the last sample of the drive, s."""
        return float(self.drive.times[-1])


Builder = Callable[[Options], World]


def with_options(rig: Rig, options: Options) -> Rig:
    """Return the rig with the options for its sensors and its odometry."""
    if options.depth_camera:
        rig = with_depth_camera(rig)
    if options.colour_camera and rig.colour_camera is None:
        rig = with_colour_camera(rig)
    if options.lidar:
        rig = with_lidar(rig)
    if options.imu:
        rig = replace(rig, gyro=Gyro(), accelerometer=Accelerometer())
    tilt = rig.tilt if options.tilt else None
    level, camera, errors = rig.level, rig.camera, rig.errors
    if tilt is not None:
        tilt = _tilting_with_options(tilt, options)
    if options.level_sigma is not None:
        level = replace(level, sigma=options.level_sigma)
    if not options.faults:
        level = replace(level, mixed=0.0, lost=0.0, invalid=0.0)
        camera = camera and replace(camera, flying=0.0, grazing=0.0, lost=0.0)
    errors = replace(
        errors,
        scale=1.0 + options.odometry * (errors.scale - 1.0),
        yaw_scale=1.0 + options.odometry * (errors.yaw_scale - 1.0),
        drift=options.odometry * errors.drift,
        noise=options.odometry * errors.noise,
        yaw_noise=options.odometry * errors.yaw_noise,
    )
    if options.heading_drift is not None:
        errors = replace(errors, drift=options.heading_drift)
    return replace(rig, tilt=tilt, level=level, camera=camera, errors=errors)


def _tilting_with_options(tilt: Laser, options: Options) -> Laser:
    if options.sigma is not None:
        tilt = replace(tilt, sigma=options.sigma)
    if options.quantum is not None:
        tilt = replace(tilt, quantum=options.quantum)
    if options.tilt_beams is not None:
        scan_duration = tilt.time_increment * (tilt.beams - 1)
        step = scan_duration / (options.tilt_beams - 1)
        tilt = replace(tilt, beams=options.tilt_beams, time_increment=step)
    if options.tilt_period is not None:
        tilt = replace(tilt, period=options.tilt_period)
    if not options.faults:
        tilt = replace(tilt, mixed=0.0, lost=0.0, invalid=0.0)
    return tilt
