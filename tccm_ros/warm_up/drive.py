"""Compile the SLAM kernels, or load them from disk, before the first record.

A temporary processor receives a synthetic robot's drive through a synthetic room, and synthetic
surface messages. The kernels of tilt cycles are not needed here and would take memory.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import SurfaceCloud, ViewIntervals
from tccm_ros.warm_up.made_robot import (
    PERIOD_NS,
    START_NS,
    events_of,
    level_drive,
    with_own_robot,
)

SURFACES = ((0.0, 2.0), (0.7, 0.5), (0.73, 0.1))
"""Height and half width of floor, table, and a step on it, m."""

VIEW_SCANS = (20, 60, 100)
"""Indices of scans at which the surfaces are seen."""


def warm_up(config: Config) -> None:
    """Process a drive in a temporary SLAM processor."""
    config = with_own_robot(config)
    slam = SurfaceSlam(config)
    for event in events_of(level_drive(), config):
        slam.add(event)
    for k in VIEW_SCANS:
        stamp_ns = START_NS + k * PERIOD_NS
        slam.add(_surfaces(stamp_ns))
        slam.add(_seen_through(stamp_ns, 1.0 if k < VIEW_SCANS[-1] else 1.6))
    slam.solve()


def _surfaces(stamp_ns: int) -> SurfaceCloud:
    """Return the points of floor, table and step, with a spacing of 2 cm."""
    parts = []
    for z, half in SURFACES:
        side = np.arange(-half, half, 0.02)
        x, y = (a.ravel() for a in np.meshgrid(side + 1.5, side))
        parts.append(np.column_stack([x, y, np.full(len(x), z)]))
    surface = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    points = np.concatenate(parts).astype(np.float32)
    return SurfaceCloud(stamp_ns, "base", points, surface.astype(np.uint32))


def _seen_through(stamp_ns: int, end: float) -> ViewIntervals:
    """Return the free intervals above the floor from x = 0.2 m on; the table begins at 1 m."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0.2, end, 0.1), np.arange(-0.5, 0.5, 0.1)))
    intervals = np.column_stack([x, y, np.full(len(x), 0.2), np.full(len(x), 1.2)])
    return ViewIntervals(stamp_ns, "base", intervals.astype(np.float32))
