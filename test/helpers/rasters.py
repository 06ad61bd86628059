"""Rasters of samples, for tests."""

import numpy as np

from tccm_ros.outlines.raster import EMPTY, SAMPLE

MARGIN = 6  # empty cells around the samples


def rastered(mask):
    """Return a raster with a sample where the mask is true."""
    return np.pad(np.where(mask, SAMPLE, EMPTY).astype(np.int32), MARGIN, constant_values=EMPTY)
