"""Load the kernels of tracking from disk before the first record.

They are a subset of those compiled by `drive`. slam_node needs no others and does not import gtsam;
the solver process loads its own.
"""

from __future__ import annotations

from tccm_ros.config import Config
from tccm_ros.slam.tracking import Tracker
from tccm_ros.warm_up.made_robot import events_of, level_drive, with_own_robot


def warm_up(config: Config) -> None:
    """Track the synthetic robot through a room."""
    config = with_own_robot(config)
    tracker = Tracker(config)
    for event in events_of(level_drive(), config):
        if tracker.takes(event):
            tracker.add(event)
