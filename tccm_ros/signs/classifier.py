"""The linear support vector machine that says which regions may hold the number of a door sign.

`tools/train_signs.py` makes `weights.npz` from rendered pictures alone, with fixed seeds.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tccm_ros.arrays import Float32, Float64, UInt8
from tccm_ros.signs.hog import hog_features, region_patches

WEIGHTS = Path(__file__).with_name("weights.npz")
"""What `tools/train_signs.py` writes."""

SCALES = (0.85, 1.18)
"""Other sizes at which a box is scored, as parts of its own: saliency bounds a number now tightly,
now with what is around it (chosen)."""

DOUBT = 0.5
"""What scores less than the threshold by more than this is not scored at other sizes. Chosen: in
twelve rendered pictures no box was lost by it that the mean accepts."""


@dataclass(frozen=True)
class SignClassifier:
    """A linear SVM over histograms of oriented gradients.

    Attributes
    ----------
    weights
        float32 (`N_FEATURES`,).
    bias
        Added to the product of weights and features.
    threshold
        Least score of a region that is accepted.
    """

    weights: Float32
    bias: float
    threshold: float

    def scores(self, gray: UInt8, boxes: Float64) -> Float32:
        """Return the score of each box, larger for what looks more like a number on a plate.

        It is the mean over `SCALES` of the box, which keeps its middle; a box that scores less than
        the threshold by more than `DOUBT` as it is keeps that score.

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
    """Return boxes (N, 4) of another size about the same middles."""
    middles, halves = 0.5 * (boxes[:, :2] + boxes[:, 2:]), 0.5 * (boxes[:, 2:] - boxes[:, :2])
    return np.hstack([middles - scale * halves, middles + scale * halves])


def read_classifier(path: Path = WEIGHTS) -> SignClassifier:
    """Return the classifier of a file that `tools/train_signs.py` wrote."""
    with np.load(path, allow_pickle=False) as file:
        return SignClassifier(file["weights"], float(file["bias"]), float(file["threshold"]))
