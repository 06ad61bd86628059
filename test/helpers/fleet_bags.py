"""Short recordings for the tests of fleets, and comparison of their replays."""

import shutil
from pathlib import Path

from mcap.writer import Writer

from tccm_sim.options import Options
from tccm_sim.recording import simulate

VARYING = {"timing.json", "report.html", "fleet.json"}
"""Files with clock times, which differ between replays."""


def write_recordings(folder: Path, count: int) -> Path:
    """Write simulated recordings of two seconds with different names."""
    folder.mkdir(parents=True)
    first = simulate("situation_a", folder / "robot_0", options=Options(duration=2.0))
    for k in range(1, count):
        shutil.copytree(first, folder / f"robot_{k}")
    return folder


def write_bad_recordings(folder: Path, whole: Path) -> Path:
    """Write files that cannot be replayed: damaged, empty, or not of a robot."""
    folder.mkdir()
    content = next(whole.rglob("*.mcap")).read_bytes()
    (folder / "truncated.mcap").write_bytes(content[: len(content) // 2])
    (folder / "empty.mcap").touch()
    (folder / "foreign.db3").write_text("a letter, not a bag\n")
    _write_words(folder / "chat.mcap", 3)
    _write_words(folder / "silent.mcap", 0)
    return folder


def _write_words(path: Path, count: int) -> None:
    """Write a bag of words, without a laser."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="tccm_ros")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema)
        for k in range(1, count + 1):
            word = b"\x00\x01\x00\x00\x03\x00\x00\x00hi\x00"
            writer.add_message(channel, k * 10**9, word, k * 10**9)
        writer.finish()


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of a result folder's files that do not depend on clock times."""
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.name not in VARYING}
