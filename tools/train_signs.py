"""Train the classifier of door signs on rendered pictures and write its weights.

Usage: python tools/train_signs.py [--pictures N] [--out FILE]

Renders pictures (`tools/training_pictures.py`) with fixed seeds, takes the boxes that
saliency proposes in them, fits a linear SVM with squared hinge loss to their histograms of oriented
gradients, and chooses the threshold on further pictures: the largest that still accepts a box of
`KEPT` of the numbers that saliency found and that are tall enough to be read. No photograph is
used. Some minutes on two cores.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.optimize import minimize
from training_pictures import random_picture

from tccm_ros.arrays import Float32, Float64, Int64, UInt8
from tccm_ros.atomic import output_file
from tccm_ros.signs.classifier import WEIGHTS, SignClassifier
from tccm_ros.signs.hog import hog_features, region_patches
from tccm_ros.signs.saliency import salient_boxes

TRAINING_SEED, TEST_SEED = 1_000_000, 2_000_000
"""Seed of the first picture; those that follow count up."""

KEPT = 0.97
"""Part of the numbers found by saliency that the classifier is to keep. Chosen."""

MIN_HEIGHT = 10.0
"""Height (pixels) of the numbers for that. Chosen: the smallest box of saliency."""

COVERED = 0.75
"""A box shows a number if it covers at least this part of it. Chosen."""

TALLEST = 3.5
"""And if it is at most so many times as high as the number. Chosen."""

REGULARISATION = 1e-4
"""Weight of the squared norm of the weights. Chosen: the test loss changes by less than 2 % from
a third of it to three times as much."""

Boxes = tuple[UInt8, Float64, Int64, Int64, Float64]
"""A picture (H, W), its boxes (N, 4), +1 or -1 for each or 0 where that is not clear, for each the
number that it shows, -1 for none, and the heights of the numbers, pixels."""


def number_shown(boxes: Float64, numbers: Float64) -> tuple[Int64, Int64]:
    """Say which boxes show a number, and which of them show none.

    Parameters
    ----------
    boxes
        float64 (N, 4), left, top, right and bottom, pixels.
    numbers
        float64 (M, 4), boxes of the numbers.

    Returns
    -------
    shown : int64 (N,)
        Index of the number that a box shows, -1 for none.
    label : int64 (N,)
        1 where it shows a number, -1 where it shows none, 0 where that is not clear.
    """
    shown = np.full(len(boxes), -1)
    label = np.full(len(boxes), -1)
    for k, (left, top, right, bottom) in enumerate(numbers):
        width = np.minimum(boxes[:, 2], right) - np.maximum(boxes[:, 0], left)
        height = np.minimum(boxes[:, 3], bottom) - np.maximum(boxes[:, 1], top)
        covered = np.maximum(width, 0) * np.maximum(height, 0) / ((right - left) * (bottom - top))
        fits = (boxes[:, 3] - boxes[:, 1]) <= TALLEST * (bottom - top)
        label[(covered > 0.15) & (label < 0)] = 0
        good = (covered >= COVERED) & fits
        shown[good], label[good] = k, 1
    return shown, label


def boxes_of(seed: int) -> Boxes:
    """Return the boxes of one rendered picture."""
    rng = np.random.default_rng(seed)
    picture = random_picture(rng, int(rng.integers(0, 4)))
    gray = np.asarray(Image.fromarray(picture.pixels).convert("L"))
    boxes = salient_boxes(gray)
    low, high = picture.corners.min(axis=1), picture.corners.max(axis=1)
    shown, label = number_shown(boxes, np.hstack([low, high]).reshape(-1, 4))
    return gray, boxes, label, shown, high[:, 1] - low[:, 1]


def examples(seed: int) -> tuple[Float32, Int64]:
    """Return the features (N, F) of the boxes of one rendered picture, and +1 or -1 for each."""
    gray, boxes, label, _, _ = boxes_of(seed)
    clear = label != 0
    return hog_features(region_patches(gray, boxes[clear])), label[clear]


def collect(first: int, pictures: int) -> tuple[Float32, Int64]:
    """Return features and labels of many pictures."""
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(examples, range(first, first + pictures), chunksize=8))
    features, label = zip(*found, strict=True)
    return np.concatenate(features), np.concatenate(label)


def tested(classifier: SignClassifier, pictures: Iterable[Boxes]) -> tuple[Float64, Float64]:
    """Return the best score of each number that saliency found, and those of the other boxes."""
    best, others = [], []
    for gray, boxes, label, shown, heights in pictures:
        scores = classifier.scores(gray, boxes)
        others += scores[label < 0].tolist()
        found = [n for n in np.unique(shown[shown >= 0]) if heights[n] >= MIN_HEIGHT]
        best += [float(scores[shown == n].max()) for n in found]
    return np.array(best), np.array(others)


def fit(features: Float32, label: Int64) -> tuple[Float32, float]:
    """Return weights and bias of a linear SVM with squared hinge loss, both classes weighed alike.

    Parameters
    ----------
    features
        float32 (N, F).
    label
        int64 (N,), 1 or -1.
    """
    weight = np.where(label > 0, 0.5 / (label > 0).sum(), 0.5 / (label < 0).sum())
    signs = label.astype(np.float32)

    def loss(parameters: Float64) -> tuple[float, Float64]:
        w, b = parameters[:-1], parameters[-1]
        lack = np.maximum(1.0 - signs * (features @ w.astype(np.float32) + b), 0.0)
        slope = -2.0 * weight * lack * signs
        gradient = np.append(slope.astype(np.float32) @ features, slope.sum())
        gradient[:-1] += 2.0 * REGULARISATION * w
        return float(weight @ lack**2 + REGULARISATION * w @ w), gradient.astype(np.float64)

    start = np.zeros(features.shape[1] + 1)
    best = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 400}).x
    return best[:-1].astype(np.float32), float(best[-1])


def main() -> None:
    """Train and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pictures", type=int, default=600, help="to train on")
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    arguments = parser.parse_args()
    weights, bias = fit(*collect(TRAINING_SEED, arguments.pictures))
    test = map(boxes_of, range(TEST_SEED, TEST_SEED + arguments.pictures // 4))
    best, others = tested(SignClassifier(weights, bias, -np.inf), test)
    threshold = float(np.quantile(best, 1.0 - KEPT))
    false = others >= threshold
    with output_file(arguments.out) as file, open(file, "wb") as stream:
        np.savez(stream, weights=weights, bias=np.float64(bias), threshold=np.float64(threshold))
    print(f"{len(best)} numbers in {arguments.pictures // 4} pictures of the test")
    print(f"threshold {threshold:.3f}: {false.mean():.1%} of {len(false)} other boxes are accepted")


if __name__ == "__main__":
    main()
