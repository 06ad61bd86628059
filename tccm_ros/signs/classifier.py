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
        scores: Float32 = hog_features(region_patches(gray, boxes)) @ self.weights + self.bias
        return scores.astype(np.float32)


def read_classifier(path: Path = WEIGHTS) -> SignClassifier:
    """Return the classifier of a file that `tools/train_signs.py` wrote."""
    with np.load(path, allow_pickle=False) as file:
        return SignClassifier(file["weights"], float(file["bias"]), float(file["threshold"]))
