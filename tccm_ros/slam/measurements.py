"""Measurements of a drive beside its level scans."""

from __future__ import annotations

from dataclasses import dataclass, field

from tccm_ros.records import LandmarkObservation
from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement
from tccm_ros.slam.base_attitude import AttitudeTrack, RollPitchTrack
from tccm_ros.slam.external_poses import MapOdomTrack
from tccm_ros.slam.trajectory import OdometryTrack


@dataclass(frozen=True, slots=True)
class Measurements:
    """Measurements of a drive beside its level scans; `WallSlam` adds to them.

    Attributes
    ----------
    odometry, attitudes
        Poses of the base by odometry: planar, and height, roll and pitch.
    map_odom
        Poses of the odometry frame by an external localisation.
    roll_pitch
        Roll and pitch of the base by its IMU.
    landmarks, signs, pictures
        Observations of landmarks, measured door signs, and pictures searched for signs, in the
        order of arrival.
    """

    odometry: OdometryTrack = field(default_factory=OdometryTrack)
    attitudes: AttitudeTrack = field(default_factory=AttitudeTrack)
    map_odom: MapOdomTrack = field(default_factory=MapOdomTrack)
    roll_pitch: RollPitchTrack = field(default_factory=RollPitchTrack)
    landmarks: list[LandmarkObservation] = field(default_factory=list)
    signs: list[SignMeasurement] = field(default_factory=list)
    pictures: list[SearchedPicture] = field(default_factory=list)
