"""The typed records that processors take and give.

Stamps are integer nanoseconds; arrays have the dtype that the message has, so that a record made
from a bag, from a live message or by the pipeline is the same record. Records are immutable by
convention: whoever holds one may keep it.
"""

from tccm_ros.records.cycle import (
    ObjectBoxes,
    PlaneKind,
    PlaneRecord,
    SensorKind,
    SurfaceCloud,
    TabletopObject,
    ViewIntervals,
)
from tccm_ros.records.detections import Detections, Hypothesis
from tccm_ros.records.events import (
    START_OF_TIME,
    Event,
    MapReset,
    Posed,
    PosedScan,
    RollPitch,
    SelfShapes,
    StreamComplete,
    TiltAngle,
)
from tccm_ros.records.rooms import Room
from tccm_ros.records.sensors import (
    CameraImage,
    CameraInfo,
    DepthImage,
    Imu,
    JointSample,
    Odometry,
    PointCloud,
    RobotDescription,
    Scan,
    TransformSample,
)
from tccm_ros.records.signs import SIGN, RefusedSign, Sign, SignSighting
from tccm_ros.records.solution import (
    EdgeState,
    FormerPlace,
    Keyframe,
    LabelCorrection,
    Landmark,
    LandmarkObservation,
    Loop,
    PoseGuess,
    ScanPose,
    Surface,
    SurfaceEdge,
    SurfaceShape,
    SurfaceSighting,
    Wall,
)

__all__ = [
    "SIGN",
    "START_OF_TIME",
    "CameraImage",
    "CameraInfo",
    "DepthImage",
    "Detections",
    "EdgeState",
    "Event",
    "FormerPlace",
    "Hypothesis",
    "Imu",
    "JointSample",
    "Keyframe",
    "LabelCorrection",
    "Landmark",
    "LandmarkObservation",
    "Loop",
    "MapReset",
    "ObjectBoxes",
    "Odometry",
    "PlaneKind",
    "PlaneRecord",
    "PointCloud",
    "PoseGuess",
    "Posed",
    "PosedScan",
    "RefusedSign",
    "RobotDescription",
    "RollPitch",
    "Room",
    "Scan",
    "ScanPose",
    "SelfShapes",
    "SensorKind",
    "Sign",
    "SignSighting",
    "StreamComplete",
    "Surface",
    "SurfaceCloud",
    "SurfaceEdge",
    "SurfaceShape",
    "SurfaceSighting",
    "TabletopObject",
    "TiltAngle",
    "TransformSample",
    "ViewIntervals",
    "Wall",
]
