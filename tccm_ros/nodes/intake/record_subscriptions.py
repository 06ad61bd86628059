"""Subscriptions of a node to sensors, joints, odometry and frames of the robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.config import Config
from tccm_ros.errors import TccmError
from tccm_ros.nodes.clock import stamp_on_receipt
from tccm_ros.nodes.intake.inputs import Inputs, Watch
from tccm_ros.nodes.intake.refusals import Refusals
from tccm_ros.nodes.qos import LARGE_DEPTH, latched_qos, sensor_qos, static_transforms_qos
from tccm_ros.nodes.ros_types import has_tf2_msgs, is_installed, message_class
from tccm_ros.robot import MountKind, Stream
from tccm_ros.ros.reading import READERS
from tccm_ros.sensors.depth_image import camera_info_topic
from tccm_ros.sensors.registry import stream_for_topic

Take = Callable[[str, Any], None]
"""Takes a role and a record."""


def read_records(reader: MessageReader, data: bytes) -> Sequence[Any]:
    """Return the records of a serialised message.

    Their arrays are writable, because kernels are compiled only for writable arrays.

    Raises
    ------
    MessageError
        If no processor can use the content.
    """
    return reader.read(bytearray(data), _deserialize)


def _deserialize(type_name: str, data: bytes) -> Any:
    return deserialize_message(bytes(data), message_class(type_name))


class RecordSubscriptions:
    """Subscribes, and converts messages to records; unreadable messages are refused with a reason.

    Parameters
    ----------
    node
        The node that subscribes.
    config
        Its parameters.
    inputs, refusals
        Message counters by topic, and the log of refused messages.
    streams
        Sensors of the node, by role.
    """

    def __init__(
        self,
        node: Node,
        config: Config,
        inputs: Inputs,
        refusals: Refusals,
        streams: Mapping[str, Stream],
    ):
        self._node, self._config = node, config
        self._inputs, self._refusals, self._streams = inputs, refusals, streams
        self._spans = {role: stream.time_span for role, stream in streams.items()}

    def to_sensors(self, take: Take, *, watch: Watch) -> None:
        """Subscribe to the sensors and to the calibrations of cameras.

        Parameters
        ----------
        take
            Called with each record.
        watch
            How the silence of lasers is rated in /diagnostics.
        """
        for stream in self._streams.values():
            if stream.is_occasional:
                self._to_occasional(stream, take)
            elif stream.mount is not MountKind.ANY:
                self._to_laser(stream, take, watch)
            else:
                self._to_camera_or_lidar(stream, take)

    def to_robot(self, take: Take) -> None:
        """Subscribe to odometry, joints, IMU, description, transforms and external poses."""
        measured = sensor_qos(self._config.qos.reliability)
        self.to("odom", measured, take)
        self.to("joint_states", measured, take)
        self.to("imu", measured, take, watch="event")
        if self._config.localisation.is_external:
            self.to("external_pose", measured, take, watch="event")
        self.to("robot_description", latched_qos(), take, watch="event")
        if has_tf2_msgs():
            self.to("tf", measured, take, topic="/tf", watch="event")
            self.to("tf_static", static_transforms_qos(), take, topic="/tf_static", watch="event")

    def to(
        self,
        role: str,
        qos: QoSProfile,
        take: Take,
        *,
        topic: str = "",
        watch: Watch = "stream",
        is_measured: bool = True,
        reader: MessageReader | None = None,
        instead: Sequence[str] = (),
    ) -> None:
        """Subscribe to the messages of a role.

        Parameters
        ----------
        role
            A key of `ros.READERS` or the role of a stream.
        qos
            QoS profile of the subscription.
        take
            Called with each record.
        topic
            By default the role's name.
        watch
            How the topic's silence is rated in /diagnostics.
        is_measured
            Whether the records are measurements of a sensor, whose stamps `qos.stamp: receive`
            replaces. Results of another node keep their stamps.
        reader
            Reader of the messages; that of `READERS` by default.
        instead
            Resolved names of alternative topics: if messages come on one, this one is not needed.
        """
        reader = reader or READERS[role]
        on_receipt = is_measured and self._config.qos.stamp == "receive"
        span = self._spans.get(role)

        def callback(data: bytes) -> None:
            try:
                for record in read_records(reader, data):
                    if entry.last_ns is not None and hasattr(record, "stamp_ns"):
                        entry.note(entry.last_ns, record.stamp_ns)
                    now = stamp_on_receipt(self._node, record, span) if on_receipt else record
                    take(role, now)
                self._refusals.note_used(entry.name)
            except TccmError as error:
                entry.refused += 1
                self._refusals.note(entry.name, error)

        entry = self._inputs.subscribe(
            reader.message_type, topic or role, callback, qos, watch=watch, raw=True,
            instead=instead,
        )  # fmt: skip

    def _to_occasional(self, stream: Stream, take: Take) -> None:
        if is_installed(stream.reader.message_type):
            self.to(stream.role, self._large(), take, watch="event", reader=stream.reader)

    def _to_laser(self, stream: Stream, take: Take, watch: Watch) -> None:
        roles = (r for r, s in self._streams.items() if not s.is_occasional and r != stream.role)
        self.to(
            stream.role,
            sensor_qos(self._config.qos.reliability),
            take,
            watch=watch,
            reader=stream.reader,
            instead=[self._node.resolve_topic_name(role) for role in roles],
        )

    def _to_camera_or_lidar(self, stream: Stream, take: Take) -> None:
        role, reader, beside = stream.role, stream.reader, stream.companion
        if beside is not None:
            reader = stream_for_topic(stream, self._node.resolve_topic_name(role)).reader
            topic = self._topic_beside(role, beside.role)
            if not self._inputs.has(topic):  # images of one camera have one calibration
                self.to(
                    beside.role, self._large(), take, topic=topic, watch="event",
                    reader=beside.reader,
                )  # fmt: skip
        self.to(role, self._large(), take, reader=reader)

    def _large(self) -> QoSProfile:
        return sensor_qos(self._config.qos.reliability, depth=LARGE_DEPTH)

    def _topic_beside(self, role: str, beside: str) -> str:
        """Return the topic of a calibration: beside the image's if only the image is remapped."""
        resolve = self._node.resolve_topic_name
        image, info = resolve(role), resolve(beside)
        is_image_remapped = image != resolve(role, only_expand=True)
        is_info_remapped = info != resolve(beside, only_expand=True)
        return camera_info_topic(image) if is_image_remapped and not is_info_remapped else info
