"""Bags and messages: what the libraries need, and what ours need, for the same work.

    python bench/bench_bags.py [BAG ...]

The first table reads every message of a bag: rosbags' reader alone, `BagReader` on top of it, and
the reader of the mcap library. The second makes records of the messages of the bundled flat: by
rosbags' deserialize_cdr and the readers of messages, and straight from the bytes (`cdr.reading`).
The third writes a message: rosbags' serialize_cdr of objects, and `cdr.writing` of tables. Times
are those of the process, the shortest of `RUNS` runs.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.storage import StorageFile
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.ros.reading import READERS

BAGS = Path(__file__).resolve().parents[1] / "bags"
RUNS = 5
POINTS = 10_000
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = TypestoreMessages()
POINT, MARKER = "geometry_msgs/msg/Point", "visualization_msgs/msg/Marker"


def shortest(work: Callable[[], Any]) -> float:
    """Return the processor time of the shortest run, s."""
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def by_rosbags(bag: Path) -> None:
    """Read all messages by rosbags alone."""
    with Reader(bag) as reader:
        for _ in reader.messages():
            pass


def by_mcap(bag: Path) -> None:
    """Read all messages by the mcap library alone."""
    for path in bag.glob("*.mcap"):
        with path.open("rb") as stream:
            for _ in make_reader(stream, validate_crcs=True).iter_messages():
                pass


def by_bag_reader(bag: Path) -> int:
    """Read all messages as the pipeline does; return how many."""
    with BagReader(bag) as reader:
        return sum(1 for _ in reader.messages())


def reading_bags(bags: list[Path]) -> None:
    """Print the time that each reader needs for each bag."""
    print("| bag | messages | rosbags, ms | BagReader, ms | mcap, ms |\n|---|---|---|---|---|")
    for bag in bags:
        times = [shortest(lambda f=f: f(bag)) for f in (by_rosbags, by_bag_reader, by_mcap)]  # noqa: B023
        row = " | ".join(f"{1e3 * seconds:.0f}" for seconds in times)
        print(f"| {bag.name} | {by_bag_reader(bag)} | {row} |", flush=True)


def reading_messages() -> None:
    """Print the time of a message until it is a record."""
    (path,) = (BAGS / "flat").glob("*.mcap")
    file = StorageFile(path)
    print("\n| role | rosbags, us | and a record, us | straight, us |\n|---|---|---|---|")
    for role in ("odom", "joint_states", "scan"):
        msgtype, read, fast = READERS[role]
        assert fast is not None
        data = [
            message.data
            for message in file.messages([t for t in file.topics if t.topic == f"/{role}"])
        ]
        works: list[Callable[[bytes], Any]] = [
            lambda raw, kind=msgtype: STORE.deserialize_cdr(raw, kind),
            lambda raw, kind=msgtype, read=read: read(TYPES.deserialize(kind, raw)),
            fast,
        ]
        times = [shortest(lambda work=work: [work(raw) for raw in data]) for work in works]  # noqa: B023
        row = " | ".join(f"{1e6 * seconds / len(data):.1f}" for seconds in times)
        print(f"| {role} | {row} |", flush=True)
    file.close()


def writing_messages() -> None:
    """Print the time of a marker with many points, made and written."""
    xyz = np.random.default_rng(0).normal(size=(POINTS, 3))

    def of_objects() -> Any:
        points = [TYPES.make(POINT, x=x, y=y, z=z) for x, y, z in xyz.tolist()]
        return STORE.serialize_cdr(TYPES.make(MARKER, points=points), MARKER)

    def of_a_table() -> bytes:
        return TYPES.serialize(MARKER, TYPES.make(MARKER, points=TYPES.rows(POINT, xyz)))

    assert bytes(of_objects()) == bytes(of_a_table())
    objects, table = (1e3 * shortest(work) for work in (of_objects, of_a_table))
    print(f"\n| marker of {POINTS} points | objects, ms | table, ms |\n|---|---|---|")
    print(f"| | {objects:.1f} | {table:.2f} |")


if __name__ == "__main__":
    reading_bags([Path(a) for a in sys.argv[1:]] or sorted(p for p in BAGS.iterdir() if p.is_dir()))
    reading_messages()
    writing_messages()
