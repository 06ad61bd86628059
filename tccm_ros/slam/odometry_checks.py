"""What speaks for a pose where odometry says another: what is seen there, and what is seen through.

People who walk along are where they were in the scan before, and make it look as if the robot stood
still. But where it really is, a scan sees through little that others have seen, and what standing
still would explain better is the people alone, whom hardly two keyframes see in one place.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.slam.alignment import Alignment
from tccm_ros.slam.level_scan import LevelScan
from tccm_ros.slam.line_map import LineMap
from tccm_ros.slam.se2 import place
from tccm_ros.slam.seen_through import passes_and_hits

__all__ = ["evidence_for"]


def evidence_for(alignment: Alignment, scan: LevelScan, line_map: LineMap) -> float:
    """Return the share of a scan that lies on confirmed surfaces, less the share of the confirmed
    surfaces in view that the scan sees through: -1..1.
    """
    passes, hits = passes_and_hits(
        line_map.points[line_map.confirmed],
        place(alignment.pose, scan.origin[None]),
        np.array([len(scan.points)]),
        place(alignment.pose, scan.points),
    )
    passed, hit = int(passes.sum()), int(hits.sum())
    return alignment.confirmed - passed / max(passed + hit, 1)
