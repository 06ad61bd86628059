"""Parts of visualization_msgs markers: message context, colours, points, text, marker arrays."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from copy import copy
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64
from tccm_ros.records.building import pose_from_message
from tccm_ros.ros.types import (
    MessageTypes,
    header_message,
    point_message,
    pose_message,
    vector_message,
)

ARROW, CUBE, CYLINDER, LINE_LIST, CUBE_LIST, TEXT, TRIANGLE_LIST = 0, 1, 3, 5, 6, 9, 11
ADD, DELETE = 0, 2

TEXT_HEIGHT_M = 0.06
"""Height of a capital letter, m. Chosen."""

GOLDEN_RATIO = 0.618033988749895
"""Step of hue in full circles; successive multiples differ strongly."""

Color = tuple[float, float, float]


class MessageContext(NamedTuple):
    """Message classes, stamp and frame of the messages of one topic.

    Attributes
    ----------
    types
        Message classes.
    stamp_ns, frame_id
        Stamp and frame of the header.
    """

    types: MessageTypes
    stamp_ns: int
    frame_id: str


class MarkerSet:
    """Builds marker arrays that also delete the markers of the previous message that are gone.

    Parameters
    ----------
    types
        Message classes.
    """

    def __init__(self, types: MessageTypes) -> None:
        self._types = types
        self._shown: dict[tuple[str, int], str] = {}

    def message(self, markers: Sequence[Any], stamp_ns: int) -> Any:
        """Return a visualization_msgs/MarkerArray with `markers` and the needed deletions."""
        shown = {(marker.ns, int(marker.id)): marker.header.frame_id for marker in markers}
        gone = sorted(self._shown.keys() - shown.keys())
        deletions = [
            self._types.make(
                "visualization_msgs/msg/Marker",
                header=header_message(self._types, stamp_ns, self._shown[key]),
                ns=key[0],
                id=key[1],
                action=DELETE,
            )
            for key in gone
        ]
        self._shown = shown
        return self._types.make(
            "visualization_msgs/msg/MarkerArray", markers=[*deletions, *markers]
        )


def moved_markers(types: MessageTypes, markers: Sequence[Any], T: Float64) -> Sequence[Any]:
    """Return markers with their poses transformed by T (4, 4) into another frame."""
    if not np.array_equal(T, np.eye(4)):
        for marker in markers:
            own = pose_from_message(marker.pose, "a marker")
            marker.pose = pose_message(types, T @ own)
    return markers


def identity_color(identity: int, *, brightness: float = 0.95) -> Color:
    """Return the colour of an id, red green blue from 0 to 1; successive ids differ strongly."""
    return colorsys.hsv_to_rgb(identity * GOLDEN_RATIO % 1.0, 0.65, brightness)


def scale_color(fraction: float) -> Color:
    """Return the colour for a value from 0 (blue) to 1 (red)."""
    return colorsys.hsv_to_rgb(0.67 * (1.0 - min(max(fraction, 0.0), 1.0)), 0.85, 0.95)


def marker_points(types: MessageTypes, xyz: ArrayLike, chosen: ArrayLike | None = None) -> Any:
    """Return geometry_msgs/Point messages.

    Parameters
    ----------
    types
        Message classes.
    xyz
        (N, 3), m, in the marker's frame.
    chosen
        int (M,), indices of rows; all if None.
    """
    rows = np.asarray(xyz, np.float64).reshape(-1, 3)
    return types.rows("geometry_msgs/msg/Point", rows, chosen)


def _color_message(types: MessageTypes, color: Color, alpha: float) -> Any:
    r, g, b = color
    return types.make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=alpha)


def make_marker(
    context: MessageContext,
    ns: str,
    identity: int,
    kind: int,
    scale: Sequence[float],
    color: Color,
    alpha: float = 1.0,
    **fields: Any,
) -> Any:
    """Return a visualization_msgs/Marker.

    Parameters
    ----------
    context
        Message classes and header.
    ns, identity
        Namespace and number, the identity of the marker.
    kind
        `ARROW`, `CUBE` and so on.
    scale
        (3,), m, with the meaning defined by the kind.
    color, alpha
        Red green blue, and opacity, from 0 to 1.
    **fields
        Other fields of the message.
    """
    marker = copy(_blank(context))
    marker.ns, marker.id, marker.type = ns, int(identity), kind
    marker.scale = vector_message(context.types, np.maximum(scale, 0.0))
    marker.color = _color_message(context.types, color, alpha)
    for name, value in fields.items():
        setattr(marker, name, value)
    return marker


@lru_cache(maxsize=2)
def _blank(context: MessageContext) -> Any:
    """Return a marker to copy: most fields are the same in all markers of a message."""
    header = header_message(context.types, context.stamp_ns, context.frame_id)
    return context.types.make("visualization_msgs/msg/Marker", header=header, action=ADD)


def text_marker(context: MessageContext, ns: str, identity: int, at: Float64, text: str) -> Any:
    """Return a marker of white text.

    Parameters
    ----------
    context
        Message classes and header.
    ns, identity
        Namespace and number.
    at
        float64 (3,), centre of the text, m.
    text
        The text.
    """
    scale = (0.0, 0.0, TEXT_HEIGHT_M)
    point = point_message(context.types, at)
    where = context.types.make("geometry_msgs/msg/Pose", position=point)
    return make_marker(context, ns, identity, TEXT, scale, (1.0, 1.0, 1.0), pose=where, text=text)
