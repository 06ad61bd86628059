"""A sensor's stream: what its records are, how they are posed, and who takes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.config import Config
from tccm_ros.records import Posed
from tccm_ros.robot.chain_finder import MountKind


def at_its_stamp(record: Any) -> tuple[int, int]:
    """Return the time of a record that was measured all at once."""
    return record.stamp_ns, record.stamp_ns


def nothing_to_say(record: Any) -> str | None:
    """Return None: what the reader lets through can be used, and is as usual."""
    return None


def as_it_came(record: Any, config: Config) -> Any:
    """Return a record as it is: nothing is known of errors of its driver."""
    return record


class Companion(NamedTuple):
    """Records that come beside those of a sensor, and that they need: a camera's calibration.

    Attributes
    ----------
    role
        What their stream is called: also its topic.
    record
        Type of the records.
    reader
        How a message becomes records.
    join
        Returns a record with what it needs of its companions, or why it is dropped, or None where
        it has to wait. It is called with the record, the companions that have come, by stamp, and
        whether no better one will come.
    """

    role: str
    record: type
    reader: MessageReader
    join: Callable[[Any, Sequence[Any], bool], Any]


@dataclass(frozen=True, slots=True)
class Stream:
    """The stream of one sensor.

    A sensor is registered by adding its stream to those that a `Robot` is made with.

    Attributes
    ----------
    role
        What it is called: also its topic, unless that is remapped.
    record
        Type of its records: they have ``stamp_ns`` and ``frame_id``.
    reader
        How a message becomes records.
    mount
        How the sensor is mounted.
    processor
        The processor that its events are for: ``tccm``, ``slam``, or another's name.
    event
        Class of its posed records.
    time_span
        Times of the first and the last measurement of a record, ns; its stamp by default.
    rejection_reason
        Returns why a record cannot be used, None where it can.
    remark
        Returns what is unusual about a record that is used, None where nothing is: it is counted.
    fault_of_pose
        Returns why a posed record cannot be used, None where it can.
    correct
        Returns a record without the errors of its driver that are configured.
    sees_robot
        Whether the poses carry the robot's own shapes, to be filtered out.
    companion
        What comes beside its records, None where they need nothing.
    max_waiting
        Records that wait at one time; the oldest is dropped when there are more. Large ones need a
        small limit.
    is_occasional
        Whether records come now and then, and may be in the odometry or the map frame too: what a
        program recognised. No tilt cycle waits for them, and their silence is no fault.
    can_be_base
        Whether the sensor is the base where nothing tells of any frame or of odometry: its records
        move it by matching.
    """

    role: str
    record: type
    reader: MessageReader
    mount: MountKind
    processor: str
    event: type[Posed] = Posed
    time_span: Callable[[Any], tuple[int, int]] = at_its_stamp
    rejection_reason: Callable[[Any], str | None] = nothing_to_say
    remark: Callable[[Any], str | None] = nothing_to_say
    fault_of_pose: Callable[[Posed], str | None] = nothing_to_say
    correct: Callable[[Any, Config], Any] = as_it_came
    sees_robot: bool = False
    companion: Companion | None = None
    max_waiting: int = 1000
    is_occasional: bool = False
    can_be_base: bool = False
