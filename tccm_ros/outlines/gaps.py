"""Filling of short gaps between the samples of a plane.

Cells are linked as in `cuboids.linking`: a gap shorter than twice the local sample spacing is
filled and a longer one stays open.
"""

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.cuboids.linking import PATCH_BITS, STEPS, spacing
from tccm_ros.kernels import kernel
from tccm_ros.outlines.raster import EMPTY, FILLED, SAMPLE


@kernel
def patch_of(a: int, b: int, columns: int) -> int:
    """Return the index of a cell's patch, the region in which the spacing is estimated.

    Parameters
    ----------
    a, b
        Row and column of the cell.
    columns
        Number of columns of the raster.
    """
    return (a >> PATCH_BITS) * ((columns >> PATCH_BITS) + 1) + (b >> PATCH_BITS)


@kernel
def find_gaps(raster: Int32, samples: int) -> tuple[Int32, Float64, Float64]:
    """Find the gaps between the samples in rows and columns, and the sample spacing.

    Parameters
    ----------
    raster
        int32 (A, B), with samples.
    samples
        Number of samples.

    Returns
    -------
    gaps : int32 (G, 4)
        Sample behind which the gap is (a, b), step to the sample before it, and axis: 0 along a,
        1 along b.
    usual_a, usual_b : float64 (P,)
        Spacing of the samples of each patch along each axis, cells, 1 or more.
    """
    rows, columns = raster.shape
    patches = patch_of(rows - 1, columns - 1, columns) + 1
    steps = np.zeros((2, patches + 1, STEPS), np.int32)
    last_a = np.full(columns, -STEPS, np.int64)
    gaps, used = np.empty((2 * samples + 1, 4), np.int32), 0
    for a in range(rows):
        last_b = -STEPS
        for b in range(columns):
            if raster[a, b] != SAMPLE:
                continue
            patch = patch_of(a, b, columns)
            step_a, step_b = a - last_a[b], b - last_b
            last_a[b], last_b = a, b
            # Write always and increment conditionally: faster than a branch. Entry 0 of a histogram
            # collects steps that are no links.
            steps[0, patch, step_a if step_a < STEPS else 0] += 1
            steps[1, patch, step_b if step_b < STEPS else 0] += 1
            gaps[used, 0], gaps[used, 1], gaps[used, 2], gaps[used, 3] = a, b, step_a, 0
            used += 1 < step_a < STEPS
            gaps[used, 0], gaps[used, 1], gaps[used, 2], gaps[used, 3] = a, b, step_b, 1
            used += 1 < step_b < STEPS
    steps[:, :, 0] = 0
    return gaps[:used], usual_steps(steps[0]), usual_steps(steps[1])


@kernel
def usual_steps(steps: Int32) -> Float64:
    """Return the typical step of each patch, float64 (P,), from histograms int32 (P + 1, STEPS).

    The last histogram is the sum of all patches, for patches with too few steps; it is filled here.
    """
    patches = len(steps) - 1
    found = np.zeros(patches, np.bool_)
    for p in range(patches):
        for k in range(1, STEPS):
            if steps[p, k]:
                steps[patches, k] += steps[p, k]
                found[p] = True
    overall = max(spacing(steps[patches], 1.0), 1.0)
    usual = np.full(patches, overall)
    for p in range(patches):
        if found[p]:
            usual[p] = max(spacing(steps[p], overall), 1.0)
    return usual


@kernel
def fill_gaps(raster: Int32, gaps: Int32, usual_a: Float64, usual_b: Float64) -> None:
    """Fill gaps shorter than twice the spacing of their patch.

    Parameters
    ----------
    raster
        int32 (A, B), changed: cells of filled gaps become FILLED.
    gaps, usual_a, usual_b
        Result of `find_gaps`.
    """
    columns = raster.shape[1]
    for k in range(len(gaps)):
        a, b, step = gaps[k, 0], gaps[k, 1], gaps[k, 2]
        usual = usual_b if gaps[k, 3] == 1 else usual_a
        if step >= 2.0 * usual[patch_of(a, b, columns)]:
            continue
        for back in range(1, step):
            if gaps[k, 3] == 1:
                raster[a, b - back] = FILLED
            else:
                raster[a - back, b] = FILLED


@kernel
def close_combs(raster: Int32, usual_a: float, usual_b: float) -> None:
    """Fill gaps between full cells that are shorter than twice the largest spacing.

    Scan lines with alternating samples leave combs, which are visible only along the other axis.

    Parameters
    ----------
    raster
        int32 (A, B), changed: cells of filled gaps become FILLED.
    usual_a, usual_b
        Largest spacing of the samples along each axis, cells.
    """
    rows, columns = raster.shape
    if usual_b > 1.0:
        for a in range(rows):
            last = -STEPS
            for b in range(columns):
                if raster[a, b] != EMPTY:
                    if 1 < b - last < 2.0 * usual_b:
                        raster[a, last + 1 : b] = FILLED
                    last = b
    if usual_a > 1.0:
        behind = np.full(columns, -STEPS, np.int32)
        for a in range(rows):
            for b in range(columns):
                if raster[a, b] != EMPTY:
                    if 1 < a - behind[b] < 2.0 * usual_a:
                        raster[behind[b] + 1 : a, b] = FILLED
                    behind[b] = a
