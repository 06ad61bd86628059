"""Histograms of oriented gradients, against a plain twin."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.signs.hog import hog_features, region_patches

BINS = 9  # over 180 deg (Dalal and Triggs)
CELL = 8  # pixels (Dalal and Triggs)
N_FEATURES = 7 * 3 * 4 * 9  # blocks of 2 x 2 cells in 8 x 4 cells, 9 bins each
PATCH_HEIGHT = 32  # pixels
PATCH_WIDTH = 64  # pixels


def twin(patch):
    padded = np.pad(patch.astype(float), 1, mode="edge")
    dx = padded[1:-1, 2:] - padded[1:-1, :-2]
    dy = padded[2:, 1:-1] - padded[:-2, 1:-1]
    length, place = np.hypot(dx, dy), np.arctan2(dy, dx) / np.pi * BINS - 0.5
    low = np.floor(place)
    histogram = np.zeros((PATCH_HEIGHT // CELL, PATCH_WIDTH // CELL, BINS))
    y, x = np.mgrid[0:PATCH_HEIGHT, 0:PATCH_WIDTH] // CELL
    np.add.at(histogram, (y, x, low.astype(int) % BINS), length * (1 - place + low))
    np.add.at(histogram, (y, x, (low.astype(int) + 1) % BINS), length * (place - low))
    blocks = []
    for row in range(histogram.shape[0] - 1):
        for column in range(histogram.shape[1] - 1):
            block = histogram[row : row + 2, column : column + 2].ravel()
            block = np.minimum(block / np.sqrt(block @ block + 1.0), 0.2)
            blocks.append(block / np.sqrt(block @ block + 1e-6))
    return np.concatenate(blocks)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 255))
def test_features_equal_those_of_the_twin(seed, top):
    shape = (2, PATCH_HEIGHT, PATCH_WIDTH)
    patches = np.random.default_rng(seed).integers(0, top + 1, shape).astype(np.uint8)
    features = hog_features(patches)
    assert features.shape == (2, N_FEATURES)
    assert np.allclose(features, [twin(p) for p in patches], atol=1e-5)


def test_a_plain_patch_has_no_features_and_inverted_ink_has_the_same():
    patch = np.full((1, PATCH_HEIGHT, PATCH_WIDTH), 77, np.uint8)
    assert not hog_features(patch).any()
    patch[0, 8:20, 10:40] = 200
    assert np.allclose(hog_features(patch), hog_features(255 - patch), atol=1e-5)


def test_a_region_is_scaled_to_one_size_also_at_the_edge_of_the_picture():
    gray = np.zeros((100, 200), np.uint8)
    gray[:, 100:] = 255
    patches = region_patches(gray, np.array([[0.0, 0, 200, 100], [150, 60, 200, 100]]))
    assert patches.shape == (2, PATCH_HEIGHT, PATCH_WIDTH)
    assert patches[0, :, :24].max() == 0
    assert patches[0, :, 40:].min() == 255
    assert patches[1].min() == 255
