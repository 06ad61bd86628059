"""Rendered pictures of door signs."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from training_pictures import homography, map_points, random_picture


def test_the_same_seed_gives_the_same_picture():
    first, second = (random_picture(np.random.default_rng(5), 2) for _ in range(2))
    assert np.array_equal(first.pixels, second.pixels)
    assert first.numbers == second.numbers
    assert first.pixels.shape == (720, 960, 3)
    assert first.corners.shape == (2, 4, 2)


def test_the_number_is_where_the_truth_says():
    for seed in range(6):
        picture = random_picture(np.random.default_rng(seed), 1)
        low, high = picture.corners[0].min(axis=0), picture.corners[0].max(axis=0)
        left, top = np.maximum(np.floor(low).astype(int), 0)
        right, bottom = np.ceil(high).astype(int)
        patch = picture.pixels[top:bottom, left:right].astype(float).mean(axis=2)
        if patch.size:
            assert patch.std() > 5.0  # ink on a face


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_homography_maps_its_points_and_back(seed):
    rng = np.random.default_rng(seed)
    source = np.array([[0.0, 0], [10, 0], [10, 8], [0, 8]])
    target = source + rng.uniform(-2, 2, (4, 2))
    h, back = homography(source, target), homography(target, source)
    inner = rng.uniform(1, 7, (5, 2))
    assert np.allclose(map_points(h, source), target, atol=1e-6)
    assert np.allclose(map_points(back, map_points(h, inner)), inner, atol=1e-6)
