"""Regions of a picture that may contain text: blocks with corners, no flat areas or edges.

J. Shi and C. Tomasi, "Good features to track", CVPR 1994: the smaller eigenvalue of the structure
tensor is large where a window has gradients in two directions. Text has them everywhere.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from tccm_ros.arrays import Bool, Float32, Int64, UInt8

BLOCK = 16
"""Edge of a block, pixels. Chosen: two characters of the smallest readable text."""

REDUCTIONS = (2, 4)
"""Factors by which a picture is reduced before gradients are computed. Chosen: for small text, and
for large blurred text."""

MIN_GRADIENT = 4.0
"""Minimum gradient of a block perpendicular to its main gradient, over two pixels, of 255. Chosen:
a third of that of a plate in the dark."""

NOISE_FACTOR, NOISE_PERCENTILE = 2.5, 20.0
"""Minimum multiple of the noise level, and the percentile of blocks that defines the noise level.
Chosen: numbers in two buildings have a factor of at least 3.7 (bench_signs.py)."""


MARGIN = 0.1
"""Margin of a region on each side, as a fraction of its shorter side. Chosen: the outer strokes of
large characters have no corners."""


def text_regions(gray: UInt8) -> Int64:
    """Return the regions of a picture that may contain text.

    Parameters
    ----------
    gray
        uint8 (H, W), brightness; H and W are multiples of `BLOCK`.

    Returns
    -------
    int64 (N, 4)
        Left, top, right and bottom of each region, pixels; multiples of `BLOCK`. No region contains
        another; each has a margin of one block.
    """
    height, width = gray.shape
    busy = np.zeros((height // BLOCK, width // BLOCK), bool)
    for k in REDUCTIONS:
        marked = np.kron(_with_corners(_reduced(gray, k)), np.ones((k, k), bool))
        rows, columns = min(len(busy), len(marked)), min(busy.shape[1], marked.shape[1])
        busy[:rows, :columns] |= marked[:rows, :columns]
    around = np.ones((3, 3), bool)
    labels, _ = ndimage.label(ndimage.binary_dilation(busy, around), around)
    found = [(c.start, r.start, c.stop, r.stop) for r, c in ndimage.find_objects(labels)]
    boxes = np.array(found, np.int64).reshape(-1, 4)
    margin = np.rint(MARGIN * (boxes[:, 2:] - boxes[:, :2]).min(axis=1, keepdims=True))
    low = np.maximum(boxes[:, :2] - margin, 0)
    high = np.minimum(boxes[:, 2:] + margin, busy.shape[::-1])
    return BLOCK * _merged(np.hstack([low, high]).astype(np.int64))


def _reduced(gray: UInt8, k: int) -> Float32:
    """Return the means of blocks of k x k pixels; a rest at the right and lower edge is dropped."""
    height, width = gray.shape[0] // k, gray.shape[1] // k
    rows = gray[: height * k, : width * k].reshape(height, k, -1).sum(axis=1, dtype=np.uint32)
    # A sum over the last axis, of k numbers each, would be several times slower.
    sums = np.sum([rows[:, j::k] for j in range(k)], axis=0, dtype=np.uint32)
    return np.asarray(sums / (k * k), np.float32)


def _with_corners(gray: Float32) -> Bool:
    """Return a mask of the blocks of a picture that have gradients in two directions."""
    gx, gy = np.zeros_like(gray), np.zeros_like(gray)
    gx[:, 1:-1] = gray[:, 2:] - gray[:, :-2]
    gy[1:-1] = gray[2:] - gray[:-2]
    rows, columns = -(-gray.shape[0] // BLOCK), -(-gray.shape[1] // BLOCK)
    starts = BLOCK * np.arange(rows), BLOCK * np.arange(columns)

    def mean(values: Float32) -> Float32:
        sums = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
        return np.asarray(sums / BLOCK**2, np.float32)

    a, b, c = mean(gx * gx), mean(gy * gy), mean(gx * gy)
    smaller = np.sqrt(np.maximum(0.5 * (a + b - np.sqrt((a - b) ** 2 + 4.0 * c * c)), 0.0))
    noise = float(np.percentile(smaller, NOISE_PERCENTILE))
    return np.asarray(smaller > max(MIN_GRADIENT, NOISE_FACTOR * noise))


def _merged(boxes: Int64) -> Int64:
    """Return boxes (N, 4), merged where a bounding box is no larger than the sum of two areas."""
    done: list[Int64] = []
    for box in boxes:
        k = 0
        while k < len(done):
            union = np.append(np.minimum(box[:2], done[k][:2]), np.maximum(box[2:], done[k][2:]))
            if _area(union) <= _area(box) + _area(done[k]):
                box = union
                del done[k]
                k = 0
            else:
                k += 1
        done.append(box)
    return np.array(done, np.int64).reshape(-1, 4)


def _area(box: Int64) -> int:
    return int((box[2] - box[0]) * (box[3] - box[1]))
