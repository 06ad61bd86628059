"""A sensor that the package does not know is one stream: read, posed, counted, mapped, drawn.

A robot carries an ultrasonic range finder on its nodding head. It is registered here, outside the
package, with the record that sensor_msgs/Range becomes; what it hits goes into a part map.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from message_families import TYPESTORE
from robots import MS, START, joint, joints_at, odometry_at, robot

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.bags.writer import BagWriter
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.errors import MessageError
from tccm_ros.records import Posed, RobotDescription
from tccm_ros.records.building import stamp_ns_from_message
from tccm_ros.results.exports import cuboids_archive
from tccm_ros.robot import MountKind, Robot, Stream
from tccm_ros.ros.markers import MessageContext, cuboid_markers
from tccm_ros.ros.reading import READERS
from tccm_ros.ros.types import header_message
from tccm_ros.sensors.registry import default_streams
from tccm_sim.sensor_messages import (
    joint_sample_message,
    odometry_message,
    robot_description_message,
)

RANGE = "sensor_msgs/msg/Range"
WALL = 2.0  # x in odom, m
URDF = robot([joint("nod", "revolute", "base", "head", xyz="0.1 0 1.0"),
              joint("front", "fixed", "head", "sonar", xyz="0.05 0 0")])  # fmt: skip


# -- the sensor, as a module of its own would have it ------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Range:
    """How far the nearest object is along x of a frame, m."""

    stamp_ns: int
    frame_id: str
    range: float


def read_range(message):
    if not message.min_range <= message.range <= message.max_range:
        raise MessageError(f"range {message.range} m is beyond the sensor's limits")
    stamp_ns = stamp_ns_from_message(message.header.stamp)
    return (Range(stamp_ns, message.header.frame_id, message.range),)


SONAR = Stream(
    "sonar", Range, MessageReader(RANGE, read_range), MountKind.ANY, processor="sonar map"
)


class SonarMap:
    """The processor that takes the stream: hits in the map of one cycle."""

    def __init__(self, config):
        self.map, self._builder = IntegrationMap(config), PartMapBuilder(config)
        self.hits = []

    def add(self, event):
        if isinstance(event, Posed) and event.role == SONAR.role:
            T_odom_sonar = event.T_odom_base[0] @ event.T_base_sensor[0]
            hit = T_odom_sonar @ [event.record.range, 0.0, 0.0, 1.0]
            self._builder.add_points(hit[None, :3], event.stamp_ns)
            self.hits.append(hit[:3])

    def finish(self):
        self.map.add(self._builder.close(0, START, START))


# -- a recording of it --------------------------------------------------------------------------


def write_drive(path):
    """Write a drive of 0.4 m/s along a wall while the head nods; joints fall silent for 0.4 s."""
    with BagWriter(path, typestore=TYPESTORE) as writer:
        text = robot_description_message(TYPESTORE, RobotDescription(URDF))
        writer.write("/robot_description", "std_msgs/msg/String", START, text)
        for ms in range(0, 2000, 10):
            now, y, angle = START + ms * MS, 0.4e-3 * ms, 0.3 * np.sin(ms * 5e-3)
            moved = odometry_message(TYPESTORE, odometry_at(now, (0, y, 0, 0, 0, 0)))
            writer.write("/odom", "nav_msgs/msg/Odometry", now, moved)
            if not 800 < ms < 1200:
                joints = joint_sample_message(TYPESTORE, joints_at(now, nod=angle))
                writer.write("/joint_states", "sensor_msgs/msg/JointState", now, joints)
            distance = (WALL - 0.1) / np.cos(angle) - 0.05
            limits = {"min_range": 0.1, "max_range": 0.0 if ms == 500 else 9.0}
            header = header_message(TYPESTORE, now, "sonar")
            heard = TYPESTORE.make(RANGE, header=header, range=distance, **limits)
            writer.write("/sonar", RANGE, now, heard)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """Return the robot, the processor and the unreadable messages of the recording."""
    bag = tmp_path_factory.mktemp("sonar") / "bag"
    write_drive(bag)
    one = Robot(Config(), [*default_streams(), SONAR], expects_odometry=True)
    processor = SonarMap(Config())
    with BagReader(bag, {**READERS, SONAR.role: SONAR.reader}) as reader:
        for role, _, record in reader.records({**DEFAULT_TOPICS, SONAR.role: "/sonar"}):
            for event in one.add(role, record):
                processor.add(event)
        for event in one.flush():
            processor.add(event)
        unreadable = dict(reader.dropped)
    processor.finish()
    return one, processor, unreadable


def test_every_record_is_posed_or_counted_under_its_own_name(mapped):
    one, processor, unreadable = mapped
    sonar = one.sensors[SONAR.role]
    assert unreadable == {"/sonar": 1}
    assert sonar.received == 199
    assert sonar.posed == len(processor.hits) > 150
    # Joints are silent for 0.4 s: more than half of the sync timeout.
    assert sonar.dropped == {"no joint samples": 39}
    assert one.sensors["tilt_scan"].received == 0


def test_hits_are_where_the_wall_is(mapped):
    # Base and head move while the robot drives: only their poses at the stamp give the wall.
    np.testing.assert_allclose([hit[0] for hit in mapped[1].hits], WALL, atol=1e-6)
    heights = [hit[2] for hit in mapped[1].hits]
    assert np.ptp(heights) > 0.5


def test_map_of_an_external_stream_is_drawn_saved_and_loaded(mapped, tmp_path):
    cuboids = mapped[1].map.cuboids()
    (tmp_path / "cuboids.npz").write_bytes(cuboids_archive(cuboids, Config(), "odom"))
    drawn = draw(cuboids.ix, cuboids.iy, cuboids.top * TICK, cuboids.bottom * TICK)
    with np.load(tmp_path / "cuboids.npz") as saved:
        assert saved["count"].sum() == len(mapped[1].hits)
        again = draw(saved["ix"], saved["iy"], saved["top"], saved["bottom"])
    assert len(drawn) == len(cuboids) > 10
    assert drawn == again
    assert {abs(x - WALL) < 0.02 for x, _, _ in drawn} == {True}


def draw(ix, iy, top, bottom):
    """Return the points of the markers of cuboids."""
    tops, cell = np.column_stack([(ix + 0.5) * 0.02, (iy + 0.5) * 0.02, top]), 0.02
    place = MessageContext(TYPESTORE, START, "odom")
    markers = cuboid_markers(place, tops, top - bottom, cell, 0.03, np.zeros(len(ix)))
    return [tuple(point) for marker in markers for point in np.asarray(marker.points)]
