"""Short recordings for the tests of fleets, and what may differ between two replays of one."""

import shutil
from pathlib import Path

from tccm_ros.pipeline.sim.options import Options
from tccm_ros.pipeline.sim.recording import simulate

VARYING = {"timing.json", "report.html", "fleet.json"}
"""Files that hold times of the clock."""


def write_recordings(folder: Path, count: int) -> Path:
    """Write simulated recordings of two seconds; their names differ."""
    folder.mkdir(parents=True)
    first = simulate("situation_a", folder / "robot_0", options=Options(duration=2.0))
    for k in range(1, count):
        shutil.copytree(first, folder / f"robot_{k}")
    return folder


def write_bad_recordings(folder: Path, whole: Path) -> Path:
    """Write a truncated, an empty and a foreign file that are called recordings."""
    folder.mkdir()
    content = next(whole.rglob("*.mcap")).read_bytes()
    (folder / "truncated.mcap").write_bytes(content[: len(content) // 2])
    (folder / "empty.mcap").touch()
    (folder / "foreign.db3").write_text("a letter, not a bag\n")
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of a result folder's files that are the same in each replay."""
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.name not in VARYING}
