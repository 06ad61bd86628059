"""The published detector: saliency, histograms of gradients and an SVM, in rendered pictures."""

import numpy as np
import pytest
from PIL import Image
from sign_lists import directory
from training_pictures import random_picture

from tccm_ros.signs.classifier import read_classifier
from tccm_ros.signs.saliency import salient_boxes
from tccm_ros.signs.saliency_detector import SaliencyDetector

SEED = 3_000_000
"""Seed of the first picture; training uses others."""


@pytest.fixture(scope="module")
def detector():
    pytest.importorskip("onnxruntime", reason="the extra 'signs' is not installed")
    return SaliencyDetector()


def is_found(boxes, corners):
    """Return whether a box covers the middle of a number."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = 0.5 * (low + high)
    return bool(((boxes[:, :2] < middle) & (boxes[:, 2:] > middle)).all(axis=1).any())


def test_the_classifier_keeps_numbers_and_rejects_other_boxes():
    classifier, kept, salient, accepted, total = read_classifier(), 0, 0, 0, 0
    for k in range(12):
        picture = random_picture(np.random.default_rng(SEED + k), 1)
        gray = np.asarray(Image.fromarray(picture.pixels).convert("L"))
        boxes = salient_boxes(gray)
        good = classifier.scores(gray, boxes) >= classifier.threshold
        salient += is_found(boxes, picture.corners[0])
        kept += is_found(boxes[good], picture.corners[0])
        accepted, total = accepted + good.sum(), total + len(good)
    assert salient >= 9
    assert kept >= salient - 1
    assert accepted < 0.15 * total


def test_signs_of_rendered_pictures_are_read(detector):
    right = false = 0
    for k in range(12):
        picture = random_picture(np.random.default_rng(SEED + k), 1)
        for sign in detector.detect(picture.pixels):
            is_right = picture.numbers[0] == sign.number
            low, high = picture.corners[0].min(axis=0), picture.corners[0].max(axis=0)
            on_it = (sign.pixel > low - 5).all() and (sign.pixel < high + 5).all()
            right, false = right + (is_right and on_it), false + (not on_it)
    assert right >= 6
    assert false <= 1


@pytest.mark.parametrize("size", [16, 24])
def test_rows_of_a_directory_are_no_door_signs(detector, monkeypatch, size):
    picture = directory(size, size)
    assert detector.detect(picture) == []
    # What is beside its box alone does not tell a row: the rest of the list does.
    monkeypatch.setattr(SaliencyDetector, "_is_row", lambda *_: False)
    assert len(detector.detect(picture)) > 1
