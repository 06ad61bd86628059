"""Sessions whose loop closures contradict each other keep a place."""

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.inliers import select_inliers
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.loops.matching import Proposal
from tccm_ros.slam.walls.lines import NO_LINES

KEYFRAMES = 6
COV = np.diag([0.02**2, 0.02**2, 0.006**2])


@pytest.mark.parametrize("shift", [0.0, 5.0])
def test_a_session_without_consistent_loop_closures_keeps_its_pose(shift):
    """Two loop closures that differ by 5 m are both rejected; equal ones are kept."""
    chain = KeyframeChain()
    for k in range(2 * KEYFRAMES):
        i, step = k % KEYFRAMES, np.array([0.5, 0.0, 0.0])
        keyframe = GraphKeyframe(
            k, None, i * step, step if i else 0.0 * step, COV if i else 0.0 * COV, k // KEYFRAMES
        )
        chain.add(keyframe, np.zeros(0))
    place = np.array([0.0, 2.0, 0.0])
    poses = np.array([k.pose + place * k.session for k in chain.keyframes])
    loops = [
        Proposal(a, a + KEYFRAMES, place + np.array([0.0, change, 0.0]), COV, 0.9, 0.8, 2.0)
        for a, change in ((0, 0.0), (KEYFRAMES - 1, shift))
    ]
    closer = LoopCloser(Config(), chain)
    closer.load(poses, loops, [])
    used = select_inliers(closer, chain, [NO_LINES] * len(poses), [], [], [], Config())
    assert len(used.loops) == (0 if shift else 2)
    graph = chain.graph(used.poses, closer.fixed_starts(used.loops))
    graph.add([p.factor(chain.keys) for p in used.loops])
    solution = graph.optimise()
    variances = np.diag(solution.planar_covariance(chain.keys[-1]))
    assert variances.max() < KEYFRAMES * 10.0 * COV[0, 0]
    assert np.abs(solution.planar_poses(chain.keys) - closer.poses).max() < 0.01
    if shift:
        assert [*closer.fixed_starts(used.loops)] == [KEYFRAMES]
