"""Histograms of oriented gradients (HOG) of regions scaled to one size.

N. Dalal and B. Triggs, "Histograms of oriented gradients for human detection", CVPR 2005: unsigned
gradients in nine bins, cells of 8 x 8 pixels, blocks of 2 x 2 cells, L2-hys normalisation.
"""

import math

import numpy as np
from PIL import Image

from tccm_ros.arrays import Float32, Float64, UInt8
from tccm_ros.kernels import kernel

PATCH_WIDTH, PATCH_HEIGHT = 64, 32
"""Size to which each region is scaled, pixels. Chosen: fits a number of three to five
characters."""

PATCH_SHAPE = (PATCH_HEIGHT, PATCH_WIDTH)
"""Shape of a patch array."""

CELL = 8
"""Edge of a cell, pixels (Dalal and Triggs)."""

BINS = 9
"""Bins of orientation over 180 deg (Dalal and Triggs)."""

MAX_COMPONENT = 0.2
"""Largest component of a normalised block before it is normalised again (Dalal and Triggs)."""

MARGIN = 0.15
"""Margin of a region on each side, as a fraction of the box's height. Chosen: keeps the edges of
salient characters in the region."""

N_FEATURES = (PATCH_WIDTH // CELL - 1) * (PATCH_HEIGHT // CELL - 1) * 4 * BINS
"""Length of a feature vector."""


def region_patches(gray: UInt8, boxes: Float64) -> UInt8:
    """Return the regions of boxes as patches of one size.

    Parameters
    ----------
    gray
        uint8 (H, W), brightness.
    boxes
        float64 (N, 4), left, top, right and bottom, pixels.

    Returns
    -------
    uint8 (N, `PATCH_HEIGHT`, `PATCH_WIDTH`)
    """
    picture = Image.fromarray(gray)
    height, width = gray.shape
    patches = np.empty((len(boxes), PATCH_HEIGHT, PATCH_WIDTH), np.uint8)
    size = (PATCH_WIDTH, PATCH_HEIGHT)
    for patch, (left, top, right, bottom) in zip(patches, boxes, strict=True):
        margin = MARGIN * (bottom - top)
        box = (
            max(left - margin, 0.0),
            max(top - margin, 0.0),
            min(right + margin, float(width)),
            min(bottom + margin, float(height)),
        )
        patch[:] = np.asarray(picture.resize(size, Image.Resampling.BILINEAR, box=box))
    return patches


@kernel
def hog_features(patches: UInt8) -> Float32:
    """Return the HOG features of patches.

    Parameters
    ----------
    patches
        uint8 (N, `PATCH_HEIGHT`, `PATCH_WIDTH`), brightness.

    Returns
    -------
    float32 (N, `N_FEATURES`)
        Blocks in row-major order; per block its four cells, per cell its nine bins from 0 to 180
        deg.
    """
    n = len(patches)
    rows, columns = PATCH_HEIGHT // CELL, PATCH_WIDTH // CELL
    features = np.zeros((n, N_FEATURES), np.float32)
    histograms = np.empty((rows, columns, BINS))
    block = np.empty(4 * BINS)
    for k in range(n):
        patch = patches[k]
        histograms[:] = 0.0
        for y in range(PATCH_HEIGHT):
            up, down = max(y - 1, 0), min(y + 1, PATCH_HEIGHT - 1)
            for x in range(PATCH_WIDTH):
                left, right = max(x - 1, 0), min(x + 1, PATCH_WIDTH - 1)
                dx = float(patch[y, right]) - float(patch[y, left])
                dy = float(patch[down, x]) - float(patch[up, x])
                length = math.sqrt(dx * dx + dy * dy)
                if length == 0.0:
                    continue
                place = math.atan2(dy, dx) / math.pi * BINS - 0.5
                low = math.floor(place)
                rest = place - low
                cell = histograms[y // CELL, x // CELL]
                cell[int(low) % BINS] += length * (1.0 - rest)
                cell[int(low + 1) % BINS] += length * rest
        start = 0
        for row in range(rows - 1):
            for column in range(columns - 1):
                i = 0
                for a in range(2):
                    for b in range(2):
                        for c in range(BINS):
                            block[i] = histograms[row + a, column + b, c]
                            i += 1
                _normalise(block)
                for i in range(4 * BINS):
                    features[k, start + i] = block[i]
                start += 4 * BINS
    return features


@kernel
def _normalise(block: Float64) -> None:
    """Scale a block to length one, cut its components and scale it again (L2-hys)."""
    length = math.sqrt(np.sum(block * block) + 1.0)
    for i in range(len(block)):
        block[i] = min(block[i] / length, MAX_COMPONENT)
    block /= math.sqrt(np.sum(block * block) + 1e-6)
