"""Spectral residual saliency."""

import numpy as np
import pytest
from scipy import ndimage

from tccm_ros.signs.saliency import salient_boxes, spectral_residual

MIN_SIDE = 10.0  # pixels: smaller text is unreadable


def twin(gray):
    """Saliency written out as in the paper, one frequency after the other."""
    spectrum = np.fft.fft2(gray.astype(float))
    log_amplitude = np.log(np.maximum(np.abs(spectrum), 1e-3))
    average = np.zeros_like(log_amplitude)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            average += np.roll(log_amplitude, (dy, dx), (0, 1)) / 9.0
    phase = np.angle(spectrum)
    salient = np.abs(np.fft.ifft2(np.exp(log_amplitude - average + 1j * phase))) ** 2
    return ndimage.gaussian_filter(salient, 2.0)


def plate_picture(seed=0, box=(420, 300, 500, 340)):
    rng = np.random.default_rng(seed)
    picture = 120.0 + rng.normal(0.0, 2.0, (720, 960))
    left, top, right, bottom = box
    picture[top:bottom, left:right] = 30.0
    for x in range(left + 8, right - 12, 20):
        picture[top + 8 : bottom - 8, x : x + 8] = 220.0
    return np.clip(picture, 0, 255).astype(np.uint8)


def test_saliency_is_that_of_the_paper():
    gray = np.random.default_rng(1).uniform(0, 255, (48, 64)).astype(np.float32)
    assert np.allclose(spectral_residual(gray), twin(gray), rtol=2e-3)


@pytest.mark.parametrize("x", [100, 430, 800])
def test_a_plate_on_a_plain_wall_has_a_box(x):
    box = (x, 300, x + 80, 340)
    boxes = salient_boxes(plate_picture(box=box))
    middle = np.array([x + 40, 320])
    inside = (boxes[:, :2] < middle).all(1) & (boxes[:, 2:] > middle).all(1)
    assert (inside & (boxes[:, 3] - boxes[:, 1] < 4 * 40)).any()


def test_boxes_lie_in_the_picture_and_have_the_size_of_text():
    boxes = salient_boxes(plate_picture(box=(0, 690, 70, 720)))
    assert len(boxes)
    assert boxes.min() >= 0.0
    assert (boxes.max(axis=0) <= np.array([960, 720, 960, 720]) + 1e-9).all()
    assert (np.minimum(*(boxes[:, 2:] - boxes[:, :2]).T) >= MIN_SIDE).all()


@pytest.mark.parametrize("shape", [(20, 30), (720, 1), (8, 96)])
def test_pictures_that_are_small_or_plain_give_no_error(shape):
    assert salient_boxes(np.zeros(shape, np.uint8)).shape[1] == 4
