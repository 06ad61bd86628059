"""State machine of one approach: look, stage, close in, verify."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import shapely
from shapely import Point, Polygon

from tccm_ros.approach.drive import AT_LEG_M, Driver, LegDrive, close_in, pose_behind
from tccm_ros.approach.edge import MeasuredEdge, measured_edge
from tccm_ros.approach.floor import Floor
from tccm_ros.approach.guard import Obstacles
from tccm_ros.approach.locating import is_elsewhere, is_passed, locate, top_points
from tccm_ros.approach.missing_input import missing_input
from tccm_ros.approach.navigator import Navigator
from tccm_ros.approach.outcome import Outcome, Phase, Reason
from tccm_ros.approach.readings import Readings, TopCycle
from tccm_ros.approach.settings import Goal, RobotBase, Surroundings
from tccm_ros.approach.speeds import STOP, Speeds
from tccm_ros.approach.standing import StandingPose, standing_poses
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.geometry import compose2, inverse2, transform2, wrap_angle

EDGE_CYCLES = 3
"""An edge is fitted to this many newest tilt cycles: their scan lines interleave."""

CLOSING_SPEED = 0.5
"""Fraction of the velocity limit on the straight motion up to the edge. Chosen."""

REPLAN_DISTANCE_M, REPLAN_ANGLE_RAD = 0.10, math.radians(8.0)
"""The path is replanned where the surface is further than this from its pose at the last plan;
smaller errors are corrected while driving."""

MOVED_M, MOVED_RAD = 0.05, math.radians(3.0)
"""A surface this far from its pose in the map has moved: twice the localisation error."""

MAX_PLANS = 6
"""Maximum number of plans for one goal. Chosen."""

MAX_CORRECTIONS = 4
"""Maximum number of correcting motions and repeated measurements after a verification. Chosen."""

MAX_GAP_ERROR_M, MAX_YAW_ERROR_RAD = 0.02, math.radians(1.5)
"""Errors of gap (m) and yaw (rad) with which an approach has succeeded: as specified."""

CORRECTED_GAP_M, CORRECTED_YAW_RAD = 0.006, math.radians(0.6)
"""Errors of gap (m) and yaw (rad) above which the base corrects its pose: about a third of
`MAX_GAP_ERROR_M` and `MAX_YAW_ERROR_RAD`."""

VERIFYING_CYCLES = 2
"""Number of tilt cycles that verify the final pose, measured after the base has stopped."""

BEYOND_M = 0.01
"""An edge at the limit of the field of view is rejected where it is further than expected by this,
m."""

VIEW_LIMIT_RAD = math.radians(1.0)
"""Points within this of the steepest depression angle are at the limit of the field of view, rad:
one scan line."""

MAX_MISSES = 3
"""The base stops after this many consecutive tilt cycles without the edge. Chosen."""

UNSEEN_M = 0.6
"""Maximum distance driven on odometry alone, without a measured edge, m: 2 % of error are 12 mm."""

NAVIGATE_M = 1.0
"""A navigator drives to staging poses further away than this, m: four times the goal tolerance
of Nav2's SimpleGoalChecker (0.25 m), so that the rest is driven here."""

REVERSE_M = np.arange(0.0, 1.01, 0.1)
"""Distances of reversing that are tried where the base starts in a narrow place, or at furniture
that a navigator may turn it into, m."""


class Approach:
    """State machine that drives the base to a surface, one step of `PERIOD_S` at a time.

    Parameters
    ----------
    robot, goal, around
        The base, the goal, and the map.
    navigator
        Drives the base near a distant staging pose. None: the approach drives all the way.

    Attributes
    ----------
    phase
        Current phase.
    outcome
        Result; None while the approach runs.
    target
        Newest estimate of the surface, in odom; None before the first step.
    edge
        The measured edge, in odom; None before the first measurement.
    """

    def __init__(
        self,
        robot: RobotBase,
        goal: Goal,
        around: Surroundings,
        navigator: Navigator | None = None,
    ):
        self._robot, self._goal, self._around = robot, goal, around
        self._navigator = navigator
        self._driver = Driver(robot)
        self.phase = Phase.LOOKING
        self.outcome: Outcome | None = None
        self.target: Target | None = None
        self.edge: MeasuredEdge | None = None
        self._expected: Target | None = None
        self._planned: Target | None = None
        self._standing: StandingPose | None = None
        self._legs: LegDrive | None = None
        self._is_backing_off = False
        self._cycles: deque[TopCycle] = deque(maxlen=EDGE_CYCLES)
        self._located = False
        self._steepest = 0.0
        self._since_s = self._cycle_came_s = -math.inf
        self._stood_s: float | None = None
        self._seen_cycles = 0
        self._is_arrived = False
        self._plans = self._corrections = self._misses = 0
        self._measured_at: Float64 | None = None
        self._avoided = np.zeros((0, 2))

    def step(self, readings: Readings) -> Speeds | None:
        """Return the velocity command of this step; zero once `outcome` is set.

        None while the navigator drives: then nothing may be sent.
        """
        lost = missing_input(readings, self._robot.patience_s)
        if lost is not None:
            return self._end(readings, *lost)
        self._odom_map = inverse2(_required(readings.map_odom))
        if self._expected is None:
            self._expected = self._goal.target.moved(self._odom_map)
            self.target = self._expected
            self._since_s = readings.now_s
        is_new = self._note_cycle(readings)
        if self.phase == Phase.LOOKING:
            return self._look(readings, is_new)
        if self.phase == Phase.STAGING:
            return self._stage(readings, is_new)
        if self.phase == Phase.CLOSING:
            return self._close(readings, is_new)
        return self._verify(readings, is_new)

    def wait(self, readings: Readings) -> Speeds | None:
        """Return the zero command, or None while the navigator drives; keep the approach."""
        if self._navigator is not None and self._navigator.is_active:
            return None
        return self._driver.stop(readings)

    def cancel(self, readings: Readings) -> Speeds:
        """Cancel the approach; return the zero command."""
        return self._end(readings, Reason.CANCELLED, "cancelled")

    def gap(self, pose: Float64) -> float:
        """Return the gap at a pose (3,) in odom, m; nan before the edge is measured."""
        return math.nan if self.edge is None else self._gap_and_yaw_error(pose)[0]

    # --- endings ---

    def _end(self, readings: Readings, reason: Reason, message: str) -> Speeds:
        """Set the outcome from the newest estimates; return the zero command."""
        if self._navigator is not None:
            self._navigator.cancel()
        gap = yaw_error = sigma = distance = math.nan
        surface, has_moved = None, False
        if self.edge is not None:
            gap, yaw_error = self._gap_and_yaw_error(readings.pose)
            sigma = self.edge.sigma
        if self.target is not None and self._located and readings.map_odom is not None:
            surface = compose2(readings.map_odom, self.target.pose)
            # Position along an edge whose ends are not visible is less certain than across it.
            has_moved = _is_off(surface, self._goal.target, 2.0 * MOVED_M, 2.0 * MOVED_RAD)
        spot = self._spot()
        if spot is not None:
            distance = float(np.hypot(*(spot - readings.pose[:2])))
        self.outcome = Outcome(
            reason, message, gap, yaw_error, sigma, distance, surface,
            self._goal.target.height, has_moved,
        )  # fmt: skip
        return self._driver.stop(readings)

    def _gap_and_yaw_error(self, pose: Float64) -> tuple[float, float]:
        """Return the gap and the yaw error at a pose (3,) in odom."""
        assert self.edge is not None
        point, normal = self.edge.facing(pose[:2])
        to_edge = float((pose[:2] - point) @ normal)
        inwards = math.atan2(-normal[1], -normal[0])
        return to_edge - self._robot.footprint.front, float(wrap_angle(pose[2] - inwards))

    def _spot(self) -> Float64 | None:
        """Return the spot in odom (2,), moved with the surface; None without a spot."""
        if self._goal.spot is None or self.target is None:
            return None
        in_surface = transform2(inverse2(self._goal.target.pose), self._goal.spot[None])
        return transform2(self.target.pose, in_surface)[0]

    # --- measurements from tilt cycles ---

    def _note_cycle(self, readings: Readings) -> bool:
        """Store a new tilt cycle; return whether there was one."""
        cycle = readings.cycle
        if cycle is None or (self._cycles and cycle.stamp_s <= self._cycles[-1].stamp_s):
            return False
        self._cycles.append(cycle)
        self._cycle_came_s = readings.now_s
        if len(cycle.points):
            self._steepest = max(self._steepest, float(_depressions(cycle).max()))
        return True

    def _locate(self) -> Target | None:
        """Return the surface as located in the newest cycles; None if it is not found."""
        assert self.target is not None
        assert self._expected is not None
        cycles = [c for c in self._cycles if c.stamp_s >= self._since_s - 2.0] or self._cycles
        for target in (self.target, self._expected):
            found = locate(cycles, target, self._same_height)
            if found is not None:
                return found
        return None

    @property
    def _same_height(self) -> list[Float64]:
        return [transform2(self._odom_map, o[:, :2]) for o in self._around.same_height]

    def _is_elsewhere(self) -> bool:
        """Return whether the newest cycle shows the surface at another place."""
        assert self.target is not None
        return is_elsewhere(self._cycles[-1], self.target, self._same_height)

    def _measure(self) -> MeasuredEdge | None:
        """Return the edge ahead, measured in the newest cycles; None if it is not visible."""
        assert self.target is not None
        near, normal = self._ahead()
        points = np.concatenate([c.points for c in self._cycles])
        tops = top_points(points, self.target, self._same_height)
        found = measured_edge(tops, self.target, near, normal)
        if found is None:
            return None
        shift = float((near - found.point) @ normal)
        is_further = self.edge is not None and shift > BEYOND_M
        return None if is_further and self._is_at_view_limit(found) else found

    def _is_at_view_limit(self, edge: MeasuredEdge) -> bool:
        """Return whether an edge may be the limit of the field of view instead."""
        assert self.target is not None
        sensor = self._cycles[-1].sensor
        down = sensor[2] - self.target.height
        ahead = float(np.hypot(*(edge.point - sensor[:2])))
        return math.atan2(down, ahead) > self._steepest - VIEW_LIMIT_RAD

    def _ahead(self) -> tuple[Float64, Float64]:
        """Return the approached point (2,) of the edge, and the edge's normal (2,) there."""
        if self.edge is not None:
            return self.edge.point, self.edge.normal
        assert self._standing is not None
        yaw = self._standing.pose[2]
        return self._standing.edge, np.array([-math.cos(yaw), -math.sin(yaw)])

    # --- looking ---

    def _look(self, readings: Readings, is_new: bool) -> Speeds:
        if is_new and self._cycles[-1].stamp_s > self._since_s:
            self._seen_cycles += 1
            found = self._locate()
            if found is not None:
                self.target, self._located = found, True
                return self._after_look(readings)
            if self._is_arrived and self._seen_cycles >= EDGE_CYCLES:
                return self._end(
                    readings, Reason.GONE,
                    "the surface is gone: tilt cycles from the staging pose do not show it",
                )  # fmt: skip
            if not self._is_arrived and self._seen_cycles >= 2:
                return self._after_look(readings)
        return self._wait_for_cycle(readings, self._since_s)

    def _wait_for_cycle(self, readings: Readings, since_s: float) -> Speeds:
        """Return the zero command; end the approach if no tilt cycle has come for too long."""
        waited_s = readings.now_s - max(since_s, self._cycle_came_s)
        if waited_s > self._robot.patience_s:
            return self._end(
                readings, Reason.LOST_SURFACE,
                f"no tilt cycle came for {waited_s:.0f} s: does the tilting laser or the camera "
                "look down at the surface?",
            )  # fmt: skip
        return self._driver.stop(readings)

    def _after_look(self, readings: Readings) -> Speeds:
        assert self.target is not None
        limits = REPLAN_DISTANCE_M, REPLAN_ANGLE_RAD
        if _is_off(self.target.pose, self._planned, *limits, self.target.is_round):
            return self._plan(readings)
        if self._is_arrived:
            self._begin_closing()
        elif self._legs is not None:
            self._legs = self._legs.moved(self._correct())
            self.phase = Phase.STAGING
        else:
            return self._plan(readings)
        return self._driver.stop(readings)

    def _correct(self) -> Float64:
        """Move the planned place with the surface; return the motion (3,)."""
        assert self.target is not None
        assert self._standing is not None
        assert self._planned is not None
        motion = compose2(self.target.pose, inverse2(self._planned.pose))
        if self.target.is_round:
            motion = np.array([*(self.target.middle - self._planned.middle), 0.0])
        self._standing, self._planned = self._standing.moved(motion), self.target
        return motion

    def _begin_closing(self) -> None:
        """Begin the straight motion to the edge, from the surface's newest estimate."""
        self._correct()
        self.edge, self._misses, self._measured_at = None, 0, None
        self.edge = self._measure()
        self.phase = Phase.CLOSING

    # --- planning ---

    def _plan(self, readings: Readings) -> Speeds:
        """Choose a standing pose to which a free path leads; return the zero command."""
        assert self.target is not None
        self._plans += 1
        if self._plans > MAX_PLANS:
            reason = Reason.MOVED if self._located else Reason.BLOCKED
            return self._end(readings, reason, f"gave up after {MAX_PLANS} plans that failed")
        map_odom = _required(readings.map_odom)
        pose, target = compose2(map_odom, readings.pose), self.target.moved(map_odom)
        others = self._obstacles(readings).others(self._robot.margin)
        seen = transform2(map_odom, np.concatenate([others, self._avoided]))
        args = self._around.grid, self._around.overhangs
        gone = self._goal.target.outline
        floor = Floor(*args, gone, seen)
        around = Floor(args[0], [*args[1], target.outline], gone, seen)
        spot = self._spot()
        spot = None if spot is None else transform2(map_odom, spot[None])[0]
        margin = min(self._robot.margin, self._goal.gap)
        poses = standing_poses(
            target, floor, self._robot.footprint.grown(margin - 1e-3), self._goal.gap - margin,
            self._goal.staging, self._goal.max_distance, spot, self._goal.side,
            pose[:2],
        )  # fmt: skip
        if not poses:
            return self._end(readings, Reason.NO_PLACE, self._why_no_place(spot is not None))
        found = self._free_path(pose, poses, around)
        standing = poses[0] if found is None else found[0]
        is_far = float(np.hypot(*(standing.staging - pose)[:2])) > NAVIGATE_M
        if self._navigator is not None and is_far:
            start = self._turning_place(pose, [*self._around.overhangs, target.outline])
            legs = None if start is None else LegDrive([], float(start[2]), start)
            speeds = self._begin_staging(readings, standing, legs)
            self._is_backing_off = legs is not None
            if legs is None:
                self._navigator.start(standing.staging)
            return speeds
        if found is None:
            return self._end(
                readings, Reason.BLOCKED, "no free way leads to any place at the surface"
            )
        return self._begin_staging(readings, *found)

    def _begin_staging(
        self, readings: Readings, standing: StandingPose, legs: LegDrive | None
    ) -> Speeds:
        """Begin the drive to a staging pose, both in map; without legs, the navigator drives."""
        self._standing = standing.moved(self._odom_map)
        legs = None if legs is None else legs.moved(self._odom_map)
        self._legs, self._planned, self.edge = legs, self.target, None
        self.phase, self._is_arrived, self._is_backing_off = Phase.STAGING, False, False
        return self._driver.stop(readings)

    def _turning_place(self, pose: Float64, tops: list[Float64]) -> Float64 | None:
        """Return the pose (3,) straight behind where the base can turn in place, in map.

        A navigator that sees legs only may turn it into a top. It is the nearest pose with room on
        all sides, or else that with the most; None if it is where the base is.
        """
        room = self._robot.footprint.radius + self._robot.margin
        places = [pose_behind(pose, back) for back in REVERSE_M.tolist()]
        outlines = shapely.union_all([shapely.make_valid(Polygon(top[:, :2])) for top in tops])
        distances = shapely.distance(outlines, [Point(place[:2]) for place in places])
        # The base stops up to `AT_LEG_M` before the end of its way back.
        k = int(np.minimum(distances, room + AT_LEG_M).argmax())
        return None if distances[0] >= room or k == 0 else places[k]

    def _why_no_place(self, has_spot: bool) -> str:
        if has_spot:
            return (
                f"nowhere at the surface is free floor from which the spot is within "
                f"{self._goal.max_distance:g} m"
            )
        return "nowhere at the surface is free floor for the base"

    def _free_path(
        self, pose: Float64, poses: list[StandingPose], floor: Floor
    ) -> tuple[StandingPose, LegDrive] | None:
        """Return the first standing pose with a free path from a pose (3,), and the path, in map.

        None if no path is free.
        """
        radius = self._robot.footprint.radius + self._robot.margin
        for back in REVERSE_M.tolist():
            start = pose_behind(pose, back)
            for standing in _spread(poses):
                ends = floor.legs(start[:2], standing.staging[:2], radius)
                if ends is not None:
                    backing = start if back else None
                    return standing, LegDrive(ends, float(standing.staging[2]), backing)
        return None

    # --- driving ---

    def _obstacles(self, readings: Readings) -> Obstacles:
        return Obstacles.of(
            readings, self.target, self._robot.margin, self._goal.gap, self._robot.height
        )

    def _stage(self, readings: Readings, is_new: bool) -> Speeds | None:
        if self._legs is None:
            return self._stage_by_navigator(readings, is_new)
        if is_new and self._is_elsewhere():
            return self._begin_look(readings)
        wanted = self._legs.wanted(self._driver.pose(readings), self._robot)
        if wanted is None and self._is_backing_off:
            return self._leave_to_navigator(readings)
        if wanted is None:
            return self._begin_look(readings, is_arrived=True)
        speeds = self._driver.move(wanted, readings, self._obstacles(readings))
        return self._plan_around(readings) if self._is_blocked(readings) else speeds

    def _leave_to_navigator(self, readings: Readings) -> Speeds:
        """Start the navigator where the base has backed off; return the zero command."""
        assert self._navigator is not None
        assert self._standing is not None
        self._legs, self._is_backing_off = None, False
        self._navigator.start(compose2(_required(readings.map_odom), self._standing.staging))
        return self._driver.stop(readings)

    def _stage_by_navigator(self, readings: Readings, is_new: bool) -> Speeds | None:
        """Wait until the navigator has ended, then look again: the rest is driven here."""
        assert self._navigator is not None
        if self._navigator.is_active:
            if is_new and self._is_elsewhere():
                self._navigator.cancel()
            return None
        if self._navigator.failure:
            message = f"no way to a place at the surface: {self._navigator.failure}"
            return self._end(readings, Reason.BLOCKED, message)
        return self._begin_look(readings)

    def _begin_look(self, readings: Readings, *, is_arrived: bool = False) -> Speeds:
        self.phase, self._since_s, self._seen_cycles = Phase.LOOKING, readings.now_s, 0
        self._is_arrived = is_arrived
        return self._driver.stop(readings)

    def _is_blocked(self, readings: Readings) -> bool:
        since = self._driver.blocked_s
        return since is not None and readings.now_s - since > self._robot.patience_s

    def _plan_around(self, readings: Readings) -> Speeds:
        """Plan another path, around the obstacle that blocks the current one."""
        blocker = self._driver.blocker
        assert blocker is not None
        x, y = transform2(_required(readings.map_odom), blocker[None])[0].tolist()
        self._avoided = np.concatenate([self._avoided, blocker[None]])
        self._driver.blocked_s = None
        speeds = self._plan(readings)
        if self.outcome is not None and self.outcome.reason in (Reason.BLOCKED, Reason.NO_PLACE):
            message = f"blocked by something at ({x:.2f}, {y:.2f}) in map"
            return self._end(readings, Reason.BLOCKED, message)
        return speeds

    def _close(self, readings: Readings, is_new: bool) -> Speeds:
        if is_new and not self._follow(readings):
            return self._begin_look(readings) if self.outcome is None else STOP
        if self._measured_at is None:
            self._measured_at = readings.pose[:2]
        if float(np.hypot(*(readings.pose[:2] - self._measured_at))) > UNSEEN_M:
            return self._end(
                readings, Reason.LOST_SURFACE,
                f"the edge was not measured on the last {UNSEEN_M:g} m",
            )  # fmt: skip
        speed = CLOSING_SPEED * self._robot.limits.speed
        pose = self._driver.pose(readings)
        wanted = close_in(pose, self._closing_goal(pose), self._robot, speed)
        if wanted is None:
            self.phase, self._stood_s, self._seen_cycles = Phase.VERIFYING, None, 0
            return self._driver.stop(readings)
        speeds = self._driver.move(wanted, readings, self._obstacles(readings))
        return self._plan_around(readings) if self._is_blocked(readings) else speeds

    def _closing_goal(self, pose: Float64) -> Float64:
        """Return the goal pose (3,), at the gap and facing the edge, for a base at a pose (3,)."""
        point, normal = self._ahead() if self.edge is None else self.edge.facing(pose[:2])
        place = point + (self._goal.gap + self._robot.footprint.front) * normal
        return np.array([*place, math.atan2(-normal[1], -normal[0])])

    def _follow(self, readings: Readings) -> bool:
        """Update the edge from a new cycle; return whether the motion may continue.

        False where the edge has moved, or where the approach has ended because the edge was not
        visible in `MAX_MISSES` cycles.
        """
        found = self._measure()
        if found is None:
            self._misses += 1
            if self._misses < MAX_MISSES or self._is_below_view():
                return True
            self._end(
                readings, Reason.LOST_SURFACE,
                f"{MAX_MISSES} tilt cycles do not show the edge of the surface any more",
            )  # fmt: skip
            return False
        near, normal = self._ahead()
        turned = float(np.arccos(np.clip(normal @ found.normal, -1.0, 1.0)))
        shift = abs(float((found.point - near) @ normal))
        if self.edge is not None and (shift > MOVED_M or turned > 2.0 * MOVED_RAD):
            return False
        self.edge, self._misses, self._measured_at = found, 0, readings.pose[:2]
        return True

    def _is_below_view(self) -> bool:
        """Return whether the edge is below the field of view: odometry alone guides from there."""
        return self.edge is not None and self._is_at_view_limit(self.edge)

    def _verify(self, readings: Readings, is_new: bool) -> Speeds:
        """Succeed, correct the pose or look again, by `VERIFYING_CYCLES` cycles after the stop."""
        if self._stood_s is None:
            self._stood_s = readings.now_s + 2.0 * self._robot.latency_s
        if not is_new or self._cycles[-1].stamp_s <= self._stood_s:
            return self._wait_for_cycle(readings, self._stood_s)
        self._seen_cycles += 1
        if self._seen_cycles <= VERIFYING_CYCLES:  # the first may have begun before the stop
            return self._driver.stop(readings)
        while len(self._cycles) > VERIFYING_CYCLES:
            self._cycles.popleft()
        found = self._measure()
        if found is not None:
            self.edge, self._measured_at = found, readings.pose[:2]
        elif not self._is_below_view():
            return self._look_again(readings)
        assert self.target is not None
        if is_passed(self._cycles, self.target, self._same_height):
            return self._look_again(readings, is_arrived=True)
        gap, yaw_error = self._gap_and_yaw_error(readings.pose)
        is_off = abs(gap - self._goal.gap) > CORRECTED_GAP_M or abs(yaw_error) > CORRECTED_YAW_RAD
        if is_off and self._corrections < MAX_CORRECTIONS:
            self._corrections += 1
            self.target = self._locate() or self.target
            self.phase, self._misses = Phase.CLOSING, 0
            return self._driver.stop(readings)
        if abs(gap - self._goal.gap) > MAX_GAP_ERROR_M or abs(yaw_error) > MAX_YAW_ERROR_RAD:
            return self._end(
                readings, Reason.BLOCKED,
                f"after {MAX_CORRECTIONS} corrections still at {100.0 * gap:.1f} cm and "
                f"{math.degrees(yaw_error):.1f} deg: the base does not move as odometry says",
            )  # fmt: skip
        return self._succeed(readings, gap, yaw_error)

    def _look_again(self, readings: Readings, *, is_arrived: bool = False) -> Speeds:
        """Look for a surface that is not visible from the final pose; return zero."""
        if self._corrections >= MAX_CORRECTIONS:
            return self._end(
                readings, Reason.LOST_SURFACE,
                "tilt cycles from the final pose do not show the edge of the surface",
            )  # fmt: skip
        self._corrections += 1
        return self._begin_look(readings, is_arrived=is_arrived)

    def _succeed(self, readings: Readings, gap: float, yaw_error: float) -> Speeds:
        spot = self._spot()
        if spot is not None:
            distance = float(np.hypot(*(spot - readings.pose[:2])))
            if distance > self._goal.max_distance + CORRECTED_GAP_M:
                return self._end(
                    readings, Reason.NO_PLACE,
                    f"the spot is {distance:.2f} m away, beyond {self._goal.max_distance:g} m",
                )  # fmt: skip
        text = f"{100.0 * gap:.1f} cm before the edge, {math.degrees(yaw_error):.1f} deg off"
        return self._end(readings, Reason.NONE, text)


def _required(pose: Float64 | None) -> Float64:
    assert pose is not None
    return pose


def _depressions(cycle: TopCycle) -> Float64:
    """Return the depression angles (N,) of the rays to a cycle's points, rad."""
    rays = cycle.points - cycle.sensor
    return np.asarray(np.arctan2(-rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])))


def _is_off(
    pose: Float64, other: Target | None, limit: float, angle: float, is_round: bool = False
) -> bool:
    """Return whether a surface's pose differs from a target's by more than `limit` or `angle`."""
    if other is None:
        return True
    far = float(np.hypot(*(pose[:2] - other.pose[:2]))) > limit
    return far or (not is_round and abs(float(wrap_angle(pose[2] - other.pose[2]))) > angle)


def _spread(poses: list[StandingPose]) -> list[StandingPose]:
    """Return the poses, best first, that are more than 0.3 m from every better one."""
    chosen: list[StandingPose] = []
    for pose in poses:
        if all(np.hypot(*(pose.pose[:2] - c.pose[:2])) > 0.3 for c in chosen):
            chosen.append(pose)
    return chosen
