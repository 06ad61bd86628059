"""Match two wall maps: search for the keyframes of the second in the first, as of a new session.

The proposals come from the loop search, and confirm each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2, inverse2
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.loops.matching import Proposal
from tccm_ros.slam.saved_walls import SavedWalls
from tccm_ros.slam.signs.views import SignView

YAW_WEIGHT = 3.0
"""Weight of yaw in the distance of two poses, m/rad. Chosen."""


def match_walls(one: SavedWalls, other: SavedWalls, config: Config) -> list[Proposal]:
    """Match the keyframes of a map in another one; return the confirmed matches.

    Parameters
    ----------
    one, other
        The maps; ids in the result are local to each map.
    config
        Groups ``loops`` and ``matching``.
    """
    chain = KeyframeChain()
    closer = LoopCloser(config, chain, begins_trajectories=False)
    for keyframe, lines in zip(one.keyframes, one.lines):
        chain.add(keyframe, lines.phi)
    closer.load(one.poses, one.loops, (), one.sign_views, one.unjoined)
    count = len(one.keyframes)
    first_session = 1 + max(keyframe.session for keyframe in one.keyframes)
    for k, (keyframe, lines) in enumerate(zip(other.keyframes, other.lines)):
        session = first_session + keyframe.session
        chain.add(replace(keyframe, id=count + k, session=session), lines.phi)
        closer.add(count + k, (), _sign_views_on(k, other, count))
    found = [p for p in closer.accepted[len(one.loops) :] if p.a < count <= p.b]
    found = [replace(p, b=p.b - count) for p in found]
    return [p for p in found if other.keyframes[p.b].session not in other.unjoined]


def _sign_views_on(k: int, walls: SavedWalls, count: int) -> list[SignView]:
    """Return the sign views at a keyframe, with keyframe ids offset by `count` and no sign id."""
    views = [view for view in walls.sign_views if view.anchored.keyframe == k]
    views.sort(key=lambda view: view.measurement.stamp_ns)
    return [replace(v, anchored=replace(v.anchored, keyframe=count + k), sign=-1) for v in views]


def median_pose(loops: Sequence[Proposal], one: Float64, other: Float64) -> Float64:
    """Return the pose of a map in another one, float64 (3,), from the match nearest to all others.

    Parameters
    ----------
    loops
        Matches of `match_walls`, at least one.
    one, other
        float64 (K, 3), poses of the keyframes of the two maps.
    """
    poses = np.array(
        [compose2(compose2(one[p.a], p.delta), inverse2(other[p.b])) for p in loops]
    ).reshape(-1, 3)
    x, y, yaw = np.moveaxis(between2(poses[:, None], poses), 2, 0)
    distances = np.hypot(x, y) + YAW_WEIGHT * np.abs(yaw)
    return np.asarray(poses[int(np.argmin(distances.sum(axis=1)))])
