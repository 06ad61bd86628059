"""Effect of each named constant, and of some rules, from the points of tilt cycles to objects.

    python bench/ablate_cycles.py --out TABLE.md FILE.pkl ... [--only NAME ...]

FILE.pkl holds tilt cycles (`saved_cycles.py`), which are processed with one constant halved,
doubled or set to zero, or with one rule switched off. The rows are those of `saved_cycles`. A
constant of a kernel is compiled into it, and each trial compiles it anew. Trials that the table has
are not run again.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from ablation import (
    Change,
    add_row,
    constants,
    in_process,
    is_done,
    scaled,
    set_constant,
    set_everywhere,
)
from saved_cycles import load

from tccm_ros.kernels import kernel

FOLDERS = ("planes", "tabletop", "cuboids", "mapping")

FACTORS = {"half": 0.5, "double": 2.0, "zero": 0.0}

RULES: dict[str, tuple[str, Callable[..., Any]]] = {
    "horizontal_strips": ("tccm_ros.mapping.surface_message", lambda _, __, surface, ___: surface),
    "top_planes": (
        "tccm_ros.mapping.surface_message",
        lambda points, *_: np.full(len(points), -1, np.int64),
    ),
    "are_too_thick": (
        "tccm_ros.mapping.surface_message",
        lambda _, __, normals, *___: np.zeros(len(normals), np.bool_),
    ),
    "best_split": ("tccm_ros.planes.horizontal_strips", kernel(lambda sums, low, high: -1)),
    "find_vertical_runs": (
        "tccm_ros.planes.horizontal_strips",
        lambda *arguments: np.zeros(len(arguments[-1]), np.bool_),
    ),
    "_plane_of_runs": (
        "tccm_ros.planes.horizontal_strips",
        lambda _, __, runs: np.full(runs, -1, np.int64),
    ),
    "split_by_height": ("tccm_ros.tabletop.objects", lambda mean, *_: [np.arange(len(mean))]),
    "split_at_gaps": ("tccm_ros.tabletop.objects", lambda mean, *_: [np.arange(len(mean))]),
    "_carries": ("tccm_ros.tabletop.objects", lambda *_: False),
    "drop_edge_planes": (
        "tccm_ros.planes.search",
        kernel(lambda cuboids, blocks, labels, planes, is_vertical: planes),
    ),
    "reassign_inliers": (
        "tccm_ros.planes.search",
        kernel(lambda M, blocks, labels, planes, is_vertical: planes),
    ),
}
"""Rules that are switched off: module of a function, and what stands in for it."""


def apply(change: Change) -> None:
    """Scale a constant, or switch a rule off."""
    module, name, how = change
    if how == "off":
        set_everywhere(name, getattr(importlib.import_module(module), name), RULES[name][1])
    elif module:
        value = getattr(importlib.import_module(module), name)
        set_constant(module, name, scaled(value, FACTORS[how]))


def main() -> None:
    """Run the trials that the table does not have."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("saved", nargs="+", type=Path, help="FILE.pkl")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[], help="names of constants, rules, modules")
    parser.add_argument("--how", nargs="*", default=list(FACTORS), choices=list(FACTORS))
    arguments = parser.parse_args()
    recordings = [load(path) for path in arguments.saved]
    out, only = arguments.out, set(arguments.only)
    if not out.exists():
        titles = " | ".join(path.stem for path in arguments.saved)
        out.write_text(
            f"| module | name | change | {titles} |\n{'|---' * (len(recordings) + 3)}|\n"
        )
    changes = [("", "", "none")]
    for module, name, _ in constants(FOLDERS):
        if not only or only & {name, module.rsplit(".", 1)[-1]}:
            changes += [(module, name, how) for how in arguments.how]
    changes += [(rule[0], name, "off") for name, rule in RULES.items() if not only or name in only]
    for change in changes:
        if not is_done(change, out):
            rows = in_process(lambda c=change: apply(c), lambda saved: saved.row(), recordings)
            add_row(change, rows, out)


if __name__ == "__main__":
    main()
