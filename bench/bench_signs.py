"""Door signs in photographs: what each stage keeps, what is read, and how long it takes.

Usage: python bench/bench_signs.py [FOLDER] [--prefix a_]

FOLDER holds photographs and signs.json: of each the texts of its signs, the pixel of each number
and the height of its digits. A stage keeps a number when one of its boxes covers the middle of the
number and is at most `TALLEST` times as high; a sign is right when the number is one of its words.
Times are those that the processor spends in `SaliencyDetector.detect`, without reading the file:
the least of three.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from time import process_time

import numpy as np
from PIL import Image

from tccm_ros.arrays import Float64
from tccm_ros.signs.saliency_detector import SaliencyDetector

TALLEST = 6.0


def keeps(boxes: Float64, sign: dict) -> bool:
    """Return whether one of the boxes shows a number."""
    (x, y), height = sign["center"], sign["height"]
    inside = (boxes[:, 0] < x) & (boxes[:, 2] > x) & (boxes[:, 1] < y) & (boxes[:, 3] > y)
    fits = (boxes[:, 3] - boxes[:, 1] > 0.7 * height) & (
        boxes[:, 3] - boxes[:, 1] < TALLEST * height
    )
    return bool((inside & fits).any())


def main() -> None:
    """Run over the photographs and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    shared = Path(os.environ.get("TCCM_SHARED", Path(__file__).resolve().parents[2] / "shared"))
    parser.add_argument("folder", type=Path, nargs="?", default=shared / "data" / "signs")
    parser.add_argument("--prefix", default="", help="only files whose names begin so")
    arguments = parser.parse_args()
    if not (arguments.folder / "signs.json").exists():
        print(f"skipped, there are no photographs in {arguments.folder}")
        return
    truth = json.loads((arguments.folder / "signs.json").read_text())
    detector = SaliencyDetector()
    counts = dict.fromkeys(("numbers", "salient", "classified", "top", "read", "false"), 0)
    times, empty = [], []
    for picture in (p for p in truth if p["file"].startswith(arguments.prefix)):
        pixels = np.asarray(Image.open(arguments.folder / picture["file"]).convert("RGB"))
        gray = np.asarray(Image.fromarray(pixels).convert("L"))
        found = detector.propose(gray)
        above = found.boxes[found.scores >= detector.threshold]
        spent = []
        for _ in range(3):
            start = process_time()
            signs = detector.detect(pixels)
            spent.append(process_time() - start)
        (times if len(found.accepted) else empty).append(min(spent))
        right = [False] * len(signs)
        for sign in picture["signs"]:
            stages = {
                "numbers": True,
                "salient": keeps(found.boxes, sign),
                "classified": keeps(above, sign),
                "top": keeps(found.accepted, sign),
                "read": False,
            }
            for k, seen in enumerate(signs):
                if not right[k] and sign["text"] in seen.text.upper().split():
                    stages["read"] = right[k] = True
            for name, kept in stages.items():
                counts[name] += kept
            missed = [name for name, kept in stages.items() if not kept]
            if missed:
                texts = [s.text for s in signs]
                print(f"{picture['file']}: {sign['text']} lost by {missed}; read: {texts}")
        for ok, seen in zip(right, signs):
            if not ok:
                counts["false"] += 1
                print(f"{picture['file']}: false {seen.text!r} at {seen.pixel.round()}")
    print(" ".join(f"{name} {n}" for name, n in counts.items()))
    for name, seconds in (("something accepted", times), ("nothing accepted", empty)):
        if seconds:
            print(
                f"{name}: {len(seconds)} pictures, median {1e3 * np.median(seconds):.0f} ms, "
                f"max {1e3 * max(seconds):.0f} ms"
            )


if __name__ == "__main__":
    main()
