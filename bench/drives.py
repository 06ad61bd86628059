"""The drives that experiments on the graph share: worlds of the simulator, and public logs."""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent

LOGS = ("intel", "mit-csail")


def run_drives(
    description: str,
    head: tuple[str, ...],
    simulated: Callable[[str, Path], None],
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
        Print the rows of a world, and of a log; both get a folder to write to.
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
                simulated(world, Path(name))
                continue
            log = options.shared / "data" / "carmen" / f"{world}.clf.bz2"
            if log.exists():
                recorded(log, Path(name))
