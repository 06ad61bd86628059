"""Options of a simulation."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tccm_ros.errors import ConfigError, suggest

Vector = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]

RENAMED = {"sweep_period": "cycle_period", "sweep_limits": "tilt_limits", "lean": "base_tilt"}
"""Options renamed after release 0.1; release 0.2 reads both names and warns."""

LOG = logging.getLogger(__name__)


class Options(BaseModel):
    """Variations of a world; the defaults give the world as it is.

    Each field has its unit in its description.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    sigma: float | None = Field(None, ge=0, description="range noise of the tilting laser, m")
    level_sigma: float | None = Field(None, ge=0, description="range noise of the level laser, m")
    quantum: float | None = Field(None, ge=0, description="step of the tilting laser's ranges, m")
    faults: bool = Field(True, description="mixed pixels, lost and invalid returns")
    tilt_beams: int | None = Field(None, ge=2, description="beams of the tilting laser")
    cycle_period: float | None = Field(None, gt=0, description="time of one tilt cycle, s")
    tilt_limits: tuple[float, float] | None = Field(
        None, description="tilt at both ends of a tilt cycle, rad"
    )
    tilt: bool = Field(True, description="there is a tilting laser")
    level: bool = Field(True, description="there is a level laser")
    depth_camera: bool = Field(False, description="a fixed depth camera, too")
    alike: bool = Field(False, description="all rooms of the office are furnished alike")
    lidar: bool = Field(False, description="a spinning lidar on a mast, too")
    imu: bool = Field(False, description="an IMU in the base, too")
    robot: str | None = Field(
        None, description="a robot with a head: fetch, hsrb, stretch or tiago"
    )
    self_hits: bool = Field(True, description="the lasers see the robot's own body")
    always: bool = Field(False, description="scan with the tilting laser while driving, too")
    duration: float | None = Field(None, gt=0, description="time of a standing robot, s")
    laps: int = Field(1, ge=1, le=100_000, description="rounds of the route")
    yaw: float = Field(0.0, description="yaw of a situation's subject, rad")
    pitch: float = Field(0.0, description="pitch of a situation's subject, rad")
    translation: Vector = Field((0.0, 0.0, 0.0), description="shift of a situation's subject, m")
    people: bool = Field(True, description="people walk where the world has them")
    clutter: int = Field(0, ge=0, le=1000, description="boxes on the floor")
    ramp: bool = Field(False, description="a part of the floor that slopes by 4 deg")
    base_tilt: float = Field(1.0, ge=0, description="factor of the base's roll and pitch")
    stop_tilt: float = Field(
        0.0,
        ge=0,
        description="standard deviation of more roll and pitch of the base at a stop, rad",
    )
    odometry: float = Field(1.0, ge=0, description="factor of the errors of wheel odometry")
    heading_drift: float | None = Field(None, description="of the odometry, rad/m")
    tilt_offset: float = Field(0.0, description="true tilt = tilt_scale * reported + this, rad")
    tilt_scale: float = Field(1.0, gt=0, description="see tilt_offset")
    pan_offset: float = Field(0.0, description="true pan of a head = reported + this, rad")
    laser_roll: float = Field(0.0, description="true roll of the mount of the joints, rad")
    laser_height: float = Field(0.0, description="the mount of the joints is this much higher, m")
    level_error: Vector6 = Field((0, 0, 0, 0, 0, 0), description="added to the level laser's mount")
    joint_time_offset: float = Field(0.0, description="joint stamps come this much too early, s")
    publish_tf: bool = Field(False, description="odometry and joints on /tf, too")
    description: bool = Field(True, description="publish the robot description")


def options_from_settings(settings: Mapping[str, str]) -> Options:
    """Return the options of ``key=value`` pairs; tuples are written with commas.

    Raises
    ------
    ConfigError
        For an option that does not exist or a value that is out of range.
    """
    values: dict[str, object] = {}
    for given, text in settings.items():
        key = RENAMED.get(given, given)
        if key != given:
            LOG.warning("simulator option '%s' is called '%s' now", given, key)
        if key not in Options.model_fields:
            raise ConfigError(f"no simulator option '{key}'{suggest(key, Options.model_fields)}")
        values[key] = tuple(text.split(",")) if "," in text else text
    try:
        return Options.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"simulator option {name}: {first['msg'].lower()}") from None
