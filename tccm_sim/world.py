"""A world: a scene, a robot, and the robot's motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_sim.heads import with_depth_camera, with_lidar
from tccm_sim.imu import ImuModel
from tccm_sim.joints import Profile
from tccm_sim.lasers import Laser
from tccm_sim.motion import Drive, OdometryErrors
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
    if options.lidar:
        rig = with_lidar(rig)
    if options.imu:
        rig = replace(rig, imu=ImuModel())
    tilt = rig.tilt if options.tilt else None
    if tilt is not None:
        tilt = _with_noise(_without_faults(tilt, options), options.sigma, options.quantum)
        if options.tilt_beams is not None:
            step = tilt.time_increment * (tilt.beams - 1) / (options.tilt_beams - 1)
            tilt = replace(tilt, beams=options.tilt_beams, time_increment=step)
    level = _with_noise(_without_faults(rig.level, options), options.level_sigma, None)
    camera, errors, factor = rig.camera, rig.errors, options.odometry
    if camera is not None and not options.faults:
        camera = replace(camera, flying=0.0, grazing=0.0, lost=0.0)
    drift = factor * errors.drift if options.heading_drift is None else options.heading_drift
    errors = OdometryErrors(
        scale=1.0 + factor * (errors.scale - 1.0),
        yaw_scale=1.0 + factor * (errors.yaw_scale - 1.0),
        drift=drift,
        noise=factor * errors.noise,
        yaw_noise=factor * errors.yaw_noise,
    )
    return replace(rig, tilt=tilt, level=level, camera=camera, errors=errors)


def _with_noise(laser: Laser, sigma: float | None, quantum: float | None) -> Laser:
    """Return a laser with another noise and step of its ranges, where given."""
    return replace(
        laser,
        sigma=laser.sigma if sigma is None else sigma,
        quantum=laser.quantum if quantum is None else quantum,
    )


def _without_faults(laser: Laser, options: Options) -> Laser:
    return laser if options.faults else replace(laser, mixed=0.0, lost=0.0, invalid=0.0)
