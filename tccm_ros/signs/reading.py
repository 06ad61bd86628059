"""Text in pictures: find lines, rectify and recognise them.

The two networks are those of PP-OCR v4 from the package rapidocr-onnxruntime. onnxruntime runs them
on one thread, so that results are reproducible. The package itself is not imported, because it
would load OpenCV with its windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from scipy import ndimage

from tccm_ros.arrays import Bool, Float32, Float64, Int64
from tccm_ros.errors import MissingExtraError
from tccm_ros.signs.regions import text_regions

FINDER = "ch_PP-OCRv4_det_infer.onnx"
RECOGNISER = "ch_PP-OCRv4_rec_infer.onnx"

TEXT_PROBABILITY = 0.3
"""Minimum probability of a text pixel (PP-OCR)."""

LINE_PROBABILITY = 0.5
"""Minimum mean probability of the pixels of a line (PP-OCR)."""

GROWTH = 1.6
"""Growth of a line from the core that the finder marks, in units of area / perimeter (PP-OCR)."""

FINDER_STEP = 32
"""The finder takes widths and heights that are multiples of this, pixels (PP-OCR)."""

LINE_HEIGHT = 48
"""Height of a line for recognition, pixels (PP-OCR)."""

WIDTH_STEP, MAX_WIDTH = 32, 320
"""Step to which a line's width is padded, and maximum width, pixels. Chosen."""

MIN_LINE = 6
"""Minimum width and height of the core of a line, pixels of the finder. Chosen."""

NARROW_ASPECT = 0.67
"""Width over height of the core of a line below which the text may be vertical. Chosen: the core of
a single digit is as narrow, and is read in all three orientations."""

STEEP_ASPECT = 2.0
"""Height over width of a line above which its edges are fitted along its longer side. Chosen."""

SURE = 0.8
"""Mean probability of the characters above which no other orientation is tried. Chosen."""


@dataclass(frozen=True, eq=False)
class TextLine:
    """A line of text in a picture.

    Attributes
    ----------
    corners
        float64 (4, 2), top left, top right, bottom right, bottom left, pixels.
    """

    corners: Float64

    @property
    def center(self) -> Float64:
        """Middle of the line, pixels."""
        middle: Float64 = self.corners.mean(axis=0)
        return middle

    @property
    def height(self) -> float:
        """Mean length of its left and right edge, pixels."""
        return _mean_length(self.corners[[3, 2]] - self.corners[[0, 1]])

    @property
    def width(self) -> float:
        """Mean length of its upper and lower edge, pixels."""
        return _mean_length(self.corners[[1, 2]] - self.corners[[0, 3]])

    @property
    def bounds(self) -> Float64:
        """Left, top, right and bottom of the line, float64 (4,), pixels."""
        return np.append(self.corners.min(axis=0), self.corners.max(axis=0))

    @property
    def axes(self) -> Float64:
        """Unit vectors along the line and down from it, float64 (2, 2), pixels of the picture."""
        along = (self.corners[[1, 2]] - self.corners[[0, 3]]).sum(axis=0)
        along = along / max(float(np.linalg.norm(along)), 1e-9)
        return np.array([along, [-along[1], along[0]]])

    @property
    def orientations(self) -> list[TextLine]:
        """The possible reading directions: its own, and for a narrow line also up and down."""
        if self.width >= NARROW_ASPECT * self.height:
            return [self]
        return [self.turned(k) for k in (0, 1, -1)]

    @property
    def lengthwise(self) -> TextLine:
        """The line along its longer edges; upwards where these are steep."""
        return self.turned(1) if self.is_steep else self

    @property
    def is_steep(self) -> bool:
        """Whether the line is narrow: vertical text or a single character."""
        return STEEP_ASPECT * self.width < self.height

    def turned(self, quarters: int) -> TextLine:
        """Return the same quadrilateral with its reading direction rotated by quarter turns."""
        return TextLine(np.roll(self.corners, quarters, axis=0))


class Reading(NamedTuple):
    """The text of a line.

    Attributes
    ----------
    text
        Recognised text.
    confidence
        Mean probability of its characters, 0 to 1.
    line
        The line in reading direction: text that runs upwards begins at the bottom.
    """

    text: str
    confidence: float
    line: TextLine


class TextReader:
    """Finds lines of text and reads them.

    Raises
    ------
    MissingExtraError
        When rapidocr-onnxruntime or onnxruntime is not installed.
    """

    def __init__(self) -> None:
        folder = _models()
        self._finder = _session(folder / FINDER)
        self._recogniser = _session(folder / RECOGNISER)
        characters = self._recogniser.get_modelmeta().custom_metadata_map["character"]
        self._characters = ["", *characters.splitlines(), " "]

    def find(
        self, picture: Image.Image, scale: float, *, everywhere: bool = True
    ) -> list[TextLine]:
        """Return the lines of text in a picture, from top to bottom.

        Parameters
        ----------
        picture
            RGB.
        scale
            Pixels of the finder per pixel of the picture.
        everywhere
            Whether to search the whole picture; otherwise only candidate regions (`text_regions`).
        """
        own = np.array(picture.size)
        size = np.maximum(np.ceil(scale * own / FINDER_STEP).astype(int), 1) * FINDER_STEP
        scaled = picture.resize((int(size[0]), int(size[1])), Image.Resampling.BILINEAR)
        regions = np.array([[0, 0, *size]])
        if not everywhere:
            regions = text_regions(np.asarray(scaled.convert("L")))
        lines = [
            TextLine(corners * (own / size))
            for region in regions
            for corners in self._lines_in(scaled, region)
        ]
        return sorted(_each_once(lines), key=lambda line: float(line.center[1]))

    def _lines_in(self, picture: Image.Image, region: Int64) -> list[Float64]:
        """Return the corners (4, 2) of the lines in a part of a picture, pixels of the picture."""
        extent = -(-(region[2:] - region[:2]) // FINDER_STEP) * FINDER_STEP
        low = np.minimum(region[:2], np.array(picture.size) - extent)
        part = picture.crop((*low.tolist(), *(low + extent).tolist()))
        (probability,) = self._finder.run(None, {"x": _network_input(part)})
        return [corners + low for corners in text_lines(probability[0, 0])]

    def read(self, picture: Image.Image, line: TextLine) -> Reading:
        """Return the text of a line in its most probable orientation.

        Parameters
        ----------
        picture
            RGB.
        line
            A line returned by `find`.
        """
        best = Reading("", 0.0, line)
        for orientation in line.orientations:
            found = Reading(*self._recognised(picture, orientation), orientation)
            best = max(best, found, key=lambda reading: reading.confidence)
            if best.confidence >= SURE:
                break
        return best

    def _recognised(self, picture: Image.Image, line: TextLine) -> tuple[str, float]:
        pixels = _network_input(rectified(picture, line))
        width = -(-pixels.shape[3] // WIDTH_STEP) * WIDTH_STEP
        filled = np.zeros((1, 3, LINE_HEIGHT, width), np.float32)
        filled[:, :, :, : pixels.shape[3]] = pixels
        (probability,) = self._recogniser.run(None, {"x": filled})
        return self._decoded(probability[0])

    def _decoded(self, probability: Float32) -> tuple[str, float]:
        """Return text and mean probability of a sequence (T, characters) by greedy CTC decoding."""
        best = probability.argmax(axis=1)
        kept = best != 0
        kept[1:] &= best[1:] != best[:-1]
        if not kept.any():
            return "", 0.0
        text = "".join(self._characters[k] for k in best[kept])
        return text, float(probability.max(axis=1)[kept].mean())


def text_lines(probability: Float32) -> list[Float64]:
    """Return the corners (4, 2) of the lines in a text probability map, grown as by PP-OCR.

    Straight upper and lower edges are fitted to the columns of each connected component, so that
    oblique lines are rectified; for vertical lines, left and right edges are fitted to the rows.

    Parameters
    ----------
    probability
        float32 (H, W), probability of text.
    """
    labels, _ = ndimage.label(probability > TEXT_PROBABILITY, np.ones((3, 3)))
    found = []
    for k, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        mask = labels[rows, columns] == k
        if min(mask.shape) < MIN_LINE:
            continue
        if probability[rows, columns][mask].mean() < LINE_PROBABILITY:
            continue
        is_steep = mask.shape[0] > STEEP_ASPECT * mask.shape[1]
        # In the transposed mask, left and right edges become upper and lower edges.
        corners = _grown(mask.T)[[0, 3, 2, 1], ::-1] if is_steep else _grown(mask)
        found.append(corners + np.array([columns.start, rows.start]))
    return found


def _grown(mask: Bool) -> Float64:
    """Return the corners (4, 2) of a line, pixels, from the mask (H, W) of its core."""
    height, width = mask.shape
    x = np.arange(width)
    top = mask.argmax(axis=0)
    bottom = height - mask[::-1].argmax(axis=0)
    inner = slice(width // 8, width - width // 8)  # the ends are round
    slope = 0.5 * sum(np.polyfit(x[inner], y[inner], 1)[0] for y in (top, bottom))
    upper = float(np.median((top - slope * x)[inner]))
    lower = float(np.median((bottom - slope * x)[inner]))
    grow = GROWTH * mask.sum() / (2.0 * (width + lower - upper))
    left, right = -grow, width + grow
    return np.array(
        [
            [left, upper - grow + slope * left],
            [right, upper - grow + slope * right],
            [right, lower + grow + slope * right],
            [left, lower + grow + slope * left],
        ]
    )


def bounding_corners(lines: Sequence[TextLine]) -> Float64:
    """Return the corners float64 (4, 2) of the rectangle around lines, along the first, pixels."""
    first = lines[0].corners
    along = (first[1] - first[0]) / max(float(np.linalg.norm(first[1] - first[0])), 1e-9)
    axes = np.array([along, [-along[1], along[0]]])
    inside = np.concatenate([line.corners for line in lines]) @ axes.T
    (left, top), (right, bottom) = inside.min(axis=0), inside.max(axis=0)
    box = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return np.asarray(box @ axes)


def rectified(picture: Image.Image, line: TextLine) -> Image.Image:
    """Return a line as a rectified picture of height `LINE_HEIGHT` pixels."""
    width = round(LINE_HEIGHT * line.width / max(line.height, 1.0))
    size = (min(max(width, LINE_HEIGHT // 2), MAX_WIDTH), LINE_HEIGHT)
    quad = tuple(line.corners[[0, 3, 2, 1]].ravel())
    return picture.transform(size, Image.Transform.QUAD, quad, Image.Resampling.BILINEAR)


def _each_once(lines: list[TextLine]) -> list[TextLine]:
    """Return lines without duplicates of overlapping regions: middles inside a longer line."""
    kept: list[TextLine] = []
    for line in sorted(lines, key=lambda line: -line.width):
        if not any(_is_inside(line.center, other.bounds) for other in kept):
            kept.append(line)
    return kept


def _is_inside(pixel: Float64, bounds: Float64) -> bool:
    return bool((pixel > bounds[:2]).all() and (pixel < bounds[2:]).all())


def _mean_length(edges: Float64) -> float:
    return float(np.hypot(edges[:, 0], edges[:, 1]).mean())


def _network_input(picture: Image.Image) -> Float32:
    """Return the pixels (1, 3, H, W) of a picture as blue, green, red in -1 to 1."""
    pixels = np.asarray(picture)
    values = np.empty((1, 3, *pixels.shape[:2]), np.float32)
    for k in range(3):
        np.divide(pixels[:, :, 2 - k], np.float32(127.5), out=values[0, k])
    values -= np.float32(1.0)
    return values


def missing_extra() -> str:
    """Return an error sentence if the packages for reading text are missing; empty otherwise."""
    found = find_spec("rapidocr_onnxruntime")
    if found is None or found.origin is None or find_spec("onnxruntime") is None:
        return (
            "reading door signs needs rapidocr-onnxruntime, which is not installed; "
            "pip install 'tccm_ros[signs]', or pip install rapidocr-onnxruntime"
        )
    return ""


def _models() -> Path:
    """Return the folder of the network files."""
    missing, found = missing_extra(), find_spec("rapidocr_onnxruntime")
    if missing or found is None or found.origin is None:
        raise MissingExtraError(missing)
    return Path(found.origin).parent / "models"


def _session(path: Path) -> Any:
    """Return an inference session on one thread."""
    from onnxruntime import InferenceSession, SessionOptions

    options = SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
