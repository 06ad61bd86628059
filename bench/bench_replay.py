"""Replay of the bundled bags: milliseconds a stage, and seconds of the bag in a second.

    python bench/bench_replay.py [BAG ...]

The first bag is replayed once before, so that compiling is not timed. Times are those of the
process (one thread does the work), medians of `RUNS` runs. Reading and all processing count for the
real-time factor, imports and pictures do not; the last column counts the writing of all result
files as well.
"""

import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from tccm_ros.config import Config
from tccm_ros.replay.replay import PROCESSING, replay
from tccm_ros.stopwatch import Stopwatch

BAGS = Path(__file__).resolve().parents[1] / "bags"

RUNS = 3

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
        out = Path(folder) / "out"
        _run(bags[0], out)
        stages = (*PROCESSING, "write")
        columns = [f"{stage}, ms" for stage in stages]
        print("| bag | s | " + " | ".join(columns) + " | x real time | x with files |")
        print("|---" * (len(columns) + 4) + "|")
        for bag in bags:
            runs = [_run(bag, out) for _ in range(RUNS)]
            seconds = {stage: median(run[stage] for run, _ in runs) for stage in stages}
            duration = runs[0][1]
            processing = sum(seconds[stage] for stage in PROCESSING)
            print(
                f"| {bag.name} | {duration:.0f} | "
                + " | ".join(f"{1e3 * seconds[stage]:.0f}" for stage in stages)
                + f" | {duration / processing:.1f} | {duration / sum(seconds.values()):.1f} |",
                flush=True,
            )


def _run(bag: Path, out: Path) -> tuple[dict[str, float], float]:
    """Return the seconds of each stage, and those of the bag."""
    clock = Stopwatch(time.process_time)
    remap = REMAPS.get(bag.name, [])
    summary = replay(bag, out, Config(), remap=remap, pictures=False, clock=clock)
    return {stage: clock.seconds.get(stage, 0.0) for stage in (*PROCESSING, "write")}, float(
        summary.content.bag_duration
    )


if __name__ == "__main__":
    main([Path(a) for a in sys.argv[1:]] or sorted(p for p in BAGS.iterdir() if p.is_dir()))
