"""Flat panels on the walls of a world: door plates, posters, notices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from PIL import Image

from tccm_ros.arrays import Float64, Int64, UInt8

MIN_TEXELS = 4
"""Width and height of the smallest picture of an image pyramid."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture on a wall.

    Attributes
    ----------
    pixels
        uint8 (h, w, 3), red, green, blue, from the front.
    T_world_panel
        float64 (4, 4), pose of its centre: x to the right of a viewer, y up, z out of the wall.
    width
        Width, m; the height follows from the picture.
    number
        Room number on a door sign; empty for other panels.
    anchor
        Position of the number's centre in the panel (the panel's centre without a number), m.
    """

    pixels: UInt8
    T_world_panel: Float64
    width: float
    number: str = ""
    anchor: tuple[float, float] = (0.0, 0.0)

    @property
    def height(self) -> float:
        """Height, m."""
        return self.width * self.pixels.shape[0] / self.pixels.shape[1]

    @property
    def position(self) -> Float64:
        """Position of the number in the world, float64 (3,), m."""
        position: Float64 = (self.T_world_panel @ [*self.anchor, 0.0, 1.0])[:3]
        return position

    @property
    def normal(self) -> Float64:
        """Unit normal of the wall, outwards, in the world, float64 (3,)."""
        normal: Float64 = self.T_world_panel[:3, 2]
        return normal


class PanelArrays(NamedTuple):
    """Panels as arrays, each with an image pyramid of half, a quarter, ... of its size.

    Attributes
    ----------
    T_panel_world
        float64 (P, 3, 4).
    half
        float64 (P, 2), half width and height, m.
    levels
        int64 (L, 3): first pixel, height and width of each picture.
    first
        int64 (P + 1,): the pictures of panel p are ``first[p]`` to ``first[p + 1] - 1``.
    pixels
        uint8 (N, 3).
    """

    T_panel_world: Float64
    half: Float64
    levels: Int64
    first: Int64
    pixels: UInt8


def panel_arrays(panels: Sequence[Panel]) -> PanelArrays:
    """Return panels as arrays for the renderer."""
    levels, first, pixels, count = [], [0], [], 0
    for panel in panels:
        picture = Image.fromarray(panel.pixels)
        while min(picture.size) >= MIN_TEXELS:
            levels.append((count, picture.height, picture.width))
            pixels.append(np.asarray(picture).reshape(-1, 3))
            count += len(pixels[-1])
            size = max(picture.width // 2, 1), max(picture.height // 2, 1)
            picture = picture.resize(size, Image.Resampling.BOX)
        first.append(len(levels))
    inverse = [np.linalg.inv(panel.T_world_panel)[:3] for panel in panels]
    return PanelArrays(
        np.array(inverse).reshape(-1, 3, 4),
        np.array([(p.width / 2.0, p.height / 2.0) for p in panels]).reshape(-1, 2),
        np.array(levels, np.int64).reshape(-1, 3),
        np.array(first, np.int64),
        np.concatenate(pixels) if pixels else np.zeros((0, 3), np.uint8),
    )


def on_wall(
    at: tuple[float, float], height: float, outward: tuple[float, float]
) -> Float64:  # fmt: skip
    """Return T_world_panel of a panel on a vertical wall.

    Parameters
    ----------
    at
        x, y of its centre, on the wall's face, m.
    height
        z of its centre, m.
    outward
        Unit normal out of the wall.
    """
    z = np.array([*outward, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    T = np.eye(4)
    T[:3, :3] = np.column_stack([np.cross(up, z), up, z])
    T[:3, 3] = (*at, height)
    return T
