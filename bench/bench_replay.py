"""Replay of the bundled bags: milliseconds a stage, and seconds of the bag in a second.

    python bench/bench_replay.py [BAG ...]

The first bag is replayed once before, so that compiling is not timed. Reading and all processing
count for the real-time factor; imports and pictures do not.
"""

import sys
import tempfile
from pathlib import Path

from tccm_ros.config import Config
from tccm_ros.replay import PROCESSING, replay

BAGS = Path(__file__).resolve().parents[1] / "bags"

REMAPS = {
    "upside_down": [
        "tilt_scan:=/nod_lidar/scan",
        "scan:=/front_lidar/scan",
        "odom:=/wheel_odom",
        "joint_states:=/dynamixel/joint_states",
    ]
}
"""Bags of robots with other topic names."""


def main(bags: list[Path]) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        replay(bags[0], Path(folder) / "warm", Config(), pictures=False)
        print(
            "| bag | s | " + " | ".join(f"{stage}, ms" for stage in PROCESSING) + " | x real time |"
        )
        print("|---" * (len(PROCESSING) + 3) + "|")
        for bag in bags:
            remap = REMAPS.get(bag.name, [])
            summary = replay(bag, Path(folder) / bag.name, Config(), remap=remap, pictures=False)
            stages = " | ".join(f"{1e3 * summary.seconds.get(s, 0.0):.0f}" for s in PROCESSING)
            duration = summary.content["bag_duration"]
            print(f"| {bag.name} | {duration:.0f} | {stages} | {summary.real_time_factor:.1f} |")


if __name__ == "__main__":
    main([Path(a) for a in sys.argv[1:]] or sorted(p for p in BAGS.iterdir() if p.is_dir()))
