"""Detection of door signs in picture files, for `tccm signs`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from tccm_ros.arrays import UInt8
from tccm_ros.config.signs import SignsConfig
from tccm_ros.errors import PictureError, one_line
from tccm_ros.signs.detector import sign_detector
from tccm_ros.signs.measurement import DetectedSign, RefusedText


def read_picture(path: Path) -> UInt8:
    """Return the pixels of a picture, uint8 (H, W, 3), rotated according to its EXIF data.

    Raises
    ------
    PictureError
        If the file is missing or not a picture.
    """
    try:
        with Image.open(path) as picture:
            return np.array(ImageOps.exif_transpose(picture).convert("RGB"))
    except FileNotFoundError:
        raise PictureError(f"{path}: no such file") from None
    except UnidentifiedImageError:
        raise PictureError(f"{path}: not a readable image; PNG and JPEG are") from None
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise PictureError(f"{path}: cannot be read: {one_line(error)}") from error


def signs_of_pictures(
    paths: Iterable[Path], settings: SignsConfig | None = None
) -> Iterator[dict[str, Any]]:
    """Yield the file and the door signs of each picture, as JSON objects.

    Parameters
    ----------
    paths
        Picture files.
    settings
        Settings of the detector; None for the defaults.

    Raises
    ------
    MissingExtraError
        If the text recognition is not installed.
    PictureError
        At the first file that cannot be read.
    """
    detector = sign_detector(settings or SignsConfig())
    for path in paths:
        found = detector.search(read_picture(path))
        yield {
            "file": str(path),
            "signs": [_entry(sign) for sign in found.signs],
            "refused": [_refused(text) for text in found.refused],
        }


def _entry(sign: DetectedSign) -> dict[str, Any]:
    return {
        "text": sign.text,
        "number": sign.number,
        "pixel": np.round(sign.pixel, 2).tolist(),
        "box": np.round(sign.box, 2).tolist(),
        "confidence": round(sign.confidence, 4),
    }


def _refused(text: RefusedText) -> dict[str, Any]:
    return {
        "text": text.text,
        "pixel": np.round(text.pixel, 2).tolist(),
        "reason": text.reason,
    }
