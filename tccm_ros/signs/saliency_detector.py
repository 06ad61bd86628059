"""Saliency detector of door signs, as in section III.A.2 of the surface mapping paper.

Saliency proposes boxes, HOG features and an SVM select those that may show the number of a sign,
and OCR reads the accepted boxes.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image, ImageOps

from tccm_ros.arrays import Float32, Float64, UInt8
from tccm_ros.signs.classifier import SignClassifier, read_classifier
from tccm_ros.signs.measurement import DetectedSign, SearchedText
from tccm_ros.signs.numbers import is_doubtful, is_list, normalised, room_number
from tccm_ros.signs.plates import LIST_DISTANCE, MIN_CONFIDENCE, OTHER_CONFIDENCE
from tccm_ros.signs.reading import TextLine, TextReader, bounding_corners
from tccm_ros.signs.saliency import salient_boxes

MAX_REGIONS = 12
"""Maximum number of boxes of a picture that are searched for text. Chosen: 5 to 10 ms per box."""

MARGIN_X, MARGIN_Y = 0.5, 0.6
"""Margin around a box that is searched for text, in its heights. Chosen: the other lines of a
plate.
"""

MAX_MARGIN = 60.0
"""Height of a box above which the margin does not grow, pixels. Chosen: it covers a whole plate."""

CUT = 1
"""Percentage of pixels that may saturate when the contrast of a region is stretched. Chosen."""

FINDER_AREA = 144.0**2
"""Area to which a search region is scaled, pixels. Chosen: the finder needs some 10 ms for it, and
finds a number of a fifth of its height."""

MAX_SCALE = 2.0
"""Maximum scale of a search region, for small boxes. Chosen."""

MAX_LINES = 3
"""Maximum number of lines read per plate. Chosen."""

LIST_LINE = 14.0
"""Height of the number in the search for other rows of its list, pixels. Chosen: the finder finds
lines of ten and more."""


@dataclass(frozen=True)
class Proposals:
    """Candidate boxes of a picture before text is read.

    Attributes
    ----------
    boxes
        float64 (N, 4), left, top, right and bottom of salient boxes, pixels.
    scores
        float32 (N,), scores of the classifier.
    accepted
        float64 (K, 4), boxes to be read, the best first, without large overlaps.
    """

    boxes: Float64
    scores: Float32
    accepted: Float64


class SaliencyDetector:
    """Detects door signs in salient regions and reads them.

    Parameters
    ----------
    classifier
        Classifier of boxes; None for the one of the package.

    Raises
    ------
    MissingExtraError
        When the packages for reading text are not installed.
    """

    def __init__(self, classifier: SignClassifier | None = None) -> None:
        self._reader = TextReader()
        self._classifier = classifier or read_classifier()

    @property
    def threshold(self) -> float:
        """Minimum score of an accepted box."""
        return self._classifier.threshold

    def detect(self, pixels: UInt8) -> list[DetectedSign]:
        """Return the door signs of a picture, from left to right.

        Parameters
        ----------
        pixels
            uint8 (H, W) brightness, or (H, W, 3) red, green, blue.
        """
        picture = Image.fromarray(pixels).convert("RGB")
        found: list[DetectedSign] = []
        for box in self.propose(np.asarray(picture.convert("L"))).accepted:
            if any(_is_inside(sign.pixel, box) for sign in found):
                continue
            sign = self._read(picture, box)
            if sign is not None and not any(_is_inside(sign.pixel, _corners(s.box)) for s in found):
                found.append(sign)
        return sorted(found, key=lambda sign: float(sign.pixel[0]))

    def search(self, pixels: UInt8) -> SearchedText:
        """Return the door signs of a picture; refused text is not reported."""
        return SearchedText(self.detect(pixels), [])

    def propose(self, gray: UInt8) -> Proposals:
        """Return the salient boxes of a picture, and those to be read.

        Parameters
        ----------
        gray
            uint8 (H, W), brightness.
        """
        boxes = salient_boxes(gray)
        scores = self._classifier.scores(gray, boxes)
        accepted: list[Float64] = []
        for k in np.argsort(-scores, kind="stable"):
            if scores[k] < self._classifier.threshold or len(accepted) == MAX_REGIONS:
                break
            if not any(_overlap(boxes[k], box) > 0.3 for box in accepted):
                accepted.append(boxes[k])
        return Proposals(boxes, scores, np.array(accepted).reshape(-1, 4))

    def _read(self, whole: Image.Image, box: Float64) -> DetectedSign | None:
        """Return the door sign whose number a box shows; None if it shows none."""
        margin = min(float(box[3] - box[1]), MAX_MARGIN) * np.array([MARGIN_X, MARGIN_Y])
        low = np.maximum(np.floor(box[:2] - margin), 0.0)
        high = np.minimum(np.ceil(box[2:] + margin), whole.size)
        part = whole.crop(tuple(np.append(low, high).astype(int)))
        picture = ImageOps.autocontrast(part, CUT)
        scale = min(math.sqrt(FINDER_AREA / float(np.prod(high - low))), MAX_SCALE)
        lines = self._reader.find(picture, scale)
        box = box - np.tile(low, 2)
        near = [k for k, line in enumerate(lines) if _is_inside(line.center, box)]
        near = sorted(near, key=lambda k: -lines[k].height)[:MAX_LINES]
        for k in near:
            text, confidence, _ = self._reader.read(picture, lines[k])
            number = room_number(normalised(text))
            if number is None or confidence < MIN_CONFIDENCE:
                continue
            if is_doubtful(number) and " " in number:  # "Lab 2", another line of a plate
                continue
            if is_list([line.height for line in lines], k) or self._is_row(whole, lines[k], low):
                return None
            read = normalised(text), number, confidence
            return _moved(self._sign(picture, lines, k, read), low)
        return None

    def _is_row(self, whole: Image.Image, line: TextLine, low: Float64) -> bool:
        """Return whether a line is a row of a list or notice, by the lines around it.

        Parameters
        ----------
        whole
            The picture, RGB.
        line
            Line of text, in a region of the picture.
        low
            float64 (2,), left and top of the region, pixels.
        """
        distance = np.array(LIST_DISTANCE) * line.height
        corner = np.maximum(np.floor(line.corners.min(axis=0) + low - distance), 0.0)
        end = np.minimum(np.ceil(line.corners.max(axis=0) + low + distance), whole.size)
        around = whole.crop(tuple(np.append(corner, end).astype(int)))
        picture = ImageOps.autocontrast(around, CUT)
        found = self._reader.find(picture, min(LIST_LINE / line.height, MAX_SCALE))
        heights = [line.height, *(other.height for other in found)]
        own = line.center + low - corner
        same = [k for k, other in enumerate(found, 1) if _is_inside(own, other.bounds)]
        return is_list([h for k, h in enumerate(heights) if k not in same], 0)

    def _sign(
        self, picture: Image.Image, lines: list[TextLine], own: int, read: tuple[str, str, float]
    ) -> DetectedSign:
        """Return a sign with its other lines; pixels are counted from the corner of the region.

        Parameters
        ----------
        picture
            The region, RGB.
        lines
            Lines near the number, from top to bottom.
        own
            Index of the number's line.
        read
            Text of the line, the number and the confidence.
        """
        texts = {own: read[0]}
        others = [k for k in range(len(lines)) if k != own]
        for k in sorted(others, key=lambda k: abs(k - own))[: MAX_LINES - 1]:
            text, confidence, _ = self._reader.read(picture, lines[k])
            if confidence >= OTHER_CONFIDENCE and normalised(text):
                texts[k] = normalised(text)
        joined = " ".join(texts[k] for k in sorted(texts))
        corners = lines[own].corners
        low, high = corners.min(axis=0), corners.max(axis=0)
        box = np.append(low, high - low)
        plate = bounding_corners([lines[k] for k in texts])
        return DetectedSign(joined, read[1], lines[own].center, box, read[2], corners, plate)


def _moved(sign: DetectedSign, low: Float64) -> DetectedSign:
    """Return a sign of a region in the picture, for the region's left and top (2,)."""
    return replace(
        sign,
        pixel=sign.pixel + low,
        box=sign.box + np.append(low, [0.0, 0.0]),
        corners=sign.corners + low,
        plate=sign.plate + low,
    )


def _corners(box: Float64) -> Float64:
    """Return left, top, right and bottom of a box given as left, top, width and height."""
    return np.append(box[:2], box[:2] + box[2:])


def _is_inside(pixel: Float64, box: Float64) -> bool:
    return bool(np.all(pixel >= box[:2]) and np.all(pixel <= box[2:]))


def _overlap(a: Float64, b: Float64) -> float:
    """Return the common area of two boxes as a fraction of the smaller one."""
    common = np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0))
    return float(common / min(np.prod(a[2:] - a[:2]), np.prod(b[2:] - b[:2])))
