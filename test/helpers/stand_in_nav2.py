"""A stand-in for Nav2's navigator: NavigateToPose, a plain planner and a plain controller."""

from math import atan2, hypot

import numpy as np
import shapely
from approach_world import ROBOT
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from shapely import Polygon

from tccm_ros.approach.speeds import Speeds
from tccm_ros.geometry import compose2, inverse2, planar, pose_from_quaternion, transform2

AT_M, AT_RAD = 0.2, 0.2
"""As far from the goal as Nav2's SimpleGoalChecker allows, almost."""

LETHAL_M, RIM_M = 0.01, 0.05
"""Distances of the circle around the base from tops: at the least, and at the bends of a way, m."""

NO_WAY = "no valid path found"


class StandInNav2:
    """Drives a simulated base to the goals of the action, around the tops of the furniture.

    Attributes
    ----------
    goals
        Poses (3,) in map that were asked for.
    is_driving
        Whether a goal runs.
    refusal
        Message with which the next goal is aborted, if it is not empty.
    """

    def __init__(self, node, base):
        self._base, self._goal, self._done, self._handle = base, None, None, None
        self.goals: list[np.ndarray] = []
        self.refusal = ""
        self.server = ActionServer(
            node, NavigateToPose, "navigate_to_pose", self._execute,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    @property
    def is_driving(self) -> bool:
        return self._goal is not None

    async def _execute(self, handle):
        goal = handle.request.pose
        p, q = goal.pose.position, goal.pose.orientation
        quaternion = np.array([q.x, q.y, q.z, q.w])
        self.goals.append(planar(pose_from_quaternion(np.array([p.x, p.y, p.z]), quaternion)))
        assert goal.header.frame_id == "map"
        result = NavigateToPose.Result()
        failure = self.refusal
        if not failure:
            self._goal, self._handle, self._done = self.goals[-1], handle, Future()
            failure = await self._done
        if failure:
            result.error_msg, result.error_code = failure, 7
            handle.abort()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.succeed()
        return result

    def _end(self, failure: str = "") -> Speeds:
        done, self._goal, self._done = self._done, None, None
        done.set_result(failure)
        return Speeds()

    def _next(self, here: np.ndarray) -> np.ndarray | None:
        """Return the next bend (2,) of the shortest way to the goal; None without a way.

        The tops are where they are from the base, as in a costmap.
        """
        to_map = compose2(here, inverse2(self._base.truth))
        tops = shapely.union_all([
            Polygon(transform2(to_map, np.asarray(p.top.exterior.coords)))
            for p in self._base.flat.pieces()
        ])  # fmt: skip
        radius = ROBOT.footprint.radius
        lethal = tops.buffer(radius + LETHAL_M, join_style="mitre")
        bends = shapely.get_coordinates(tops.buffer(radius + RIM_M, join_style="mitre"))
        points = np.concatenate([here[None, :2], self._goal[None, :2], bends])
        a, b = np.triu_indices(len(points), 1)
        ends = np.stack([points[a], points[b]], axis=1)
        free = ~shapely.intersects(lethal, shapely.linestrings(ends))
        lengths = np.hypot(*(points[b] - points[a]).T)
        graph = coo_array((lengths[free], (a[free], b[free])), shape=(len(points),) * 2)
        _, before = dijkstra(graph, directed=False, indices=1, return_predecessors=True)
        return points[before[0]] if before[0] >= 0 else None

    def speeds(self) -> Speeds:
        """Return the command of this step; end the goal where it is cancelled or met."""
        if self._handle.is_cancel_requested:
            return self._end()
        here = compose2(self._base.map_odom, self._base.odom)
        is_near = hypot(*(self._goal - here)[:2]) < AT_M
        bend = self._next(here)
        if bend is None:
            return self._end(NO_WAY)
        way, yaw = bend - here[:2], here[2]
        error = (self._goal[2] if is_near else atan2(way[1], way[0])) - yaw
        error = (error + np.pi) % (2 * np.pi) - np.pi
        if is_near and abs(error) < AT_RAD:
            return self._end()
        is_ahead = abs(error) < 0.3 and not is_near
        return Speeds(0.3 if is_ahead else 0.0, float(np.clip(2.0 * error, -0.8, 0.8)))
