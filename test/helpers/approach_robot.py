"""The simulated base of `approach_world` over DDS, synchronised with the node that drives it.

Both use the clock of the base. It advances by one step when the node has sent the command of the
last step, so that the motion does not depend on the speed of the machine.
"""

import time

import numpy as np
from approach_world import CELL_M, Flat, SimulatedBase, mapped_target
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Twist
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from tccm_interfaces.msg import Localisation, Surface, SurfaceMap
from tccm_interfaces.srv import FindSurfaces

from tccm_ros.approach.speeds import Speeds
from tccm_ros.geometry import compose2, inverse2, spatial, transform2
from tccm_ros.nodes.qos import latched_qos, surface_message_qos
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.records import Odometry, Scan, SurfaceCloud, TransformSample
from tccm_ros.ros.pointcloud import POINT_ROW, cloud_message
from tccm_ros.ros.types import pose_message
from tccm_ros.ros.writing import scan_message, surface_cloud_message, transforms_message
from tccm_sim.sensor_messages import odometry_message

START_S = 1_700_000_000
WAIT_S = 0.25
"""Time to wait for an expected command, s. Without one the base's watchdog decides."""

BEAMS = 360


def ns(t: float) -> int:
    """Return a stamp of the base's clock, exact: the timer of the control loop misses none."""
    return START_S * 1_000_000_000 + round(t * 1e9)


def stamp(t: float) -> Time:
    sec, nanosec = divmod(ns(t), 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


class ApproachRobot:
    """Publishes the measurements of the base and its map; obeys cmd_vel.

    Attributes
    ----------
    commands
        Commands received.
    nav2
        Stand-in of Nav2's navigator, which drives the base while it has a goal; None without one.
    other_commands
        Commands received in each step in which Nav2 drove, by goal of Nav2.
    driver
        The approach_node that drives the base; None before there is one.
    wait_s
        Time to wait for an expected command, s.
    """

    def __init__(self, ros, flat: Flat, seed: int = 0, *, is_on_tf: bool = False):
        self.ros, self.flat = ros, flat
        self.base = SimulatedBase(flat, np.random.default_rng(seed))
        self.types = RosidlMessages()
        self.map_node = ros.node("surface_slam")
        self.node = ros.node("bot")
        self.commands: list[Speeds] = []
        self.nav2 = None
        self.other_commands: list[list[list[Speeds]]] = []
        self.driver, self.wait_s = None, WAIT_S
        self._history: list = []
        self._sent_cycle = None
        reliable = QoSProfile(depth=200)
        make = self.node.create_publisher
        self._clock = make(Clock, "/clock", 10)
        self._odometry_message = self._transforms if is_on_tf else self._odometry_of_base
        topic = "/tf" if is_on_tf else "odom"
        self._odometry = make(type(self._odometry_message()), topic, reliable)
        self._scan = make(type(self._scan_message()), "scan", reliable)
        self._cycles = make(type(self._cloud(np.zeros((0, 3)), np.zeros(3), 0.0)),
                            "tccm/surfaces", surface_message_qos())  # fmt: skip
        self._obstacles = make(type(self._obstacles_message()), "tccm/obstacles", latched_qos())
        self._grid = self.map_node.create_publisher(OccupancyGrid, "map", latched_qos())
        self._map = self.map_node.create_publisher(SurfaceMap, "~/surface_map", latched_qos())
        self._where = self.map_node.create_publisher(Localisation, "~/localisation", latched_qos())
        self.map_node.create_service(FindSurfaces, "~/find_surfaces", self._find)
        self.node.create_subscription(Twist, "cmd_vel", self._obey, 10)
        self.surfaces = self._surfaces()
        self._grid.publish(self._grid_message())
        self._map.publish(SurfaceMap(surfaces=self.surfaces))
        self.is_localised = True

    # --- the map ---

    def _surfaces(self) -> list[Surface]:
        target = mapped_target(self.flat)
        made = [self._surface(1, "table", target.outline, target.pose, target.height)]
        if self.flat.is_round:
            made[0].shape = Surface.SHAPE_CIRCLE
        for k, other in enumerate(self.flat.mapped_others):
            outline = np.asarray(other.top.exterior.coords)[:-1]
            middle = np.array([*outline.mean(axis=0), 0.0])
            made.append(self._surface(2 + k, "seat", outline, middle, other.height))
        return made

    def _surface(self, identity, label, outline, pose, height) -> Surface:
        T = spatial(pose)
        T[2, 3] = height
        made = Surface(id=identity, label=label, height=height, pose=pose_message(self.types, T))
        made.boundary.points = [Point(x=float(x), y=float(y), z=height) for x, y in outline]
        return made

    def _find(self, request, response):
        wanted = set(request.filter.ids)
        found = [s for s in self.surfaces if not wanted or s.id in wanted]
        if request.filter.labels:
            found = [s for s in found if s.label in request.filter.labels]
        response.success, response.message = True, f"{len(found)} surfaces"
        response.surfaces.surfaces = found
        return response

    def _grid_message(self) -> OccupancyGrid:
        grid = self.flat.grid()
        made = OccupancyGrid()
        made.info.resolution, made.info.width = CELL_M, int(grid.cells.shape[1])
        made.info.height = int(grid.cells.shape[0])
        made.info.origin.position.x, made.info.origin.position.y = map(float, grid.origin)
        made.data = grid.cells.ravel().tolist()
        return made

    # --- measurements ---

    def _transforms(self):
        T = spatial(self.base.odom)
        sample = TransformSample(ns(self.base.t), "odom", "base", T, is_static=False)
        return transforms_message(self.types, [sample])

    def _odometry_of_base(self):
        T = spatial(self.base.odom)
        return odometry_message(self.types, Odometry(ns(self.base.t), "odom", "base", T))

    def _scan_message(self):
        points = self.base.level_scan()
        bearings = np.arctan2(points[:, 1], points[:, 0])
        ranges = np.full(BEAMS, np.inf, np.float32)
        beams = np.rint((bearings + np.pi) / (2 * np.pi / BEAMS)).astype(int) % BEAMS
        ranges[beams] = np.hypot(*points.T)
        scan = Scan(
            ns(self.base.t), "base", -np.pi, 2 * np.pi / BEAMS, 0.0, 0.05, 30.0, ranges
        )  # fmt: skip
        return scan_message(self.types, scan)

    def _cloud(self, points, sensor, t):
        cloud = SurfaceCloud(
            ns(t), "base", points.astype(np.float32), np.zeros(len(points), np.uint32),
            sensor.astype(np.float32),
        )  # fmt: skip
        return surface_cloud_message(self.types, cloud)

    def _obstacles_message(self):
        rows = self.base.obstacles.astype(np.float32).view(POINT_ROW).reshape(-1)
        stamp_ns = ns(max(self.base.obstacles_s, 0.0))
        return cloud_message(self.types, stamp_ns, "odom", rows)

    def _send_cycle(self) -> None:
        cycle = self.base._cycle
        if cycle is None or cycle is self._sent_cycle or "cycle" in self.base.mute:
            return
        self._sent_cycle = cycle
        times = np.array([t for t, _ in self._history])
        at = min(int(np.searchsorted(times, cycle.stamp_s)), len(times) - 1)
        t, odom = self._history[at]
        back = inverse2(odom)
        points = np.concatenate(
            [transform2(back, cycle.points[:, :2]), cycle.points[:, 2:]], axis=1
        )
        sensor = np.array([*transform2(back, cycle.sensor[None, :2])[0], cycle.sensor[2]])
        self._cycles.publish(self._cloud(points, sensor, t))
        self._obstacles.publish(self._obstacles_message())

    def _send_place(self) -> None:
        state = Localisation.TRACKING if self.is_localised else Localisation.LOST
        T = spatial(compose2(self.base.map_odom, self.base.odom))
        message = Localisation(state=state, reason="" if self.is_localised else "it was carried")
        message.header.stamp, message.header.frame_id = stamp(self.base.t), "map"
        message.pose.pose = pose_message(self.types, T)
        self._where.publish(message)

    # --- in step ---

    def _obey(self, twist) -> None:
        self.commands.append(Speeds(twist.linear.x, twist.angular.z))

    def _has_heard(self) -> bool:
        """Return whether approach_node has received the odometry and the clock of this step."""
        if self.driver is None:
            return False
        now_ns, readings = ns(self.base.t), self.driver.inputs
        is_newest = "odom" in self.base.mute or readings.newest_ns >= now_ns
        return is_newest and self.driver.get_clock().now().nanoseconds >= now_ns

    def _is_driven(self) -> bool:
        """Return whether commands are expected: a goal is active that moves the base."""
        drive = None if self.driver is None else self.driver._drive
        is_other = self.nav2 is not None and self.nav2.is_driving
        return drive is not None and drive.is_driving and not is_other

    def step(self) -> None:
        """Publish the current measurements, wait for the command, and advance the time.

        Where none is expected, the step ends when approach_node has received the measurements.
        """
        base = self.base
        self._history.append((base.t, base.odom.copy()))
        count = len(self.commands)
        if "odom" not in base.mute:
            self._odometry.publish(self._odometry_message())
        if "scan" not in base.mute and len(self._history) > 1:
            self._scan.publish(self._scan_message())
        if len(self._history) % 10 == 1:
            self._send_place()
        self._send_cycle()
        self._clock.publish(Clock(clock=stamp(base.t)))
        is_other = self.nav2 is not None and self.nav2.is_driving
        end = time.monotonic() + self.wait_s
        while True:
            self.ros.executor.spin_once(timeout_sec=0.005)
            is_told = len(self.commands) > count
            if is_told or time.monotonic() >= end or (self._has_heard() and not self._is_driven()):
                break
        if is_other and self.nav2.is_driving:
            while len(self.other_commands) < len(self.nav2.goals):
                self.other_commands.append([])
            self.other_commands[-1].append(self.commands[count:])
            base.tick(self.nav2.speeds())
        else:
            base.tick(self.commands[-1] if len(self.commands) > count else None)

    def drive_until(self, is_over, seconds: float = 200.0) -> None:
        """Advance the time until `is_over` returns true, or fail after `seconds`, base clock."""
        end = self.base.t + seconds
        while not is_over():
            assert self.base.t < end, "the base has not got there"
            self.step()
