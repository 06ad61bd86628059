"""Compartments of racks at random, and insertions into them, against the solids of the simulator.

Usage: python bench/bench_racks.py [--seeds 12] [--sensors laser lidar camera]

Each rack has 2 to 6 boards, sides and a back of panels or of posts alone, objects on its boards
and, of three in ten, an open door. Its recording is replayed; what is in the cache is not made
again. A compartment that was looked into is to be found: its board is in the map, and its front and
the front or the lower side of the board above it were visible. A door leaf is to be found before
the front of such a compartment.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "test" / "helpers")]

from random_racks import (  # noqa: E402
    SENSORS,
    insertions,
    looked_into,
    mapped,
    open_doors,
    random_rack,
    same_space,
)

from tccm_ros.racks.compartment import FaceState  # noqa: E402

INSERTIONS = 120
"""Insertions at random into each compartment."""

BOARD_HEIGHT_M = 0.02
"""A surface so near to the height of a true board is that board."""


HEAD = (
    "sensor",
    "racks",
    "compartments",
    "boards measured",
    "looked into",
    "found",
    "missed",
    "false",
    "wrong faces",
    "doors: found / true / false",
    "clear height, mm: median / 90 % (within 10 mm)",
    "width (20 mm)",
    "depth (20 mm)",
    "boxes that cut a solid / points",
    "offered / free and visible",
)


def measure(seed: int, sensor: str, folder: Path) -> dict[str, object]:
    """Return errors and counts of one rack."""
    rack = random_rack(seed, sensor)
    outcome, T = mapped(rack, seed, folder)
    solution = outcome.solution
    errors, used, false, wrong = [], [], 0, 0
    for found in solution.compartments:
        true = same_space(found, rack.spaces, T)
        if true is None:
            false += 1
            continue
        used.append(id(true))
        errors.append(
            [found.height - true.height, found.width - true.width, found.depth - true.depth]
        )
        states = zip((found.left, found.right, found.back), true.closed)
        wrong += sum(
            state == (FaceState.OPEN if is_closed else FaceState.MEASURED)
            for state, is_closed in states
        )
    heights = np.array([s.height for s in solution.surfaces if s.label != "floor"])
    bottoms = [float((T @ space.T_world_front)[2, 3]) for space in rack.spaces]
    seen = [
        bool(len(heights) and np.abs(heights - bottom).min() < BOARD_HEIGHT_M) for bottom in bottoms
    ]
    into = [a and b for a, b in zip(seen, looked_into(rack, outcome, T, seed))]
    missed = sum(s and id(space) not in used for s, space in zip(into, rack.spaces))
    tally = insertions(rack, outcome, T, INSERTIONS, seed)
    return {
        "true": len(rack.spaces),
        "boards_measured": sum(seen),
        "looked_into": sum(into),
        "found": len(set(used)),
        "missed": missed,
        "false": false + len(used) - len(set(used)),
        "wrong_faces": wrong,
        "doors": open_doors(rack, solution.compartments, T),
        "errors": errors,
        "insertions": tally._asdict(),
    }


def row(sensor: str, results: list[dict[str, object]]) -> str:
    """Return the row of a kind of sensor."""
    total = {
        key: sum(r[key] for r in results)  # type: ignore[misc]
        for key in (
            "true",
            "boards_measured",
            "looked_into",
            "found",
            "missed",
            "false",
            "wrong_faces",
        )
    }
    errors = np.array([e for r in results for e in r["errors"]])  # type: ignore[attr-defined]
    errors = 1000.0 * errors.reshape(-1, 3)
    doors = " / ".join(str(sum(r["doors"][k] for r in results)) for k in range(3))  # type: ignore[index]
    cells = [sensor, len(results), *total.values(), doors]
    for k, limit in enumerate((10.0, 20.0, 20.0)):
        off = np.abs(errors[:, k])
        inside = f"{(off <= limit).mean():.0%}" if len(off) else ""
        cells.append(f"{np.median(errors[:, k]):+.0f} / {np.quantile(off, 0.9):.0f} ({inside})")
    tallies = [r["insertions"] for r in results]
    free, offered, cut, points = (
        sum(t[key] for t in tallies)  # type: ignore[index]
        for key in ("free", "offered", "cut", "points")
    )
    cells += [f"{cut} / {points}", f"{offered} / {free} ({offered / max(free, 1):.0%})"]
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
    parser.add_argument("--cache", type=Path, default=HERE.parent / "out" / "racks")
    args = parser.parse_args()
    args.cache.mkdir(parents=True, exist_ok=True)
    lines = []
    for sensor in args.sensors:
        results = []
        for seed in range(args.seeds):
            path = args.cache / f"{sensor}_{seed}.json"
            if not path.exists():
                path.write_text(json.dumps(measure(seed, sensor, args.cache / "bag")))
                print(path.name, path.read_text()[:160], file=sys.stderr, flush=True)
            results.append(json.loads(path.read_text()))
        lines.append(row(sensor, results))
    print("| " + " | ".join(HEAD) + " |")
    print("|" + "---|" * len(HEAD))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
