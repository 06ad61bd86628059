"""The file of weights."""

import numpy as np

from tccm_ros.signs.classifier import SignClassifier, read_classifier
from tccm_ros.signs.hog import N_FEATURES, hog_features, region_patches


def test_the_weights_of_the_package_fit_the_features():
    classifier = read_classifier()
    assert classifier.weights.shape == (N_FEATURES,)
    assert np.isfinite(classifier.weights).all()
    assert np.isfinite([classifier.bias, classifier.threshold]).all()


def test_a_score_is_the_product_with_the_weights():
    rng = np.random.default_rng(0)
    gray = rng.integers(0, 256, (90, 160), np.uint8)
    boxes = np.array([[10.0, 10, 90, 50], [30, 20, 100, 80]])
    weights = rng.normal(size=N_FEATURES).astype(np.float32)
    features = hog_features(region_patches(gray, boxes))
    expected = [sum(a * b for a, b in zip(row, weights)) + 0.5 for row in features]
    assert np.allclose(SignClassifier(weights, 0.5, 0.0).scores(gray, boxes), expected, atol=1e-3)
    assert SignClassifier(weights, 0.5, 0.0).scores(gray, boxes[:0]).shape == (0,)
