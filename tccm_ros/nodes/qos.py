"""QoS profiles: sensor data in, latched maps out.

By default, a profile keeps the newest messages, is reliable, and late subscribers get none.
"""

from collections.abc import Callable

from rclpy.event_handler import (
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

SENSOR_DEPTH = 200
"""Queue depth. Chosen: five seconds of a 40 Hz laser, more than the longest step of the
processors."""

ADVICE = {
    "reliability": "set qos.reliability to best_effort, or make the publisher reliable",
    "durability": "make the publisher transient local",
}
"""Advice by incompatible policy."""

SURFACE_MESSAGE_DEPTH = 50
"""Queue depth. Chosen: one minute of tilt cycles, during which the SLAM node may be busy with a
batch optimisation."""


EVENTS_DEPTH = 100
"""Queue depth of events: a burst of changes."""

LARGE_DEPTH = 10
"""Queue depth of images and point clouds: a third of a second of a camera, 6 MB."""


def sensor_qos(reliability: str = "best_effort", *, depth: int = SENSOR_DEPTH) -> QoSProfile:
    """Return the profile of a sensor subscription; best effort matches every publisher."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy[reliability.upper()])


def latched_qos() -> QoSProfile:
    """Return the profile of maps, planes and markers: a late subscriber gets the newest message."""
    return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def static_transforms_qos() -> QoSProfile:
    """Return the profile of /tf_static: late subscribers get all latched transforms."""
    return QoSProfile(depth=SENSOR_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def surface_message_qos() -> QoSProfile:
    """Return the profile of the surface message between the two nodes, which loses nothing."""
    return QoSProfile(depth=SURFACE_MESSAGE_DEPTH)


def subscription_events(topic: str, warn: Callable[[str], object]) -> SubscriptionEventCallbacks:
    """Return callbacks that report publishers with an incompatible QoS."""

    def incompatible(info: QoSRequestedIncompatibleQoSInfo) -> None:
        warn(
            f"a publisher of '{topic}' offers an incompatible {_policy(info)}: nothing will arrive "
            f"from it; {ADVICE.get(_policy(info), 'change the publisher')}"
        )

    # `Inputs` reports other types; rclpy's own callback for it would add an event to wait for.
    return SubscriptionEventCallbacks(incompatible_qos=incompatible, use_default_callbacks=False)


def _policy(info: QoSRequestedIncompatibleQoSInfo) -> str:
    name = str(getattr(info.last_policy_kind, "name", info.last_policy_kind))
    return name.lower().removeprefix("rmw_qos_policy_")
