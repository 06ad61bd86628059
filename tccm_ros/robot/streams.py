"""A sensor's stream: what its records are, how they are posed, and who takes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.records import Posed
from tccm_ros.robot.chain_finder import MountKind


def at_its_stamp(record: Any) -> tuple[int, int]:
    """Return the time of a record that was measured all at once."""
    return record.stamp_ns, record.stamp_ns


def without_fault(record: Any) -> str | None:
    """Return no fault: what the reader lets through can be used."""
    return None


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
    taker
        The processor that its events are for: ``tccm``, ``slam``, or another's name.
    event
        Class of its posed records.
    time_span
        Times of the first and the last measurement of a record, ns; its stamp by default.
    fault
        Returns why a record cannot be used, None where it can.
    sees_robot
        Whether the poses carry the robot's own shapes, to be filtered out.
    """

    role: str
    record: type
    reader: MessageReader
    mount: MountKind
    taker: str
    event: type[Posed] = Posed
    time_span: Callable[[Any], tuple[int, int]] = at_its_stamp
    fault: Callable[[Any], str | None] = without_fault
    sees_robot: bool = False
