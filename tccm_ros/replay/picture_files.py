"""Door signs of picture files, as `tccm signs` prints them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from tccm_ros.arrays import UInt8
from tccm_ros.errors import PictureError, one_line
from tccm_ros.signs.detector import DetectedSign, SignDetector


def read_picture(path: Path) -> UInt8:
    """Return the pixels of a picture, uint8 (H, W, 3), as it is looked at: turned as its EXIF says.

    Raises
    ------
    PictureError
        For a file that is missing or no picture.
    """
    try:
        with Image.open(path) as picture:
            return np.array(ImageOps.exif_transpose(picture).convert("RGB"))
    except FileNotFoundError:
        raise PictureError(f"{path}: no such file") from None
    except UnidentifiedImageError:
        raise PictureError(f"{path}: no picture that can be read; PNG, JPEG are some") from None
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise PictureError(f"{path}: cannot be read: {one_line(error)}") from error


def signs_of_pictures(paths: Iterable[Path]) -> Iterator[dict[str, Any]]:
    """Return for each picture its file and its door signs, as a line of JSON has them.

    Raises
    ------
    MissingExtraError
        When what reads text is not installed.
    PictureError
        At the first file that cannot be read.
    """
    detector = SignDetector()
    for path in paths:
        signs = detector.detect(read_picture(path))
        yield {"file": str(path), "signs": [_entry(sign) for sign in signs]}


def _entry(sign: DetectedSign) -> dict[str, Any]:
    return {
        "text": sign.text,
        "number": sign.number,
        "pixel": np.round(sign.pixel, 2).tolist(),
        "box": np.round(sign.box, 2).tolist(),
        "confidence": round(sign.confidence, 4),
    }
