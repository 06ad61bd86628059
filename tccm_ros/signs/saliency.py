"""Salient boxes of a picture, by the spectral residual at several scales.

X. Hou and L. Zhang, "Saliency detection: a spectral residual approach", CVPR 2007: the deviation of
the log spectrum from its local average marks salient regions.
"""

import numpy as np
from PIL import Image
from scipy import fft, ndimage

from tccm_ros.arrays import Float32, Float64, UInt8

WIDTHS = (96, 192, 288, 384)
"""Widths to which a picture is scaled, pixels. Hou and Zhang use 64; a plate of 12 pixels height in
960 x 720 needs the larger ones."""

BLUR_SIGMA = 2.0
"""Sigma of the Gaussian blur of a saliency map, pixels. Hou and Zhang use 2.5 to 8, at one
scale."""

THRESHOLDS = (2.0, 3.0)
"""Multiples of the mean saliency above which a pixel is salient. Hou and Zhang use 3."""

MIN_SIDE = 10.0
"""Minimum width and height of a box, pixels: smaller text is unreadable. Chosen."""

MAX_FRACTION = 0.4
"""Maximum width and height of a box, as a fraction of the picture's width. Chosen."""

ASPECTS = (0.4, 8.0)
"""Minimum and maximum width of a box in its heights. Chosen: a number of one to seven
characters."""


def spectral_residual(gray: Float32) -> Float32:
    """Return the saliency of each pixel of a picture.

    Parameters
    ----------
    gray
        float32 (H, W), brightness.

    Returns
    -------
    float32 (H, W)
        Saliency, without unit, blurred by `BLUR_SIGMA` pixels.
    """
    spectrum = fft.fft2(gray)
    amplitude = np.maximum(np.abs(spectrum), np.float32(1e-3))
    log_amplitude = np.log(amplitude)
    residual = log_amplitude - ndimage.uniform_filter(log_amplitude, 3, mode="wrap")
    salient = np.abs(fft.ifft2(np.exp(residual) * (spectrum / amplitude))) ** 2
    blurred: Float32 = ndimage.gaussian_filter(salient, BLUR_SIGMA)
    return blurred


def salient_boxes(gray: UInt8) -> Float64:
    """Return the salient boxes of a picture, those of the coarsest scale first.

    Parameters
    ----------
    gray
        uint8 (H, W), brightness.

    Returns
    -------
    float64 (N, 4)
        Left, top, right and bottom of each box, pixels of the picture.
    """
    height, width = gray.shape
    picture = Image.fromarray(gray)
    boxes = []
    for small in (w for w in WIDTHS if w <= width):
        scale = width / small
        size = (small, max(round(height / scale), 8))
        scaled = np.asarray(picture.resize(size, Image.Resampling.BOX), dtype=np.float32)
        saliency = spectral_residual(scaled)
        mean = float(saliency.mean())
        for threshold in THRESHOLDS:
            labels, _ = ndimage.label(saliency > threshold * mean)
            for rows, columns in ndimage.find_objects(labels):
                boxes.append((columns.start, rows.start, columns.stop, rows.stop) * np.array(scale))
    return _of_fitting_size(np.array(boxes).reshape(-1, 4), width)


def _of_fitting_size(boxes: Float64, picture_width: int) -> Float64:
    """Return the distinct boxes whose size fits a number."""
    width, height = boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]
    largest = MAX_FRACTION * picture_width
    fits = (np.minimum(width, height) >= MIN_SIDE) & (np.maximum(width, height) <= largest)
    fits &= (width >= ASPECTS[0] * height) & (width <= ASPECTS[1] * height)
    kept: Float64 = boxes[fits]
    _, first = np.unique(kept, axis=0, return_index=True)
    return kept[np.sort(first)]
