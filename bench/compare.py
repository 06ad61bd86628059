"""Hold the numbers of two runs of the benchmarks against each other.

    python bench/compare.py BEFORE.json AFTER.json [--above 1.1]

Prints the rows that both files have, with the ratio after / before; with `--above`, those only that
differ by more than this factor. Times of two machines, or of one machine at two loads, are not to
be compared: the differences of machine and versions are printed first. Ratios to peers are.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

Key = tuple[str, str, str, str]


def numbers(content: dict[str, Any]) -> dict[Key, float]:
    """Return the numbers of a file by benchmark, table, row and column."""
    return {
        (name, value["table"], value["row"], value["column"]): value["value"]
        for name, result in content["benchmarks"].items()
        for value in result["values"]
    }


def differences(before: Any, after: Any, at: str = "") -> list[str]:
    """Return where two descriptions of a machine differ."""
    if isinstance(before, dict) and isinstance(after, dict):
        keys = sorted(set(before) | set(after))
        return [d for k in keys for d in differences(before.get(k), after.get(k), f"{at} {k}")]
    return [] if before == after else [f"{at.strip()}: {before} before, {after} after"]


def main() -> int:
    """Print the comparison; return 1 if a file cannot be read."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--above", type=float, default=1.0, help="least factor that is shown")
    options = parser.parse_args()
    try:
        before, after = (json.loads(p.read_text()) for p in (options.before, options.after))
        old, new = numbers(before), numbers(after)
    except (OSError, ValueError, KeyError, TypeError) as error:
        print(f"not the results of bench/run.py: {error}", file=sys.stderr)
        return 1
    for line in differences(before["machine"], after["machine"]):
        print(f"- {line}")
    print("\n| benchmark | row | column | before | after | after / before |")
    print("|---|---|---|---|---|---|")
    for key in (k for k in old if k in new):
        name, table, row, column = key
        ratio = new[key] / old[key] if old[key] else float(new[key] == old[key])
        if max(ratio, 1.0 / ratio if ratio > 0.0 else float("inf")) >= options.above:
            place = f"{name}: {table}" if table else name
            print(f"| {place} | {row} | {column} | {old[key]:g} | {new[key]:g} | {ratio:.2f} |")
    only = len(set(old) ^ set(new))
    print(f"\n{len(set(old) & set(new))} numbers in both files, {only} in one of them")
    return 0


if __name__ == "__main__":
    sys.exit(main())
