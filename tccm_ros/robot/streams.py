"""The stream of a sensor: record type, message reader, mount and processor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.config import Config
from tccm_ros.records import Posed
from tccm_ros.robot.chain_finder import MountKind

Cleaner = Callable[[Any], tuple[Any, str | None]]
"""Function that removes from a record the values that are no measurements; returns the record and a
remark, or the same record and None."""


def instant(record: Any) -> tuple[int, int]:
    """Return the time span of a record that was measured all at once."""
    return record.stamp_ns, record.stamp_ns


def no_remark(record: Any) -> str | None:
    """Return None: no rejection and no remark."""
    return None


def no_cleaner() -> Cleaner:
    """Return a function that leaves all records as they are."""
    return lambda record: (record, None)


def unchanged(record: Any, config: Config) -> Any:
    """Return a record unchanged: no driver errors are known."""
    return record


class Companion(NamedTuple):
    """Records that a sensor's records need in addition, such as a camera's calibration.

    Attributes
    ----------
    role
        Name of the companion stream, also its topic.
    record
        Type of the records.
    reader
        Converts a message to records.
    join
        Function that returns a record joined with its companion, or why it is dropped, or None
        where it has to wait. The arguments are the record, the companions so far in stamp order,
        and whether no better one will come.
    """

    role: str
    record: type
    reader: MessageReader
    join: Callable[[Any, Sequence[Any], bool], Any]


@dataclass(frozen=True, slots=True)
class Stream:
    """The stream of one sensor.

    To register a sensor, add its stream to those of a `Robot`.

    Attributes
    ----------
    role
        Name of the stream, also its topic unless remapped.
    record
        Record type, with ``stamp_ns`` and ``frame_id``.
    reader
        Converts a message to records.
    mount
        Kind of mount.
    processor
        Processor of its events: ``tccm``, ``slam``, or another's name.
    event
        Class of the posed records.
    time_span
        Function that returns the times of the first and last measurement of a record, ns; both are
        its stamp by default.
    rejection_reason
        Function that returns why a record is rejected; None if it is not.
    remark
        Function that returns a remark on an unusual record that is used anyway; remarks are
        counted. None if the record is as usual.
    make_cleaner
        Function that returns a new `Cleaner`, which is given all records of one sensor in order.
    at_once
        Function that returns a record with all measurements at its stamp, for records whose times
        are wrong; None if these records are rejected.
    fault_of_pose
        Function that returns why a posed record is rejected; None if it is not.
    correct
        Function that corrects configured errors of a record's driver.
    sees_robot
        Whether poses include the robot's own shapes, for the self filter.
    companion
        Records that its records need in addition; None for none.
    max_waiting
        Maximum length of the queue; the oldest record is dropped when it is full. Large records
        need a short queue.
    is_occasional
        Whether records are irregular, and may also be in the odometry or map frame, such as
        detections. Tilt cycles do not wait for them, and their silence is no fault.
    can_be_base
        Whether the sensor is the base if there are no frames and no odometry: matching of its
        records gives the motion.
    """

    role: str
    record: type
    reader: MessageReader
    mount: MountKind
    processor: str
    event: type[Posed] = Posed
    time_span: Callable[[Any], tuple[int, int]] = instant
    rejection_reason: Callable[[Any], str | None] = no_remark
    remark: Callable[[Any], str | None] = no_remark
    make_cleaner: Callable[[], Cleaner] = no_cleaner
    at_once: Callable[[Any], Any] | None = None
    fault_of_pose: Callable[[Posed], str | None] = no_remark
    correct: Callable[[Any, Config], Any] = unchanged
    sees_robot: bool = False
    companion: Companion | None = None
    max_waiting: int = 1000
    is_occasional: bool = False
    can_be_base: bool = False
