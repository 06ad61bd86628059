"""Services ~/resolve_name and ~/set_name of approach_node: spots by name, on the present map."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from tccm_ros.approach.floor import Floor
from tccm_ros.approach.names import NamedSpot, check_name, read_names, write_names
from tccm_ros.approach.settings import Goal, RobotBase, Surroundings
from tccm_ros.approach.standing import standing_poses
from tccm_ros.arrays import Float64
from tccm_ros.errors import MotionError, RequestError, suggest
from tccm_ros.geometry import inverse2, planar, spatial, transform2
from tccm_ros.nodes.clients.requests import stamped_point
from tccm_ros.nodes.interfaces import offer_service
from tccm_ros.ros.map_records import MapSurface
from tccm_ros.ros.types import MessageTypes, pose_message

MAX_BASE_POSES = 10
"""Maximum number of base poses in one response. Chosen."""


class NoSurfaceError(RequestError):
    """No surface of the map meets the conditions of a goal or a name."""


class SpotNames:
    """Resolves names of spots, and keeps them in a file.

    Parameters
    ----------
    node, types
        Node that offers the services, and its message classes.
    path
        Returns the path of the file.
    find_surface
        Coroutine that returns the first surface that meets a SurfaceFilter.
    plan
        Returns the base, the goal and the map around a surface, of a goal of ApproachSurface.
    in_map
        Returns a geometry_msgs/PointStamped as float64 (2,) in map.
    map_frame
        Name of the map's frame.
    """

    def __init__(
        self,
        node: Node,
        types: MessageTypes,
        path: Callable[[], Path],
        find_surface: Callable[[Any], Awaitable[MapSurface]],
        plan: Callable[[Any, MapSurface], tuple[RobotBase, Goal, Surroundings]],
        in_map: Callable[[Any], Float64],
        map_frame: str,
    ):
        self._types, self._path, self._map_frame = types, path, map_frame
        self._find_surface, self._plan, self._in_map = find_surface, plan, in_map
        self._goal = import_module("tccm_interfaces.action").ApproachSurface.Goal
        # Both wait for a response of the map's node, which the node's own group would hold back.
        group = ReentrantCallbackGroup()
        for kind, name, callback in (
            ("ResolveName", "~/resolve_name", self._resolve),
            ("SetName", "~/set_name", self._write),
        ):
            offer_service(node, kind, name, callback, callback_group=group)

    def spot(self, name: str) -> NamedSpot:
        """Return the spot of a name.

        Raises
        ------
        RequestError, ConfigError
            For an unknown name, and for a file that cannot be read.
        """
        names = read_names(self._path())
        if name not in names:
            raise RequestError(f"no spot is called {name!r}{suggest(name, names)}")
        return names[name]

    async def _resolve(self, request: Any, response: Any) -> str:
        spot = self.spot(request.name)
        surface = await self._find_surface(filter_of(spot))
        place = place_on(surface, spot)
        goal = self._goal(spot=stamped_point(place, self._map_frame))
        if spot.side is not None:
            goal.has_side, goal.side = True, spot.side
        poses = self._base_poses(*self._plan(goal, surface))
        response.surface, response.base_poses = surface.message, poses
        response.spot = stamped_point(place, self._map_frame)
        response.spot.point.z = float(surface.T_map_surface[2, 3])
        if poses:
            return ""
        return "no free floor around it is within the arm's length of the spot"

    def _base_poses(self, robot: RobotBase, goal: Goal, around: Surroundings) -> list[Any]:
        floor = Floor(around.grid, [*around.overhangs, goal.target.outline])
        poses = standing_poses(
            goal.target,
            floor,
            robot.footprint,
            goal.gap,
            goal.staging,
            goal.max_distance,
            goal.spot,
            goal.side,
        )
        return [
            self._types.make(
                "tccm_interfaces/msg/BasePose",
                pose=pose_message(self._types, spatial(found.pose)),
                distance=float(found.distance),
                clearance=float(goal.gap),
            )
            for found in poses[:MAX_BASE_POSES]
        ]

    async def _write(self, request: Any, _: Any) -> str:
        """Write or remove a name; return a sentence with its previous meaning."""
        check_name(request.name)
        found = None if request.forget else await self._spot_of(request)
        names = read_names(self._path())  # others may have been written meanwhile
        before = names.pop(request.name, None)
        if found is not None:
            names[request.name] = found
        elif before is None:
            raise RequestError(f"no spot is called {request.name!r}{suggest(request.name, names)}")
        write_names(self._path(), names)
        return "a new name" if before is None else f"it was {before.as_dict()}"

    async def _spot_of(self, request: Any) -> NamedSpot:
        """Return the spot of a request: bound to an id, or to its conditions if it names no id."""
        wanted = request.filter
        conditions = {
            "labels": tuple(wanted.labels),
            "near_sign": wanted.near_sign,
            "text": wanted.text,
        }
        surface = await self._find_surface(wanted)
        spot = None
        if request.spot.header.frame_id:
            local = transform2(
                inverse2(planar(surface.T_map_surface)), self._in_map(request.spot)[None]
            )[0]
            spot = (round(float(local[0]), 4), round(float(local[1]), 4))
        side = float(request.side) if request.has_side else None
        if side is not None and not np.isfinite(side):
            raise MotionError(f"side is {side:g}; expected an angle in rad")
        if wanted.ids or not any(conditions.values()):
            return NamedSpot(ids=(surface.id,), spot=spot, side=side)
        return NamedSpot(**conditions, spot=spot, side=side)


def filter_of(spot: NamedSpot) -> Any:
    """Return the conditions of a name as a tccm_interfaces/SurfaceFilter."""
    return import_module("tccm_interfaces.msg").SurfaceFilter(
        ids=list(spot.ids), labels=list(spot.labels), near_sign=spot.near_sign, text=spot.text
    )


def place_on(surface: MapSurface, spot: NamedSpot) -> Float64:
    """Return the present position of a spot, float64 (2,), in map."""
    local = np.array([spot.spot or (0.0, 0.0)])
    place: Float64 = transform2(planar(surface.T_map_surface), local)[0]
    return place
