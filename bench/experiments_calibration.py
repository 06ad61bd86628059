"""The table of docs/calibration.md: calibrate recordings and print a row for each.

python bench/experiments_calibration.py --floor-z -0.3 BAG [BAG ...]
"""

from __future__ import annotations

import argparse

import numpy as np

from tccm_ros.calibrate import Calibration, calibrate
from tccm_ros.calibrate.judge import UNITS

HEADER = (
    "| recording | zero, deg | scale | roll, deg | height, mm | floor level, deg | "
    "ceiling level, deg | parallel, deg | floor cells, mm rms |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def row(found: Calibration) -> str:
    """Return one line of the table; before -> after where both are shown."""
    cells = [found.bag]
    for q in found.judgement.quantities[:4]:
        _, factor = UNITS[q.name]
        factor = 1.0 if q.name == "tilt_scale" else factor
        digits = 4 if q.name == "tilt_scale" else 1 if q.name == "height" else 2
        sigma = "open" if q.sigma is None else f"{q.sigma * factor:.{digits}f}"
        cells.append(f"{q.value * factor:.{digits}f} ± {sigma}")
    for before, after in (found.floor, found.ceiling):
        both = before is not None and after is not None
        cells.append(
            f"{np.rad2deg(before.tilt):.2f} → {np.rad2deg(after.tilt):.2f}" if both else "-"
        )
    angles = found.parallel
    cells.append("-" if angles is None else " → ".join(f"{np.rad2deg(a):.2f}" for a in angles))
    floor = found.floor[1]
    cells.append("-" if floor is None or floor.rms is None else f"{floor.rms * 1e3:.1f}")
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bags", nargs="+")
    parser.add_argument("--floor-z", type=float, default=None)
    arguments = parser.parse_args()
    print(HEADER)
    for bag in arguments.bags:
        print(row(calibrate(bag, floor_z=arguments.floor_z)), flush=True)


if __name__ == "__main__":
    main()
