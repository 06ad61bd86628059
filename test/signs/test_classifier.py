"""The file of weights."""

import numpy as np

from tccm_ros.signs.classifier import SignClassifier, read_classifier
from tccm_ros.signs.hog import hog_features, region_patches

DOUBT = 0.5  # below the threshold: other sizes are not scored
N_FEATURES = 7 * 3 * 4 * 9  # blocks of 2 x 2 cells in 8 x 4 cells, 9 bins each
SCALES = (0.85, 1.18)  # further sizes of a box: a tight one, and one with surroundings


def test_the_weights_of_the_package_fit_the_features():
    classifier = read_classifier()
    assert classifier.weights.shape == (N_FEATURES,)
    assert np.isfinite(classifier.weights).all()
    assert np.isfinite([classifier.bias, classifier.threshold]).all()


def test_a_score_is_the_mean_product_with_the_weights_at_three_sizes():
    gray, boxes, weights = picture_boxes_weights()
    classifier = SignClassifier(weights, 0.5, -np.inf)
    expected = np.mean([products(gray, resized(boxes, s), weights) for s in (1.0, *SCALES)], axis=0)
    assert np.allclose(classifier.scores(gray, boxes), expected + 0.5, atol=1e-3)
    assert classifier.scores(gray, boxes[:0]).shape == (0,)


def test_a_box_that_scores_far_too_little_keeps_its_score():
    gray, boxes, weights = picture_boxes_weights()
    own = np.array(products(gray, boxes, weights))
    low, high = np.sort(own)
    scores = SignClassifier(weights, 0.0, 0.5 * (low + high) + DOUBT).scores(gray, boxes)
    changed = np.abs(scores - own) > 1e-3
    assert changed.tolist() == (own == high).tolist()


def picture_boxes_weights():
    rng = np.random.default_rng(0)
    gray = rng.integers(0, 256, (90, 160), np.uint8)
    boxes = np.array([[20.0, 15, 90, 50], [30, 20, 100, 75]])
    return gray, boxes, rng.normal(size=N_FEATURES).astype(np.float32)


def resized(boxes, scale):
    return [
        (x - scale * w, y - scale * h, x + scale * w, y + scale * h)
        for x, y, w, h in (
            ((a + c) / 2, (b + d) / 2, (c - a) / 2, (d - b) / 2) for a, b, c, d in boxes
        )
    ]


def products(gray, boxes, weights):
    features = hog_features(region_patches(gray, np.array(boxes)))
    return [sum(a * b for a, b in zip(row, weights)) for row in features]
