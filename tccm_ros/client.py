"""`SurfaceMapClient`: the surface map for Python nodes, as plain objects.

It needs `tccm_interfaces`, and the node that it is given spun by its owner. What knows ROS is in
`tccm_ros.nodes.map_client`; this is the name under which programs import it.
"""

from tccm_ros.errors import QuestionError
from tccm_ros.nodes.map_client import SurfaceMapClient
from tccm_ros.nodes.map_records import (
    BoxState,
    Found,
    MapCompartment,
    MapEvent,
    MapFoundObject,
    MapLocalisation,
    MapObject,
    MapPlacement,
    MapSign,
    MapSurface,
    MapWall,
    SavedMap,
)

__all__ = [
    "BoxState",
    "Found",
    "MapCompartment",
    "MapEvent",
    "MapFoundObject",
    "MapLocalisation",
    "MapObject",
    "MapPlacement",
    "MapSign",
    "MapSurface",
    "MapWall",
    "QuestionError",
    "SavedMap",
    "SurfaceMapClient",
]
