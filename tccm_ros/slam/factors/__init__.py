"""The factors of the wall graph, one small class each.

A factor is data plus one method that adds its GTSAM form to a graph. A new kind of landmark is one
class derived from `LandmarkFactor`, in a module here or outside of the package. Variables are named
by `Key`: keyframes and views are spatial poses (``gtsam.Pose3``), walls and surfaces are planes
(``gtsam.OrientedPlane3``). A factor that brings a variable of its own says where it starts by
`initial`.

GTSAM orders the tangent of a pose (roll, pitch, yaw, x, y, z), in the body's frame.
"""

from tccm_ros.slam.factors.building import Building, WallDirection
from tccm_ros.slam.factors.corners import CornerObservation, WallThroughCorner
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import (
    Key,
    building_key,
    corner_key,
    keyframe_key,
    observer_key,
    surface_key,
    view_key,
    wall_key,
)
from tccm_ros.slam.factors.landmarks import LandmarkFactor, landmark_class, register_landmark
from tccm_ros.slam.factors.noise import planar_covariance
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.factors.surfaces import ViewPlane
from tccm_ros.slam.factors.views import BetweenViews, KeyframeView
from tccm_ros.slam.factors.walls import WallObservation

__all__ = [
    "BetweenKeyframes",
    "BetweenViews",
    "Building",
    "CornerObservation",
    "Factor",
    "Key",
    "KeyframeView",
    "LandmarkFactor",
    "Planar",
    "PriorPose",
    "ViewPlane",
    "WallDirection",
    "WallObservation",
    "WallThroughCorner",
    "building_key",
    "corner_key",
    "keyframe_key",
    "landmark_class",
    "observer_key",
    "planar_covariance",
    "register_landmark",
    "surface_key",
    "view_key",
    "wall_key",
]
