"""The sensors that are built in: a new one is a module of this room and a line here."""

from __future__ import annotations

from tccm_ros.robot import Stream
from tccm_ros.sensors.laser_scan import LEVEL_SCAN, TILT_SCAN


def default_streams() -> tuple[Stream, ...]:
    """Return the streams of all sensors; a caller may add others to them."""
    return TILT_SCAN, LEVEL_SCAN


def roles_of(taker: str) -> frozenset[str]:
    """Return the roles of the streams that are for a processor (`Stream.taker`)."""
    return frozenset(stream.role for stream in default_streams() if stream.taker == taker)
