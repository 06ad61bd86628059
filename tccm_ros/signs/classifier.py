"""The linear support vector machine that selects regions with the number of a door sign.

`tools/train_signs.py` trains `weights.npz` on rendered pictures alone, with fixed seeds.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tccm_ros.arrays import Float32, Float64, UInt8
from tccm_ros.signs.hog import hog_features, region_patches

WEIGHTS = Path(__file__).with_name("weights.npz")
"""Weights file written by `tools/train_signs.py`."""

SCALES = (0.85, 1.18)
"""Further sizes at which a box is scored. Chosen: saliency boxes enclose a number sometimes
tightly, sometimes with its surroundings."""

DOUBT = 0.5
"""A box whose score is below the threshold by more than this is not scored at other sizes. Chosen:
in twelve rendered pictures this lost no box that the mean score accepts."""


@dataclass(frozen=True)
class SignClassifier:
    """A linear SVM over histograms of oriented gradients.

    Attributes
    ----------
    weights
        float32 (`N_FEATURES`,).
    bias
        Bias of the linear function.
    threshold
        Minimum score of an accepted region.
    """

    weights: Float32
    bias: float
    threshold: float

    def scores(self, gray: UInt8, boxes: Float64) -> Float32:
        """Return the score of each box; a larger score is more like a number on a plate.

        The score is the mean over `SCALES` about the box's centre. A box that scores below the
        threshold by more than `DOUBT` at its own size keeps that score.

        Parameters
        ----------
        gray
            uint8 (H, W), brightness.
        boxes
            float64 (N, 4), left, top, right and bottom, pixels.

        Returns
        -------
        float32 (N,)
        """
        scores = self._scores(gray, boxes)
        doubtful = np.nonzero(scores > self.threshold - DOUBT)[0]
        scaled = [self._scores(gray, _scaled(boxes[doubtful], scale)) for scale in SCALES]
        scores[doubtful] = np.mean([scores[doubtful], *scaled], axis=0)
        return scores

    def _scores(self, gray: UInt8, boxes: Float64) -> Float32:
        features = hog_features(region_patches(gray, boxes))
        return (features @ self.weights + self.bias).astype(np.float32)


def _scaled(boxes: Float64, scale: float) -> Float64:
    """Return boxes (N, 4) scaled about their centres."""
    middles, halves = 0.5 * (boxes[:, :2] + boxes[:, 2:]), 0.5 * (boxes[:, 2:] - boxes[:, :2])
    return np.hstack([middles - scale * halves, middles + scale * halves])


def read_classifier() -> SignClassifier:
    """Return the classifier that `tools/train_signs.py` wrote."""
    with np.load(WEIGHTS, allow_pickle=False) as file:
        return SignClassifier(file["weights"], float(file["bias"]), float(file["threshold"]))
