"""Goals with cancellations, dropouts and late commands: contacts, reasons, time to rest.

Usage: python bench/bench_approach_faults.py OUT.jsonl [--seeds 20] [--first 0]

Each seed is a line of OUT.jsonl with eight goals; seeds that are in it are not run again. The state
machines are stepped in simulated time, without DDS, by `FaultyDrive` of the tests: a tenth of the
commands are late by up to 0.5 s, and the base has a watchdog of 0.25 s.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "helpers")]

from approach_faults import FaultyDrive  # noqa: E402

GOALS = 8


def goals_of(seed: int) -> dict[str, object]:
    """Return the figures of one seed."""
    drive = FaultyDrive(seed)
    for _ in range(GOALS):
        drive.goal()
    return {
        "seed": seed,
        "contacts": drive.base.contacts,
        "reasons": Counter(outcome.reason.name for outcome in drive.outcomes),
        "rest_s": [round(t, 3) for t in drive.rest_s],
    }


def summary(rows: list[dict]) -> str:
    """Return contacts, reasons, and the times from a cancellation while driving to rest."""
    lines = [f"{len(rows)} seeds, {sum(r['contacts'] > 0 for r in rows)} with contacts"]
    lines.append(str(dict(sum((Counter(r["reasons"]) for r in rows), Counter()))))
    times = [t for r in rows for t in r["rest_s"]]
    if times:
        p50, p99 = np.percentile(times, [50, 99])
        lines.append(
            f"{len(times)} cancellations while driving, base at rest after {p50:.2f} s (median), "
            f"{p99:.2f} s (99 %), {max(times):.2f} s (maximum)"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    rows = []
    if options.out.exists():
        rows = [json.loads(line) for line in options.out.read_text().splitlines()]
    done = {row["seed"] for row in rows}
    for seed in range(options.first, options.first + options.seeds):
        if seed not in done:
            rows.append(goals_of(seed))
            with options.out.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(summary(rows))


if __name__ == "__main__":
    main()
