"""A small robot in a room with a table, whose topics tests publish record by record.

The room is computed here, independently of the simulator: walls 3 m around, floor, table top at
0.70 m.
Nodes use message time, so that seconds of a recording can be sent at once.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice

import numpy as np
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from solver_forks import fork_solver

from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.slam_node import SlamNode
from tccm_ros.nodes.solver import forked
from tccm_ros.nodes.tccm_node import TccmNode
from tccm_ros.records import (
    CameraImage,
    CameraInfo,
    Imu,
    JointSample,
    Odometry,
    PoseCovariance,
    RobotDescription,
    Scan,
    TransformSample,
)
from tccm_ros.ros.output_messages import pose_covariance_message
from tccm_ros.ros.writing import scan_message, transforms_message
from tccm_sim.sensor_messages import (
    camera_image_message,
    camera_info_message,
    imu_message,
    joint_sample_message,
    odometry_message,
    robot_description_message,
)

START_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000
"""Period of tilting scans, joint samples and odometry, ns; level scans have twice this period."""

CYCLE_SCANS = 20
"""Scans of one tilt cycle."""

HEIGHT, WALL, TABLE = 1.2, 3.0, 0.70
CHUNK = 30
"""Maximum number of records in flight to the nodes: less than the depth of the queues."""

URDF = """<robot name="small">
  <link name="{p}base"/><link name="{p}head"/><link name="{p}eye"/><link name="{p}low"/>
  <joint name="tilt" type="{kind}"><parent link="{p}base"/><child link="{p}head"/>
    <origin xyz="0 0 1.2"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="9"/>
  </joint>
  <joint name="mount" type="fixed"><parent link="{p}head"/><child link="{p}eye"/></joint>
  <joint name="low_mount" type="fixed"><parent link="{p}base"/><child link="{p}low"/>
    <origin xyz="0 0 0.3"/></joint>
</robot>"""


def tilt_at(k: float) -> float:
    """Return the tilt at step k, rad: between 0.2 and 1.2, a triangle wave."""
    phase = k / CYCLE_SCANS % 2.0
    return 0.2 + 1.0 * (phase if phase < 1.0 else 2.0 - phase)


def tilt_scan(stamp_ns: int, tilt: float, prefix: str = "", beams: int = 121) -> Scan:
    """Return a scan of the tilting laser in the middle of the room."""
    bearings = np.linspace(-1.2, 1.2, beams)
    x, y = np.cos(bearings) * np.cos(tilt), np.sin(bearings)
    down = np.maximum(np.cos(bearings) * np.sin(tilt), 1e-9)
    ranges = np.minimum(WALL / np.abs(x), WALL / np.maximum(np.abs(y), 1e-9))
    ranges = np.minimum(ranges, HEIGHT / down)
    top = (HEIGHT - TABLE) / down
    on_table = (top * x > 0.4) & (top * x < 1.2) & (np.abs(top * y) < 0.5)
    ranges = np.where(on_table, top, ranges)
    return make_scan(stamp_ns, f"{prefix}eye", bearings, ranges)


def level_scan(stamp_ns: int, x: float, prefix: str = "") -> Scan:
    """Return a scan of the level laser x m ahead of the middle of the room."""
    bearings = np.linspace(-2.2, 2.2, 181)
    c, s = np.cos(bearings), np.sin(bearings)
    along = np.where(c > 0.0, WALL - x, WALL + x) / np.maximum(np.abs(c), 1e-9)
    ranges = np.minimum(along, WALL / np.maximum(np.abs(s), 1e-9))
    return make_scan(stamp_ns, f"{prefix}low", bearings, ranges)


def make_scan(stamp_ns: int, frame_id: str, bearings, ranges) -> Scan:
    step = float(bearings[1] - bearings[0])
    ranges = ranges.astype(np.float32)
    return Scan(stamp_ns, frame_id, float(bearings[0]), step, 0.0, 0.05, 30.0, ranges)


def recording(
    cycles: float, *, start_ns: int = START_NS, speed: float = 0.0, prefix: str = "", tilt=True
) -> Iterator[tuple[str, object]]:
    """Yield (topic, record) of some tilt cycles; the base drives ahead at `speed` m/s."""
    steps = round(cycles * CYCLE_SCANS)
    for k in range(steps + 3):
        now = start_ns + k * STEP_NS
        x = speed * k * STEP_NS * 1e-9
        T = np.eye(4)
        T[0, 3] = x
        yield "odom", Odometry(now, f"{prefix}odom", f"{prefix}base", T)
        yield "joint_states", JointSample(now, ("tilt",), np.array([tilt_at(k)]))
        if k > 0 and k <= steps and tilt:
            yield "tilt_scan", tilt_scan(now, tilt_at(k), prefix)
        if k > 0 and k <= steps and k % 2:
            yield "scan", level_scan(now, x, prefix)


class Robot:
    """Publishers of one robot.

    Attributes
    ----------
    node
        Its node, in its own participant.
    sent
        Numbers of sent messages, by topic.
    """

    def __init__(self, ros, *, namespace="", prefix="", reliable=True, described=True, name="bot"):
        self.ros, self.prefix = ros, prefix
        self.types = RosidlMessages()
        self.node = ros.node(name, namespace=namespace)
        self.sent: dict[str, int] = {}
        self._qos = QoSProfile(
            depth=200,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        )
        self._publishers: dict[str, object] = {}
        self._heard: set[tuple[str, object]] = set()
        if described:
            self.describe()

    def describe(self, kind: str = "revolute") -> None:
        """Publish the robot description, latched."""
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        message = robot_description_message(
            self.types, RobotDescription(URDF.format(p=self.prefix, kind=kind))
        )
        publisher = self.node.create_publisher(type(message), "robot_description", latched)
        publisher.publish(message)
        self._publishers["robot_description"] = publisher

    def wait_until_described(self, *nodes) -> None:
        """Wait until nodes have the description, if there is one; they drop earlier scans."""
        if "robot_description" in self._publishers:
            for node in nodes:
                self.ros.spin_until(
                    lambda n=node: n.robot.robot.frames.model, what="the robot description"
                )

    def message(self, record):
        """Return the message of a record."""
        build = {
            Scan: scan_message,
            Odometry: odometry_message,
            Imu: imu_message,
            JointSample: joint_sample_message,
            CameraImage: camera_image_message,
            CameraInfo: camera_info_message,
            PoseCovariance: lambda types, r: pose_covariance_message(
                types, r.stamp_ns, r.frame_id, np.eye(4), r.cov
            ),
            TransformSample: lambda types, sample: transforms_message(types, [sample]),
        }[type(record)]
        return build(self.types, record)

    def publisher(self, topic: str, message):
        """Return the publisher of a topic; it is created for the first message."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(type(message), topic, self._qos)
        return self._publishers[topic]

    def publish(self, topic: str, message, *nodes) -> None:
        """Publish one message after these nodes have matched its publisher."""
        publisher = self.publisher(topic, message)
        for node in nodes:
            if (topic, node) not in self._heard:
                self.ros.connect(self.node, node, self.node.resolve_topic_name(topic))
                self._heard.add((topic, node))
        publisher.publish(message)
        self.sent[topic] = self.sent.get(topic, 0) + 1

    def play(self, records: Iterable[tuple[str, object]], *nodes, until_done: bool = True) -> None:
        """Publish a recording, at the speed of the subscribed nodes.

        With `until_done` it returns when their workers have processed all messages.
        """
        self.wait_until_described(*nodes)
        received = [dict(node.inputs.counts()) for node in nodes]
        base = dict(self.sent)
        records = iter(records)
        while chunk := list(islice(records, CHUNK)):
            for topic, record in chunk:
                name = self.node.resolve_topic_name(topic)
                self.publish(topic, self.message(record), *(n for n in nodes if listens(n, name)))
            for node, before in zip(nodes, received):
                self.ros.spin_until(
                    lambda n=node, b=before: self._has_all(n, b, base), what="all messages"
                )
        for node in nodes if until_done else ():
            wait_until_done(self.ros, node)

    def _has_all(self, node, before, base) -> bool:
        counts = node.inputs.counts()
        for topic, sent in self.sent.items():
            name = self.node.resolve_topic_name(topic)
            got = counts.get(name, 0) - before.get(name, 0)
            if name in counts and got < sent - base.get(topic, 0):
                return False
        return True


def topics_of(node) -> set[str]:
    """Return the topics that a node publishes or subscribes to."""
    return {end.topic_name for end in (*node.publishers, *node.subscriptions)}


def is_connected(writer, reader, topic: str) -> bool:
    """Return whether two nodes have discovered each other on a topic, with all endpoints matched.

    Best-effort messages that are sent before the match are lost.
    """
    readers = writer.get_subscriptions_info_by_topic(topic)
    writers = reader.get_publishers_info_by_topic(topic)
    return (
        _is_among(reader, readers)
        and _is_among(writer, writers)
        and all(
            publisher.get_subscription_count() >= len(readers)
            for publisher in writer.publishers
            if publisher.topic_name == topic
        )
        and all(
            subscription.get_publisher_count() >= len(writers)
            for subscription in reader.subscriptions
            if subscription.topic_name == topic
        )
    )


def _is_among(node, ends) -> bool:
    name = node.get_namespace(), node.get_name()
    return name in {(end.node_namespace, end.node_name) for end in ends}


def listens(node, name: str) -> bool:
    """Return whether a node subscribes to a topic."""
    return name in node.inputs.counts()


def wait_until_done(ros, node) -> None:
    """Wait until a node's worker has processed its queue."""
    done: list[int] = []
    node.worker.post(lambda: done.append(1))
    ros.spin_until(lambda: done, what="the worker")


def end_input(node) -> None:
    """Have a node process all pending input, as before a map is saved."""
    node.robot.flush()
    node.worker.wait(node.end_input)


def overrides(values: dict) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


def tccm(ros, *, namespace="", context=None, words=(), **values) -> TccmNode:
    """Add a tccm node; parameters as ``group__key``, words as on the command line."""
    return _node(ros, TccmNode, namespace, context, words, values)


def slam(ros, *, namespace="", context=None, words=(), shared=None, **values) -> SlamNode:
    """Add a SLAM node; parameters as ``group__key``, words as on the command line.

    `shared` is the robot of a TCCM node in the same process.
    """
    forked.take_prepared()  # of a node that could not be made
    forked._prepared.append(fork_solver())
    return _node(ros, partial(SlamNode, shared), namespace, context, words, values)


def _node(ros, kind, namespace, context, words, values):
    named = {name.replace("__", "."): value for name, value in values.items()}
    named.setdefault("qos.reliability", "reliable")
    node = ros.add(
        kind(
            namespace=namespace,
            context=context or ros.another_context(),
            parameter_overrides=overrides(named),
            cli_args=["--ros-args", *words] if words else None,
        )
    )
    ros.spin_until(lambda: node.kernels.is_done, what="the kernels")
    return node


class Listener:
    """Node that collects the messages of topics."""

    def __init__(self, ros, name="listener"):
        self.ros = ros
        self.node = ros.node(name)

    def listen(self, kind, topic, *, latched=False, depth=100) -> list:
        """Subscribe to a topic; return the list to which its messages are appended."""
        got: list = []
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        self.node.create_subscription(
            kind, topic, got.append, QoSProfile(depth=depth, durability=durability)
        )
        return got
