"""Statistics of matches on real recordings of robots that are not lost: a Markdown table.

Usage: python bench/bench_match_statistics.py [RECORDING ...]

Each level scan is matched with the local map as in a replay. The columns are quantiles over the
scans: the fraction of a scan's points that fits the map, the fraction of the confirmed surfaces in
view that the scan sees through, and the first minus the second. Of a robot that is elsewhere the
difference is negative (`front_end.LOST_TIME`): last come the fraction of scans in which it is, and
the longest time in a row (s).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.topics import choose_topics
from tccm_ros.config import Config
from tccm_ros.records import PosedScan
from tccm_ros.robot import MountKind, Robot
from tccm_ros.slam.front_end import FrontEnd
from tccm_ros.slam.matching.alignment import seen_through
from tccm_ros.slam.matching.level_scan import LevelScan, make_level_scan

FLAT = Path(__file__).resolve().parent.parent / "bags" / "flat"


class Observed(FrontEnd):
    """Notes the statistics of each match."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.seen: list[tuple[int, float, float]] = []

    def _check_lost(self, scan: LevelScan, inliers: float) -> None:
        if self._map is not None and len(scan.points):
            passed = seen_through(self.pose, scan, self._map.lines)
            self.seen.append((scan.stamp_ns, inliers, passed))
        super()._check_lost(scan, inliers)


def statistics(path: Path) -> np.ndarray:
    """Return stamps, fractions of inliers and of surfaces seen through, float64 (N, 3)."""
    config = Config()
    front = Observed(config)
    with BagReader(path) as reader:
        choice = choose_topics(reader, config, [])
        reader.add_readers(choice.readers)
        level = [s for s in choice.streams if s.mount is MountKind.LEVEL]
        others = {s.role for s in choice.streams} - {s.role for s in level}
        topics = {role: name for role, name in choice.topics.items() if role not in others}
        robot = Robot(config, level, expects_odometry=choice.counts["odom"] > 0)
        for role, _, record in reader.records(topics):
            for event in robot.add(role, record):
                if isinstance(event, PosedScan):
                    front.add(make_level_scan(event, config))
    return np.array(front.seen)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("recordings", type=Path, nargs="*", default=[FLAT])
    print(
        "| recording | scans | inliers, 1 % and 10 % | seen through, 90 % and 99 % | "
        "difference, 0.1 % and 1 % | negative | s |"
    )
    print("|---|---|---|---|---|---|---|")
    for path in parser.parse_args().recordings:
        stamps, inliers, passed = statistics(path).T
        low, high = np.quantile(inliers, [0.01, 0.1]), np.quantile(passed, [0.9, 0.99])
        worst = np.quantile(inliers - passed, [0.001, 0.01])
        beyond = passed > inliers
        edges = np.flatnonzero(np.diff(np.concatenate([[0], beyond, [0]]).astype(int)))
        runs = [stamps[b - 1] - stamps[a] for a, b in zip(edges[::2], edges[1::2])]
        print(
            f"| {path.name} | {len(stamps)} | {low[0]:.2f}, {low[1]:.2f} | {high[0]:.2f}, "
            f"{high[1]:.2f} | {worst[0]:.2f}, {worst[1]:.2f} | {beyond.mean():.4f} | "
            f"{max(runs, default=0.0) * 1e-9:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
