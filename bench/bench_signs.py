"""Door signs in photographs: losses of each stage and times, as a table for the documentation.

Usage: python bench/bench_signs.py [FOLDER] [--prefix a_] [--sides 512 576 640 736] [--only-regions]

The folder has pictures and `signs.json`: for each picture its file, the texts of its signs, the
pixel of each number and the height of its digits. A stage keeps a number when one of its boxes
covers the middle of the number and is at most `TALLEST` times as high; a sign is right when the
number is one of its words. Times are those that the processor spends, without reading the file: the
least of three, on one thread; "without text" are pictures in which nothing is read. The last line
compares with the finder over whole pictures: its part of the time does not depend on the machine.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from time import process_time
from typing import TypeVar

import numpy as np
from PIL import Image

from tccm_ros.arrays import Float64, UInt8
from tccm_ros.config.signs import SignsConfig
from tccm_ros.signs.detector import MAX_SCALE, Detector, SignDetector
from tccm_ros.signs.measurement import DetectedSign
from tccm_ros.signs.reading import FINDER_STEP, TextReader
from tccm_ros.signs.regions import text_regions
from tccm_ros.signs.saliency_detector import SaliencyDetector

TALLEST = 6.0
REPEATS = 3

T = TypeVar("T")
Picture = tuple[str, UInt8, list[dict]]
Stages = Callable[[UInt8], dict[str, Float64]]


def keeps(boxes: Float64, sign: dict, tallest: float = TALLEST) -> bool:
    """Return whether one of the boxes shows a number."""
    (x, y), height = sign["center"], sign["height"]
    inside = (boxes[:, 0] < x) & (boxes[:, 2] > x) & (boxes[:, 1] < y) & (boxes[:, 3] > y)
    heights = boxes[:, 3] - boxes[:, 1]
    return bool((inside & (heights > 0.7 * height) & (heights < tallest * height)).any())


def pictures_in(folder: Path, prefix: str) -> Iterable[Picture]:
    """Yield name, pixels and signs of each picture of a folder."""
    for entry in json.loads((folder / "signs.json").read_text()):
        if entry["file"].startswith(prefix):
            pixels = np.asarray(Image.open(folder / entry["file"]).convert("RGB"))
            yield entry["file"], pixels, entry["signs"]


def saliency_stages(detector: SaliencyDetector) -> Stages:
    """Return the boxes that the stages of the paper's detector keep."""

    def stages(pixels: UInt8) -> dict[str, Float64]:
        found = detector.propose(np.asarray(Image.fromarray(pixels).convert("L")))
        above = found.boxes[found.scores >= detector.threshold]
        return {"salient": found.boxes, "classified": above, "twelve best": found.accepted}

    return stages


def text_stages(reader: TextReader, side: int) -> Stages:
    """Return the boxes that the stages of the detector by text keep."""

    def stages(pixels: UInt8) -> dict[str, Float64]:
        picture = Image.fromarray(pixels)
        scale = min(side / min(picture.size), MAX_SCALE)
        own = np.array(picture.size)
        size = np.ceil(scale * own / FINDER_STEP).astype(int) * FINDER_STEP
        gray = np.asarray(picture.resize(tuple(size.tolist())).convert("L"))
        regions = text_regions(gray) * np.tile(own / size, 2)
        lines = reader.find(picture, scale, everywhere=False)
        return {
            "in regions": regions,
            "line found": np.array([line.bounds for line in lines]).reshape(-1, 4),
        }

    return stages


def right_signs(signs: list[DetectedSign], truth: list[dict]) -> int:
    """Return how many true numbers are a word of a sign, each of another one."""
    left = [sign.text.upper().split() for sign in signs]
    right = 0
    for sign in truth:
        own = [words for words in left if sign["text"] in words]
        right += bool(own)
        if own:
            left.remove(own[0])
    return right


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Return what a function returns, and the least time of several (s)."""
    times = []
    for _ in range(REPEATS):
        start = process_time()
        found = work()
        times.append(process_time() - start)
    return found, min(times)


def compare_with_whole(reader: TextReader, side: int, pictures: Iterable[Picture]) -> None:
    """Print how long a detector and its finder take beside the finder over whole pictures."""
    detector, times = SignDetector(side), []
    for _, pixels, truth in pictures:
        if truth:
            picture = Image.fromarray(pixels)
            scale = min(side / min(picture.size), MAX_SCALE)
            works = (
                lambda pixels=pixels: detector.search(pixels),
                lambda p=picture, s=scale: reader.find(p, s, everywhere=False),
                lambda p=picture, s=scale: reader.find(p, s),
            )
            times.append([timed(work)[1] for work in works])
    search, parts, whole = 1e3 * np.median(times, axis=0)
    print(
        f"pictures with signs, median ms at {side}: detector {search:.0f}, its finder {parts:.0f}, "
        f"finder over whole pictures {whole:.0f}; detector / whole {search / whole:.2f}"
    )


def row(name: str, detector: Detector, stages: Stages, pictures: Iterable[Picture]) -> None:
    """Print a row of the table, and before it each loss and each false sign."""
    kept: dict[str, int] = {}
    numbers = right = false = 0
    with_text, without = [], []
    for file, pixels, truth in pictures:
        for stage, boxes in stages(pixels).items():
            tallest = np.inf if stage == "in regions" else TALLEST
            hits = [keeps(boxes, sign, tallest) for sign in truth]
            kept[stage] = kept.get(stage, 0) + sum(hits)
        found, seconds = timed(lambda pixels=pixels: detector.search(pixels))
        (with_text if found.signs or found.refused else without).append(seconds)
        hits_read = right_signs(found.signs, truth)
        numbers, right = numbers + len(truth), right + hits_read
        false += len(found.signs) - hits_read
        if hits_read < max(len(truth), len(found.signs)):
            print(f"  {file}: {[s['text'] for s in truth]} read {[s.text for s in found.signs]}")
    stages_text = ", ".join(f"{stage} {n}" for stage, n in kept.items())
    medians = [f"{1e3 * np.median(t):.0f}" if t else "-" for t in (with_text, without)]
    longest = 1e3 * max(with_text + without)
    print(
        f"| {name} | {stages_text} | {right} of {numbers} | {false} | {' / '.join(medians)} | "
        f"{longest:.0f} |",
        flush=True,
    )


def main() -> None:
    """Run over the photographs and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    shared = Path(os.environ.get("TCCM_SHARED", Path(__file__).resolve().parents[2] / "shared"))
    parser.add_argument("folder", type=Path, nargs="?", default=shared / "data" / "signs")
    parser.add_argument("--prefix", default="", help="only files whose names begin so")
    parser.add_argument("--sides", type=int, nargs="+", default=[512, 576, 640, 736])
    parser.add_argument("--only-regions", action="store_true", help="the last line alone")
    arguments = parser.parse_args()
    if not (arguments.folder / "signs.json").exists():
        print(f"skipped, there are no photographs in {arguments.folder}")
        return
    pictures = list(pictures_in(arguments.folder, arguments.prefix))
    reader = TextReader()
    if arguments.only_regions:
        compare_with_whole(reader, SignsConfig().detector_side, pictures)
        return
    print("| detector | numbers kept | read | false | median ms with / without text | max ms |")
    print("|---|---|---|---|---|---|")
    published = SaliencyDetector()
    row("published", published, saliency_stages(published), pictures)
    for side in sorted({*arguments.sides, SignsConfig().detector_side}):
        row(f"text, {side}", SignDetector(side), text_stages(reader, side), pictures)
    compare_with_whole(reader, SignsConfig().detector_side, pictures)


if __name__ == "__main__":
    main()
