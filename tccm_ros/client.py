"""`SurfaceMapClient`: client of the surface map for Python nodes, with plain objects as results.

It needs `tccm_interfaces`, and its owner must spin the node passed to it. The implementation is in
`tccm_ros.nodes.clients.map_client`; import it from this module.
"""

from tccm_ros.errors import RequestError
from tccm_ros.nodes.clients.map_client import SurfaceMapClient
from tccm_ros.ros.map_records import (
    BoxState,
    Found,
    MapApproach,
    MapCompartment,
    MapEvent,
    MapFoundObject,
    MapLocalisation,
    MapObject,
    MapPlacement,
    MapSign,
    MapSpot,
    MapSurface,
    MapWall,
    SavedMapInfo,
)

SavedMap = SavedMapInfo
"""Previous name of `SavedMapInfo`."""

__all__ = [
    "BoxState",
    "Found",
    "MapApproach",
    "MapCompartment",
    "MapEvent",
    "MapFoundObject",
    "MapLocalisation",
    "MapObject",
    "MapPlacement",
    "MapSign",
    "MapSpot",
    "MapSurface",
    "MapWall",
    "RequestError",
    "SavedMap",
    "SavedMapInfo",
    "SurfaceMapClient",
]
