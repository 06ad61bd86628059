"""The drives that experiments on the graph share: worlds of the simulator, and public logs.

A world is the bundled bag `flat`, one of `tccm simulate`, a flat at random by its seed
(`random-1`), or a recording of the shared folder that has its truth (`sim2_flat`).
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from random_flats import random_flat

from tccm_sim.engine import Simulation
from tccm_sim.recording import record, simulate
from tccm_sim.worlds import WORLDS

HERE = Path(__file__).resolve().parent

LOGS = ("intel", "mit-csail")

RANDOM = "random-"
"""What the names of flats at random begin with; their seeds follow."""


def run_drives(
    description: str,
    head: tuple[str, ...],
    simulated: Callable[[str, Path, Path], None],
    recorded: Callable[[Path, Path], None],
) -> None:
    """Print a table of the drives that the command line names, all by default.

    Parameters
    ----------
    description
        For the help text.
    head
        The table's columns.
    simulated, recorded
        Print the rows of a world (of its name and bag), and of a log; both get a folder to write
        to. Recordings that are not there are left out.
    """
    parser = argparse.ArgumentParser(description=description)
    default = os.environ.get("TCCM_SHARED", HERE.parents[1] / "shared")
    parser.add_argument("--shared", type=Path, default=Path(default))
    parser.add_argument("--worlds", nargs="*", default=["flat", "ring", *LOGS])
    options = parser.parse_args()
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    with tempfile.TemporaryDirectory() as name:
        for world in options.worlds:
            if world not in LOGS:
                bag = bag_of(world, Path(name), options.shared)
                if bag.exists():
                    simulated(world, bag, Path(name))
                continue
            log = options.shared / "data" / "carmen" / f"{world}.clf.bz2"
            if log.exists():
                recorded(log, Path(name))


def bag_of(world: str, folder: Path, shared: Path) -> Path:
    """Return the bag of a world with its truth, made in `folder` where it is not a recording."""
    if world == "flat":
        return HERE.parent / "bags" / world
    if world in WORLDS:
        return simulate(world, folder / world)
    if world.startswith(RANDOM):
        seed = int(world.removeprefix(RANDOM))
        return record(Simulation(random_flat(seed), seed), folder / world)
    return shared / "data" / "bags" / world
